"""Perfusion territories: each LV point belongs to its nearest outlet among those that perfuse the LV."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from coronaryuq.case.case_json import CaseOutlet, CaseSummary
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.vtk import read_vtk


@dataclass(frozen=True)
class Ventricle:
    """The LV wall: points (n, 3) in cm, volumes (n,) in cm3, baseline flow of each point (n,) in mL/s."""

    points: np.ndarray
    volumes: np.ndarray
    flows: np.ndarray

    @classmethod
    def read(cls, lv_vtu: str | Path, tissue_density: float) -> "Ventricle":
        """Read the LV wall from `lv.vtu`.

        Parameters
        ----------
        lv_vtu : str or Path
            Cells with `Volume` (cm3) and `MBF` (mL/s per g).
        tissue_density : float
            g/mL; a cell's flow is MBF x volume x density.

        Returns
        -------
        Ventricle
            One point per cell.

        Raises
        ------
        InputError
            If an array is missing, or a value is negative or not finite.
        """
        mesh = read_vtk(lv_vtu)
        for name in ("Volume", "MBF"):
            if name not in mesh.cell_data:
                raise InputError(
                    lv_vtu, name, None, f"cell data missing; the file has {', '.join(mesh.cell_data.keys())}"
                )
        volumes = np.asarray(mesh.cell_data["Volume"], dtype=float)
        mbf = np.asarray(mesh.cell_data["MBF"], dtype=float)
        for name, values in (("Volume", volumes), ("MBF", mbf)):
            invalid = np.flatnonzero(~(np.isfinite(values) & (values >= 0)))
            if invalid.size:
                raise InputError(
                    lv_vtu, f"{name}[{invalid[0]}]", float(values[invalid[0]]),
                    f"{invalid.size} cells are negative or not finite; run the case stage again",
                )  # fmt: skip
        points = np.ascontiguousarray(mesh.cell_centers().points, dtype=float)
        return cls(points, volumes, mbf * volumes * tissue_density)


def perfusing_outlets(case: CaseSummary, case_json: str | Path) -> list[CaseOutlet]:
    """Return the outlets of the case that perfuse the LV, in the case's order; `InputError` if there are none."""
    if not case.lv_outlets:
        raise InputError(case_json, "outlets", None, "no outlet perfuses the LV; set `perfuses: LV` on those that do")
    return case.lv_outlets


def distances_to_points(points: np.ndarray, centres: ArrayLike) -> np.ndarray:
    """Return the distance (n, k), cm, of `points` (n, 3) to outlet `centres` (k, 3)."""
    from scipy.spatial.distance import cdist

    return cdist(points, np.array(centres, dtype=float))


def distances_to_centrelines(points: np.ndarray, outlets: Sequence[CaseOutlet], tree_vtp: str | Path) -> np.ndarray:
    """Return the distance (n, k), cm, of `points` (n, 3) to the centreline of each outlet's own vessel.

    The centreline is resampled finely (0.02 cm), and the nearest sample counts as its nearest point.
    """
    from scipy.spatial import cKDTree

    lines = _centrelines(tree_vtp)
    columns = []
    for outlet in outlets:
        if outlet.vessel not in lines:
            raise InputError(tree_vtp, "VesselName", outlet.vessel, f"no centreline of outlet {outlet.name}")
        columns.append(cKDTree(_resampled(lines[outlet.vessel], 0.02)).query(points)[0])
    return np.stack(columns, axis=1)


def weighted_distances(distances: np.ndarray, outlets: Sequence[CaseOutlet], radius_power: float) -> np.ndarray:
    """Divide distances by (radius / mean radius)^power: a larger vessel reaches farther (Di Gregorio et al. 2021)."""
    radii = np.array([outlet.radius for outlet in outlets], dtype=float)
    return distances / (radii / radii.mean()) ** radius_power


def nearest_outlets(
    distances: np.ndarray, volumes: np.ndarray, outlets: Sequence[CaseOutlet], case_json: str | Path
) -> np.ndarray:
    """Return the index (points,) of the nearest outlet; raise `InputError` for an outlet without any volume."""
    territory = np.argmin(distances, axis=1)
    share = np.bincount(territory, weights=volumes, minlength=len(outlets))
    for outlet, volume in zip(outlets, share, strict=True):
        if volume <= 0:
            raise InputError(
                case_json, f"outlets.{outlet.name}", outlet.point,
                "its perfusion territory is empty: no LV point is nearest to it; "
                "check its position and unit, or set `perfuses` to RV or septum",
            )  # fmt: skip
    return territory


def _centrelines(tree_vtp: str | Path) -> dict[str, np.ndarray]:
    import pyvista

    if not Path(tree_vtp).is_file():
        raise InputError(tree_vtp, None, None, "no such file; `distance_to: centreline` needs the case's tree")
    tree = pyvista.read(tree_vtp)
    if "VesselName" not in tree.cell_data:
        raise InputError(tree_vtp, "VesselName", None, "cell data missing")
    names = [str(name) for name in tree.cell_data["VesselName"]]
    return {name: np.asarray(tree.get_cell(i).points, dtype=float) for i, name in enumerate(names)}


def _resampled(line: np.ndarray, spacing: float) -> np.ndarray:
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    samples = np.linspace(0.0, arc[-1], max(2, int(np.ceil(arc[-1] / spacing)) + 1))
    return np.stack([np.interp(samples, arc, line[:, axis]) for axis in range(3)], axis=1)
