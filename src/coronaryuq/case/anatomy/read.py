"""Read the anatomy of `case.yaml` as a labelled tree; match its ends to outlets and place its stenoses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.centreline_files import read_centrelines
from coronaryuq.case.anatomy.closed_lumen import AORTIC, lumen_tree
from coronaryuq.case.anatomy.simvascular import read_project
from coronaryuq.case.anatomy.stenosis_detection import detected_stenoses, stenosis_at
from coronaryuq.case.anatomy.synthetic_aorta import is_aorta, note_of, with_aorta
from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, branch_of
from coronaryuq.case.description.fields import ARTERIES, Anatomy, Description, StenosisPlace
from coronaryuq.case.settings import Settings
from coronaryuq.case.tables.read import BRANCHES, OutletRow
from coronaryuq.core.errors import InputError, meant
from coronaryuq.core.units import LENGTHS

FARTHEST = 0.5
"""cm: largest distance of an outlet's or stenosis's point from the tree, or twice the local radius if that is more."""
WIDEST = 2.5
"""cm: a radius that no coronary aneurysm reaches; those of 2 cm across are called giant."""
WIDEST_END, THINNEST_END = 0.4, 0.02
"""cm: plausible median radius of the coronary ends. Wider ones do not exist, thinner ones are not visible in CT."""

INVISIBLE = 0.002
"""cm: median radius of the coronary ends below which they are arterioles, or the unit is wrong."""


@dataclass(frozen=True)
class PlacedOutlets:
    """Ends of the tree: outlet name → vessel, systemic boundary condition → vessel; notes for the user."""

    rows: list[OutletRow]
    vessels: dict[str, str]
    systemic: dict[str, str]
    notes: tuple[str, ...] = ()

    @property
    def labels(self) -> dict[str, str]:
        """Vessel of a coronary end → label of its outlet."""
        return {self.vessels[row.name]: row.label for row in self.rows}


def read_anatomy(
    file: Path, description: Description, anatomy: Anatomy, rows: Sequence[OutletRow], settings: Settings
) -> tuple[Tree, tuple[str, ...]]:
    """Return the tree (cm) of the anatomy, and notes for the user. `file`: the `case.yaml`, named in errors."""
    scale = LENGTHS[anatomy.unit]
    path = file.parent / anatomy.path
    if anatomy.kind == "centrelines":
        return read_centrelines(path, scale)
    if anatomy.kind == "simvascular":
        return read_project(path, scale, anatomy.groups)
    return lumen_tree(file, description, anatomy, rows, settings)


def place_outlets(
    file: Path, description: Description, tree: Tree, rows: list[OutletRow], known: Sequence[str] = ()
) -> tuple[Tree, PlacedOutlets]:
    """Match outlets and systemic outlets to the tree's ends, and label every vessel with its branch.

    known: notes of the anatomy's reader, one of which may say why a vessel is missing.
    """
    table, scale = file.parent / description.outlets, LENGTHS[description.length_unit]
    ends = [v.name for v in tree.leaves()]
    vessels: dict[str, str] = {}
    for row in rows:
        taken = set(vessels.values())
        if row.vessel is not None:
            if row.vessel not in ends:
                near = meant(row.vessel, ends)
                remedy = (
                    f"not an end of the tree; {f'did you mean {near}? ' if near else ''}its ends are {', '.join(ends)}"
                )
                reasons = [note for note in known if row.vessel in note.replace(",", " ").split()]
                raise InputError(table, f"vessel of {row.name}", row.vessel, "; ".join([remedy, *reasons]))
            vessels[row.name] = row.vessel
        elif row.name in ends:
            vessels[row.name] = row.name
        elif row.point is not None:
            vessels[row.name] = _nearest_end(table, f"x y z of {row.name}", tree, ends, np.array(row.point) * scale)
        else:
            raise InputError(table, f"vessel of {row.name}", None, "give vessel, or x, y and z")
        if vessels[row.name] in taken:
            raise InputError(table, row.name, vessels[row.name], "another outlet is already at this end of the tree")
    unassigned = [name for name in ends if name not in vessels.values()]
    notes = _plausible_size(file, description.length_unit, [float(tree[v].radii[-1]) for v in vessels.values()])
    _check_none_aortic(table, tree, vessels)
    notes += _other_labels(tree, rows, vessels)
    if not unassigned and not description.systemic_outlets:
        whole = with_aorta([tree])
        notes, tree = (note_of(whole, [tree]), *notes), whole
        unassigned = [vessel.name for vessel in tree.leaves() if vessel.made]
    if not description.systemic_outlets:
        _check_aortic(table, tree, unassigned, max(float(tree[v].radii[-1]) for v in vessels.values()))
    systemic = _systemic(file, description, tree, unassigned, {row.bc: row.name for row in rows})
    missing = [name for name in unassigned if name not in systemic.values()]
    if missing:
        raise InputError(
            table, "vessel", ", ".join(missing), "these ends of the tree have no outlet; add them to the table"
        )
    branches = {vessels[row.name]: row.branch for row in rows}
    tree = labelled(tree, branches)
    _check_widest(file, tree)
    notes += _two_ostia(tree, branches)
    return tree, PlacedOutlets(rows, vessels, systemic, notes)


def _check_widest(file: Path, tree: Tree) -> None:
    """Raise InputError for a coronary artery that is wider anywhere than the largest aneurysms."""
    for vessel in tree:
        widest = float(vessel.radii.max())
        if vessel.branch != AORTA and widest > WIDEST:
            place = float(vessel.arc[int(np.argmax(vessel.radii))])
            found = f"{vessel.name} has a radius of {widest:.3g} cm at {place:.2g} cm along it"
            raise InputError(file, "anatomy", None, f"{found}; no coronary artery is that wide: check that point")


def _two_ostia(tree: Tree, branches: Mapping[str, str]) -> tuple[str, ...]:
    """Return a note for a branch whose outlets are fed from several ostia, one of them shared with another branch."""
    fed = []
    for vessel in tree:
        if vessel.branch != AORTA and (vessel.parent is None or tree[vessel.parent].branch == AORTA):
            fed.append([end.name for end in tree.subtree(vessel.name) if end.name in branches])
    notes = []
    for branch in dict.fromkeys(branches.values()):
        parts = [[name for name in ends if branches[name] == branch] for ends in fed]
        several = [part for part in parts if part]
        mixed = any(part and len(part) < len(ends) for part, ends in zip(parts, fed, strict=True))
        if len(several) > 1 and mixed:
            ends = " and ".join(", ".join(part) for part in several)
            notes.append(f"outlets of branch {branch} are fed from {len(several)} ostia ({ends}); check their branch")
    return tuple(notes)


def _check_none_aortic(table: Path, tree: Tree, vessels: Mapping[str, str]) -> None:
    """Raise InputError for an outlet at an end that is as wide as the aorta."""
    for name, vessel in vessels.items():
        if is_aorta(tree[vessel]):
            width = f"{20 * np.median(tree[vessel].radii):.2g} mm"
            remedy = f"is {width} wide, as an aorta; if it is one, delete its row, else check its radii"
            raise InputError(table, f"vessel of {name}", vessel, remedy)


def _other_labels(tree: Tree, rows: Sequence[OutletRow], vessels: Mapping[str, str]) -> tuple[str, ...]:
    """Return a note for each outlet whose vessel the anatomy's file gives to another artery than the table does."""
    given = [(row, tree[vessels[row.name]].branch) for row in rows]
    return tuple(
        f"outlet {row.name}: took branch {row.branch} of the table; the anatomy's file says {stated}"
        for row, stated in given
        if stated in BRANCHES and stated != row.branch
    )


def _check_aortic(table: Path, tree: Tree, ends: Sequence[str], widest: float) -> None:
    """Raise InputError for an end without a row that is not wide enough to be one of the aorta."""
    for name in ends:
        radius = float(tree[name].radii[-1])
        if not tree[name].made and radius < AORTIC * widest:
            remedy = (
                f"this end of the tree, of radius {10 * radius:.2g} mm, has no outlet; add a row, or name it under "
                "systemic_outlets if it is one of the aorta"
            )
            raise InputError(table, "vessel", name, remedy)


def _plausible_size(file: Path, unit: str, radii: list[float]) -> tuple[str, ...]:
    """Return a note if coronary ends are thinner than CT shows; raise InputError if they are too wide for any heart."""
    median = float(np.median(radii))
    if median > WIDEST_END:
        remedy = f"gives the coronary ends a median radius of {median:.2g} cm; check the unit"
        raise InputError(file, "anatomy.unit", unit, remedy)
    if median < INVISIBLE:
        remedy = f"gives the coronary ends a median radius of {10 * median:.2g} mm; check the unit"
        raise InputError(file, "anatomy.unit", unit, remedy)
    if median < THINNEST_END:
        return (
            f"anatomy: in {unit}, the median radius of the coronary ends is {10 * median:.2g} mm; check anatomy.unit",
        )
    return ()


def labelled(tree: Tree, branches: Mapping[str, str]) -> Tree:
    """Return the tree with every vessel labelled by the ends downstream of it (`branch_of`).

    branches: coronary end vessel → LAD, LCx or RCA; other ends are aortic.
    """
    relabelled = []
    for vessel in tree:
        fed = {branches.get(v.name, AORTA) for v in tree.subtree(vessel.name) if not tree.children(v.name)}
        relabelled.append(replace(vessel, branch=branch_of(fed)))
    return Tree(relabelled)


def _systemic(
    file: Path, description: Description, tree: Tree, unassigned: list[str], beds: Mapping[str, str]
) -> dict[str, str]:
    """Return boundary condition → aortic end; beds: boundary condition → coronary outlet that has it."""
    if not description.systemic_outlets:
        if not unassigned:
            raise InputError(file, "systemic_outlets", None, "no end of the tree is left for the aorta")
        free = (name for k in count(1) if (name := f"BC_RCR{k}") not in beds)
        return dict(zip(free, unassigned, strict=False))
    scale = LENGTHS[description.length_unit]
    systemic: dict[str, str] = {}
    for outlet in description.systemic_outlets:
        field = f"systemic_outlets.{outlet.name}"
        if outlet.name in systemic or outlet.name in beds:
            owner = f"outlet {beds[outlet.name]}" if outlet.name in beds else "another systemic outlet"
            raise InputError(file, "systemic_outlets.name", outlet.name, f"{owner} has this name; give each its own")
        if outlet.vessel is None and outlet.point is None:
            raise InputError(file, field, None, "give vessel or point")
        if outlet.vessel is not None and outlet.vessel not in unassigned:
            remedy = f"not an unassigned end of the tree; unassigned: {', '.join(unassigned) or 'none'}"
            raise InputError(file, field, outlet.vessel, remedy)
        systemic[outlet.name] = outlet.vessel or _nearest_end(
            file, field, tree, unassigned, np.array(outlet.point) * scale
        )
    if len(set(systemic.values())) != len(systemic):
        raise InputError(file, "systemic_outlets", None, "two of them are at the same end of the tree")
    return systemic


def _nearest_end(file: Path, field: str, tree: Tree, ends: list[str], point: np.ndarray) -> str:
    distances = {name: float(np.linalg.norm(tree[name].points[-1] - point)) for name in ends}
    if not distances:
        raise InputError(file, field, point.tolist(), "no end of the tree is unassigned")
    name = min(distances, key=distances.__getitem__)
    if distances[name] > max(FARTHEST, 2 * tree[name].radii[-1]):
        raise InputError(
            file, field, point.tolist(), f"(cm) lies {distances[name]:.2g} cm from {name}, the nearest end of the "
            "tree; check the point and anatomy.unit",
        )  # fmt: skip
    return name


def place_stenoses(
    file: Path, description: Description, tree: Tree, labels: Mapping[str, str], settings: Settings
) -> tuple[list[Stenosis], tuple[str, ...]]:
    """Return the stenoses of the description, or those detected (`auto`), and notes on the detected ones.

    labels: vessel that ends in an outlet → label of the outlet, by which side branches are named.
    """
    if description.stenoses == "auto":
        detected = detected_stenoses(tree, settings.narrowing, settings.serial, labels)
        if not detected:
            raise InputError(
                file,
                "stenoses",
                "auto",
                f"no narrowing has an area ratio below {settings.narrowing}; "
                "name a stretch of an artery (vessel, start, end), or write [] to do without 3D runs",
            )
        notes = (f"stenosis {s.name}: found on {s.vessel}, {s.start:.2f} to {s.end:.2f} cm" for s in detected)
        return detected, tuple(notes)
    placed = [_stenosis(file, description, tree, place) for place in description.stenoses if place.block is None]
    return placed, ()


def _stenosis(file: Path, description: Description, tree: Tree, place: StenosisPlace) -> Stenosis:
    field = f"stenoses.{place.name}"
    if place.vessel is not None and place.start is not None and place.end is not None:
        if place.vessel not in tree:
            raise InputError(
                file, f"{field}.vessel", place.vessel, f"no such vessel; the tree has {', '.join(tree.vessels)}"
            )
        vessel = tree[place.vessel]
        if place.end > vessel.length + 1e-6 or place.start < tree.emergence(vessel.name) - 1e-6:
            first = tree.emergence(vessel.name)
            raise InputError(
                file, f"{field}.end", place.end, f"the vessel runs from {first:.3g} to {vessel.length:.3g} cm"
            )
        stenosis = Stenosis(place.name, place.vessel, place.start, min(place.end, vessel.length))
    else:
        point = np.array(place.point) * LENGTHS[description.length_unit]
        arteries = (place.stated_artery,) if place.stated_artery else ARTERIES
        name, arc, distance = tree.nearest(point, [v.name for v in tree if v.branch in arteries])
        if distance > max(FARTHEST, 2 * float(tree[name].radius_at(arc))):
            raise InputError(
                file,
                f"{field}.point",
                place.point,
                f"lies {distance:.2g} cm from the nearest vessel of the {place.stated_artery or 'coronary tree'}",
            )
        stenosis = stenosis_at(tree, place.name, name, arc, place.length)
    belongs, stated = tree[stenosis.vessel].branch, place.stated_artery
    if stated is not None and belongs != stated:
        raise InputError(file, f"{field}.vessel", stenosis.vessel, f"belongs to the {belongs}, not the {stated}")
    if belongs not in ARTERIES:
        raise InputError(
            file, f"{field}.vessel", stenosis.vessel, f"belongs to the {belongs}; choose a coronary artery"
        )
    return stenosis
