"""The map of myocardial blood flow: reading, extraction of the wall, checks, filling of invalid values, CGS."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coronaryuq.case.description.fields import Label, Perfusion
from coronaryuq.case.perfusion.cells import voxels_as_hexahedra
from coronaryuq.case.perfusion.images import IMAGE_SUFFIXES, Invalid, check_file, read_image, register, wall_cells
from coronaryuq.case.perfusion.registration_quality import agreement
from coronaryuq.case.perfusion.transform_files import read_transform
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.vtk import read_vtk
from coronaryuq.core.units import LENGTHS, MBF_PER_MIN_PER_G, MM, percent, perfusions

if TYPE_CHECKING:
    import pyvista

VTK_SUFFIXES = (".vtu", ".vtk", ".vti", ".vtp", ".vts", ".vtr")
PLAUSIBLE_FLOW = (0.1, 10.0)
"""mL/min/g: plausible median over the wall at rest or stress; outside it, the unit is wrong."""
PLAUSIBLE_EXTENT = (2.5, 20.0)
"""cm: longest side of the wall's bounding box, from a small animal's heart to a dilated human one."""
PLAUSIBLE_VOLUME = (5.0, 800.0)
"""cm3: plausible volume of the wall."""
FAINT, MOST_FAINT = 0.1, 0.3
"""Fraction of the highest flow below which tissue is not perfused, and largest fraction of the wall that it may be. A
transmural scar has a third of the flow beside it; a larger part without flow is background."""
ITSELF = (
    "perfusion.registration: a map shows little that an angiogram shows, and may be placed centimetres off; give "
    "`moving`, the scan from which the map was made, or perfusion.transform"
)
"""Of a synthetic chest, the scan was placed to 0.1 mm and the map itself 13 mm off."""
MASKS = (1.0, 255.0)
"""Values that segmentation programs write where a mask is."""
MOST_INVALID = 0.2
"""Largest fraction of the wall whose invalid values are filled from their neighbours."""


@dataclass(frozen=True)
class Wall:
    """The left ventricular wall: grid with cell data Volume (cm3) and MBF (mL/s per g); notes for the user."""

    mesh: "pyvista.DataSet"
    notes: tuple[str, ...]

    @property
    def volume(self) -> float:
        """Volume of the wall, cm3."""
        return float(np.sum(self.mesh.cell_data["Volume"]))

    def flow(self, tissue_density: float) -> float:
        """Return the flow of the whole wall, mL/s."""
        return float(np.sum(self.mesh.cell_data["Volume"] * self.mesh.cell_data["MBF"]) * tissue_density)


def read_wall(file: Path, map_: Perfusion, tissue_density: float, most_cells: int) -> Wall:
    """Read the perfusion map of the case `file`.

    Cells whose value is missing (NaN, infinite; in an image also exactly zero) or negative keep their volume and get
    the value of the nearest valid cell; a note states their number. Raises InputError for wrong units (implausible
    median flow, extent or volume), an empty wall, or a wall with more than a fifth of invalid values.
    """
    folder = file.parent
    path = folder / map_.file
    if path.is_dir():
        check_file(path)
    if not path.is_file():
        raise InputError(file, "perfusion.file", map_.file, "no such file")
    grid, invalid, notes = _cells(file, path, map_, folder, most_cells)
    grid = voxels_as_hexahedra(grid)
    grid.points, placing = _to_anatomy(file, np.asarray(grid.points, dtype=float), map_, folder)
    sizes = grid.compute_cell_sizes(length=False, area=False, volume=True).cell_data["Volume"]
    volumes = np.abs(np.asarray(sizes, dtype=float))
    if not (volumes > 0).any():
        raise InputError(path, "cells", grid.n_cells, "no cell has a volume; expected tetrahedra, hexahedra or voxels")
    volumes *= np.asarray(grid.cell_data.get("share", np.ones(grid.n_cells)))
    values = np.asarray(grid.cell_data["value"], dtype=float)
    known = values[np.isfinite(values)]
    if len(known) and known.max() <= 0:
        where = "" if map_.label is None else " where perfusion.label selects"
        raise InputError(
            path, "values", None, f"none is positive{where}; choose another array, or export the map again"
        )
    _check_background(file, map_, values, volumes)
    _check_lengths(file, map_, grid, volumes)
    values, filled = _filled(path, values, np.asarray(grid.cell_centers().points, dtype=float), invalid)
    _check_unit(file, map_, values, volumes, tissue_density)
    grid.clear_data()
    grid.cell_data["Volume"] = volumes
    grid.cell_data["MBF"] = values * perfusions(tissue_density)[map_.unit]
    return Wall(grid, (*notes, *_mask(map_, values), *filled, *placing))


def _mask(map_: Perfusion, values: np.ndarray) -> tuple[str, ...]:
    """Return a note if the map has the one value of a mask."""
    if np.ptp(values) > 0 or values[0] not in MASKS:
        return ()
    return (f"{map_.file}: every value is {values[0]:g}: is it a mask, and not a map of flow?",)


def _absent(file: Path, map_: Perfusion, labels: np.ndarray) -> tuple[str, ...]:
    """Return a note of labels asked for that the image lacks; raise InputError, with those it has, if it lacks all."""
    assert map_.label is not None
    there, where = np.unique(labels), map_.label.file or map_.file
    absent = [value for value in map_.label.values if value not in there]
    if len(absent) == len(map_.label.values):
        has = ", ".join(f"{value:g}" for value in there[:12]) + (", ..." if len(there) > 12 else "")
        remedy = f"selects no cell: {where} has {has}"
        raise InputError(file, "perfusion.label.values", map_.label.values, remedy)
    return (f"{where}: has no label {', '.join(map(str, absent))} (perfusion.label.values)",) if absent else ()


def _cells(file, path: Path, map_: Perfusion, folder: Path, most_cells: int):
    """Return the wall as a grid, the count of its invalid values, and notes.

    Cell data `value` is in the map's unit, points are in the map's length unit; `share`, if it is there, is the part of
    a cell that belongs to the wall.
    """
    name = path.name.lower()
    if name.endswith(IMAGE_SUFFIXES):
        placed_otherwise = map_.placed_by is not None
        image = read_image(path, placed_otherwise=placed_otherwise)
        if image.unit is not None and image.unit != map_.length_unit:
            remedy = f"the header of {map_.file} says {image.unit}; correct this, or the header"
            if image.stated != image.unit:
                remedy = f"{map_.file} is read in {image.unit}, converted from its header's {image.stated}"
                remedy += f"; write {image.unit}"
            raise InputError(file, "perfusion.length_unit", map_.length_unit, remedy)
        label, notes = None, image.notes
        if map_.label is not None:
            if map_.label.file is None:
                raise InputError(
                    file, "perfusion.label.file", None, "missing; an image map needs its labels in a separate file"
                )
            label_path = folder / map_.label.file
            labels = read_image(label_path, image, path, placed_otherwise)
            notes += _absent(file, map_, labels.values)
            label = np.isin(labels.values, map_.label.values)
        grid, invalid = wall_cells(file, image, label, map_.threshold, most_cells)
        return grid, invalid, notes
    if not name.endswith(VTK_SUFFIXES):
        known = ", ".join((*VTK_SUFFIXES, *IMAGE_SUFFIXES))
        raise InputError(file, "perfusion.file", map_.file, f"unknown file type; known types: {known}")
    return _from_vtk(file, path, map_)


def _from_vtk(file, path: Path, map_: Perfusion):
    import pyvista as pv

    mesh = read_vtk(path)
    if mesh.n_cells == 0:
        raise InputError(path, "cells", mesh.n_cells, "expected one mesh with volume cells")
    if not np.isfinite(np.asarray(mesh.points)).all():
        raise InputError(path, "points", None, "a coordinate is not a finite number; export the map again")
    # VTK's own arrays count cells and points, and mark ghosts.
    arrays = sorted(name for name in {*mesh.cell_data.keys(), *mesh.point_data.keys()} if not name.startswith("vtk"))
    array = map_.array
    if array is None:
        candidates = [a for a in arrays if map_.label is None or a != map_.label.array]
        if len(candidates) != 1:
            raise InputError(
                file,
                "perfusion.array",
                None,
                f"missing; choose among the map's arrays: {', '.join(arrays) or 'no array'}",
            )
        array = candidates[0]
    at_points = _scalar(file, "perfusion.array", mesh, array, arrays)
    both = array in mesh.cell_data and array in mesh.point_data
    notes: tuple[str, ...] = (f"{map_.file}: {array} is there at points and in cells; took the cells'",) if both else ()
    selected = _selected_points(file, mesh, map_, arrays, at_points, array not in mesh.cell_data)
    values = _on_cells(mesh, array, at_points, selected)
    valid = np.isfinite(values) & (values >= 0)
    share = np.ones(mesh.n_cells)
    if map_.label is not None:
        share = _label_on_cells(mesh, map_.label) if selected is None else _average(mesh, selected)
    if map_.threshold is not None and selected is None:
        share = _largest_above(mesh, valid & (values > map_.threshold), ~valid).astype(float)
    elif map_.threshold is not None and selected is not None:
        usable = _average(mesh, np.isfinite(at_points) & (at_points >= 0))
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(usable > 0, _average(mesh, selected) / usable, 1.0)
        share *= _largest_above(mesh, (usable > 0) & (share > 0), usable == 0)
    if map_.label is not None and map_.label.array is not None:
        notes += _absent(file, map_, np.asarray(mesh.get_array(map_.label.array)))
    keep = share > 0
    if not keep.any():
        field = "perfusion.label" if map_.label is not None else "perfusion.threshold"
        raise InputError(file, field, map_.threshold, "selects no cell of the map")
    grid = pv.UnstructuredGrid(mesh.extract_cells(np.flatnonzero(keep).astype(int)))
    _check_once(path, grid)
    grid.clear_data()
    grid.cell_data["value"], grid.cell_data["share"] = values[keep], share[keep]
    negative = int(np.count_nonzero(values[keep] < 0))
    return grid, Invalid(int(np.count_nonzero(~valid[keep])) - negative, negative, int(keep.sum()), "cells"), notes


def _check_once(path: Path, grid) -> None:
    """Raise InputError if cells lie upon one another, whose volume and flow would count twice."""
    volumes = np.asarray(grid.compute_cell_sizes(length=False, area=False).cell_data["Volume"])
    centres = np.asarray(grid.cell_centers().points, dtype=float)[volumes != 0]
    extent = float(np.ptp(np.asarray(grid.points), axis=0).max())
    twice = len(centres) - len(np.unique(np.round(centres / (1e-6 * extent)), axis=0)) if extent > 0 else 0
    if twice:
        raise InputError(path, "cells", twice, "lie upon others; remove duplicates, as by ParaView's Clean to Grid")


def _largest_above(mesh, above: np.ndarray, invalid: np.ndarray) -> np.ndarray:
    """Select the largest connected part of the cells `above` the threshold, and the invalid cells inside it.

    An invalid cell is inside if four or more of its six nearest valid cells belong to that part.
    """
    from scipy.spatial import cKDTree

    if not above.any():
        return above
    labelled = mesh.extract_cells(np.flatnonzero(above)).connectivity("all")
    region = np.asarray(labelled.cell_data["RegionId"])
    part = np.zeros(mesh.n_cells, dtype=bool)
    part[np.flatnonzero(above)[region == np.argmax(np.bincount(region))]] = True
    if invalid.any():
        centres = np.asarray(mesh.cell_centers().points)
        valid = np.flatnonzero(~invalid)
        _, near = cKDTree(centres[valid]).query(centres[invalid], k=min(6, len(valid)))
        part[np.flatnonzero(invalid)[part[valid][near].reshape(len(near), -1).sum(axis=1) >= 4]] = True
    return part


def _scalar(file, field: str, mesh, array: str, arrays: list[str]) -> np.ndarray:
    """Return an array of cell or point values."""
    found = mesh.cell_data.get(array) if array in mesh.cell_data else mesh.point_data.get(array)
    if found is None:
        raise InputError(file, field, array, f"no such array; the map has {', '.join(arrays) or 'none'}")
    values = np.asarray(found, dtype=float)
    if values.ndim != 1:
        raise InputError(file, field, array, f"has {values.shape[1]} components; expected one")
    return values


def _selected_points(file, mesh, map_: Perfusion, arrays: list[str], values: np.ndarray, at_points: bool):
    """Return which points are in the wall, if label or threshold select points; None if they select cells, or nothing.

    A point stands for the space around it: a cell belongs to the wall by the share of its points that do, so that a
    map has the same wall by its points as by its cells.
    """
    if map_.label is not None:
        name = map_.label.array
        if name is None:
            remedy = f"missing; choose among the map's arrays: {', '.join(arrays)}"
            raise InputError(file, "perfusion.label.array", None, remedy)
        labels = _scalar(file, "perfusion.label.array", mesh, name, arrays)
        return None if name in mesh.cell_data else np.isin(labels, map_.label.values)
    if map_.threshold is not None and at_points:
        with np.errstate(invalid="ignore"):
            return values > map_.threshold
    return None


def _average(mesh, values: np.ndarray) -> np.ndarray:
    """Return the average of point values over the points of each cell."""
    work = mesh.copy(deep=False)
    work.clear_data()
    work.point_data["values"] = values.astype(float)
    return np.asarray(work.point_data_to_cell_data().cell_data["values"])


def _on_cells(mesh, array: str, values: np.ndarray, selected: np.ndarray | None) -> np.ndarray:
    """Return cell values; point values are averaged over a cell's valid points in the wall."""
    if array in mesh.cell_data:
        return values
    valid = np.isfinite(values) & (values >= 0)
    if selected is not None:
        valid &= selected
    with np.errstate(invalid="ignore", divide="ignore"):
        return _average(mesh, np.where(valid, values, 0.0)) / _average(mesh, valid)


def _label_on_cells(mesh, label: Label) -> np.ndarray:
    """Return 1 for cells whose label is one of the wall's, else 0."""
    return np.isin(np.asarray(mesh.cell_data[label.array]), label.values).astype(float)


def _to_anatomy(file, points: np.ndarray, map_: Perfusion, folder: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the map's points in the anatomy, cm, and notes on a registration."""
    if map_.registration is None:
        return _placed(file, points, map_), _mirrored(map_)
    scale = LENGTHS[map_.length_unit]
    fixed, moving = folder / map_.registration.fixed, folder / (map_.registration.moving or map_.file)
    matrix = register(file, fixed, moving)
    points = points @ matrix[:3, :3].T + matrix[:3, 3]
    doubt = (ITSELF,) if map_.registration.moving is None else ()
    return points * scale, (agreement(fixed, moving, matrix, points, MM / scale).note, *doubt)


def _placed(file, points: np.ndarray, map_: Perfusion) -> np.ndarray:
    scale = LENGTHS[map_.length_unit]
    if map_.transform is not None:
        inverse = np.linalg.inv(read_transform(file, map_.transform))
        return (points * scale / MM) @ inverse[:3, :3].T * MM + inverse[:3, 3] * MM
    if map_.affine is not None:
        matrix = np.array(map_.affine, dtype=float)
        if not np.allclose(matrix[3], [0, 0, 0, 1]) or abs(np.linalg.det(matrix[:3, :3])) < 1e-12:
            raise InputError(
                file, "perfusion.affine", map_.affine, "the last row must be 0 0 0 1 and the matrix invertible"
            )
        return points @ matrix[:3, :3].T + matrix[:3, 3]
    return points * scale


def _mirrored(map_: Perfusion) -> tuple[str, ...]:
    """Return a note if the affine turns a left hand into a right one, as no motion of a patient does."""
    if map_.affine is None or np.linalg.det(np.array(map_.affine, dtype=float)[:3, :3]) > 0:
        return ()
    return ("perfusion.affine mirrors the map: check its signs",)


def _check_lengths(file, map_: Perfusion, grid, volumes: np.ndarray) -> None:
    extent = float(np.ptp(np.asarray(grid.points), axis=0).max())
    low, high = PLAUSIBLE_EXTENT
    if not low <= extent <= high:
        used = LENGTHS[map_.length_unit]
        fits = [u for u, s in LENGTHS.items() if low <= extent / used * s <= high]
        hint = f"; its points seem to be in {fits[0]}" if len(fits) == 1 else ""
        hint = "; the affine must map to cm" if map_.affine is not None else hint
        raise InputError(
            file, "perfusion.length_unit" if map_.affine is None else "perfusion.affine",
            map_.length_unit if map_.affine is None else None, f"makes the wall {extent:.3g} cm long{hint}",
        )  # fmt: skip
    total = float(volumes.sum())
    if not PLAUSIBLE_VOLUME[0] <= total <= PLAUSIBLE_VOLUME[1]:
        raise InputError(
            file, "perfusion", f"{total:.3g} cm3", "implausible wall volume; check label, threshold and length_unit"
        )


def _check_background(file, map_: Perfusion, values: np.ndarray, volumes: np.ndarray) -> None:
    """Raise `InputError` if much of a map without label and threshold has next to no flow: it is not the wall alone."""
    if map_.label is not None or map_.threshold is not None:
        return
    known = np.isfinite(values)
    order = np.argsort(values[known])
    reached = np.cumsum(volumes[known][order])
    if not len(order) or reached[-1] <= 0:
        return
    low = FAINT * values[known][order][np.searchsorted(reached, 0.99 * reached[-1])]
    share = float(volumes[known][values[known] < low].sum() / reached[-1])
    if share > MOST_FAINT:
        remedy = (
            f"{percent(share)} of the map is below {low:.3g} {map_.unit}, {percent(FAINT)} of its highest values; give "
            "perfusion.label or perfusion.threshold, which select the left ventricular wall"
        )
        raise InputError(file, "perfusion.threshold", None, remedy)


def _check_unit(file, map_: Perfusion, values: np.ndarray, volumes: np.ndarray, tissue_density: float) -> None:
    units = perfusions(tissue_density)
    order = np.argsort(values)
    median = values[order][np.searchsorted(np.cumsum(volumes[order]), volumes.sum() / 2)]
    low, high = PLAUSIBLE_FLOW

    def plausible(unit: str) -> bool:
        return low <= median * units[unit] / MBF_PER_MIN_PER_G <= high

    if not plausible(map_.unit):
        fits = [unit for unit in units if plausible(unit)]
        hint = f"; the values would be plausible in {' or '.join(fits)}" if fits else ""
        shown = median * units[map_.unit] / MBF_PER_MIN_PER_G
        raise InputError(
            file,
            "perfusion.unit",
            map_.unit,
            f"gives a median flow of {shown:.3g} mL/min/g, outside {low} to {high}{hint}",
        )


def _filled(
    path: Path, values: np.ndarray, centres: np.ndarray, invalid: Invalid
) -> tuple[np.ndarray, tuple[str, ...]]:
    from scipy.spatial import cKDTree

    if not invalid.missing + invalid.negative:
        return values, ()
    if invalid.missing + invalid.negative > MOST_INVALID * invalid.among:
        raise InputError(
            path,
            "values",
            str(invalid),
            f"more than {percent(MOST_INVALID)} are invalid; repair the map or restrict it to the wall",
        )
    empty = ~np.isfinite(values) | (values < 0)
    if empty.any():
        _, nearest = cKDTree(centres[~empty]).query(centres[empty])
        values = values.copy()
        values[empty] = values[~empty][nearest]
    return values, (f"{invalid} were filled with the nearest valid value",)
