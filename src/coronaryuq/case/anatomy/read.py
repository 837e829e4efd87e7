"""Read the anatomy of `case.yaml` as a labelled tree; match its ends to outlets and place its stenoses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.centreline_files import read_centrelines
from coronaryuq.case.anatomy.centrelines import centreline_tree
from coronaryuq.case.anatomy.simvascular import read_project
from coronaryuq.case.anatomy.stenosis_detection import detected_stenoses, stenosis_at
from coronaryuq.case.anatomy.surface import Cap, Surface, read_surface
from coronaryuq.case.anatomy.synthetic_aorta import NAMES, RADIUS, with_aorta
from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, branch_of
from coronaryuq.case.description.fields import ARTERIES, Anatomy, Description, StenosisPlace
from coronaryuq.case.settings import Settings
from coronaryuq.case.tables.read import OutletRow
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import LENGTHS

FARTHEST = 0.5
"""cm: largest distance of an outlet's or stenosis's point from the tree, or twice the local radius if that is more."""
WIDEST_END, THINNEST_END = 0.4, 0.02
"""cm: plausible median radius of the coronary ends. Wider ones do not exist, thinner ones are not visible in CT."""


@dataclass(frozen=True)
class PlacedOutlets:
    """Ends of the tree: outlet name → vessel, systemic boundary condition → vessel; notes for the user."""

    rows: list[OutletRow]
    vessels: dict[str, str]
    systemic: dict[str, str]
    notes: tuple[str, ...] = ()


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
    if anatomy.kind == "mesh":
        path = path / "mesh-complete.exterior.vtp"
    surface = read_surface(path, scale)
    inlet, ends = _name_caps(file, description, anatomy, surface, rows)
    tree, notes = centreline_tree(path, surface, inlet, ends, settings.surface_spacing), surface.notes
    valve = None if anatomy.inlet is not None else _end_at_valve(tree, {row.name for row in rows})
    if valve is not None:
        inlet, ends[valve] = ends[valve], inlet
        tree = centreline_tree(path, surface, inlet, ends, settings.surface_spacing)
        notes += (f"surface: took the end nearest to the coronary ostia, at {inlet}, as the aortic inlet",)
    return tree, notes


def _end_at_valve(tree: Tree, coronary: set[str]) -> str | None:
    """Return the aortic end that lies nearer to the coronary ostia than the tree's root, if there is one.

    The coronary arteries leave the aorta right above its valve. coronary: names of the coronary ends.
    """
    ends = {v.name for v in tree.leaves()}
    feeding = {v.name for v in tree if {w.name for w in tree.subtree(v.name)} & ends <= coronary}
    parents = {v.name: v.parent for v in tree if v.name in feeding and v.parent is not None and v.parent not in feeding}
    if not parents or not ends - coronary:
        return None
    # A centreline leaves the aortic axis upstream of its ostium, which lies one aortic radius further on.
    ostia = [tree[name].position_at(float(tree[parent].radii[-1])) for name, parent in parents.items()]

    def mean_distance(point: np.ndarray) -> float:
        return float(np.mean([np.linalg.norm(point - ostium) for ostium in ostia]))

    nearest = min(ends - coronary, key=lambda name: mean_distance(tree[name].points[-1]))
    return nearest if mean_distance(tree[nearest].points[-1]) < mean_distance(tree.root.points[0]) else None


def _name_caps(
    file: Path, description: Description, anatomy: Anatomy, surface: Surface, rows: Sequence[OutletRow]
) -> tuple[Cap, dict[str, Cap]]:
    """Return the cap of the aortic inlet, and the other caps by the vessel that ends there.

    Coronary and systemic caps are those nearest to the outlets' points. Among the others, the inlet is the one nearest
    to `anatomy.inlet` or, for now, the largest; the rest are systemic.
    """
    table, scale = file.parent / description.outlets, LENGTHS[anatomy.unit]
    free = list(surface.caps)
    ends: dict[str, Cap] = {}

    def shown(caps: Sequence[Cap]) -> str:
        """List caps in the length unit of the table."""
        entries = [
            "(" + ", ".join(f"{x / scale:.4g}" for x in cap.centre) + f") radius {cap.radius / scale:.3g}"
            for cap in caps
        ]
        return f"{'; '.join(entries) or 'none'} ({anatomy.unit})"

    def take_nearest(source: Path, field: str, point) -> Cap:
        position = np.array(point) * scale
        cap = min(free, key=lambda cap: float(np.linalg.norm(cap.centre - position)), default=None)
        if cap is None or np.linalg.norm(cap.centre - position) > max(FARTHEST, 2 * cap.radius):
            raise InputError(
                source,
                field,
                list(point),
                f"the surface has no unassigned cap there; unassigned caps: {shown(free)}",
            )
        free.remove(cap)
        return cap

    for row in rows:
        if row.point is None:
            raise InputError(
                table, f"x y z of {row.name}", None, f"missing; a surface needs them. Its caps: {shown(surface.caps)}"
            )
        ends[row.name] = take_nearest(table, f"x y z of {row.name}", row.point)
    for outlet in description.systemic_outlets:
        if outlet.point is not None:
            ends[outlet.vessel or outlet.name.removeprefix("BC_")] = take_nearest(
                file, f"systemic_outlets.{outlet.name}.point", outlet.point
            )
    if anatomy.inlet is not None:
        inlet = take_nearest(file, "anatomy.inlet", anatomy.inlet)
    elif free:
        inlet = free.pop(0)
    else:
        raise InputError(file, "anatomy.inlet", None, "no cap is left for the aortic inlet")
    for k, cap in enumerate(free):
        if cap.radius < 2 * max(ends[row.name].radius for row in rows):
            raise InputError(
                table, "name", shown([cap]), "no row of the table matches this coronary-sized cap; add one"
            )
        ends["aorta_outlet" if k == 0 else f"aorta_outlet{k + 1}"] = cap
    return inlet, ends


def place_outlets(
    file: Path, description: Description, tree: Tree, rows: list[OutletRow]
) -> tuple[Tree, PlacedOutlets]:
    """Match outlets and systemic outlets to the tree's ends, and label every vessel with its branch."""
    table, scale = file.parent / description.outlets, LENGTHS[description.length_unit]
    ends = [v.name for v in tree.leaves()]
    vessels: dict[str, str] = {}
    for row in rows:
        taken = set(vessels.values())
        if row.vessel is not None:
            if row.vessel not in ends:
                raise InputError(
                    table,
                    f"vessel of {row.name}",
                    row.vessel,
                    f"not an end of the tree; its ends are {', '.join(ends)}",
                )
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
    notes: tuple[str, ...] = ()
    if not unassigned and not description.systemic_outlets:
        tree = _aorta_added(file, tree)
        unassigned = [NAMES[-1]]
        notes = (f"anatomy: has no aorta; added one of radius {RADIUS:g} cm for the 0D loop",)
    systemic = _systemic(file, description, tree, unassigned)
    missing = [name for name in unassigned if name not in systemic.values()]
    if missing:
        raise InputError(
            table, "vessel", ", ".join(missing), "these ends of the tree have no outlet; add them to the table"
        )
    notes += _plausible_size(file, description.length_unit, [float(tree[v].radii[-1]) for v in vessels.values()])
    branches = {vessels[row.name]: row.branch for row in rows}
    return labelled(tree, branches), PlacedOutlets(rows, vessels, systemic, notes)


def _plausible_size(file: Path, unit: str, radii: list[float]) -> tuple[str, ...]:
    """Return a note if coronary ends are thinner than CT shows; raise InputError if they are too wide for any heart."""
    median = float(np.median(radii))
    if median > WIDEST_END:
        remedy = f"gives the coronary ends a median radius of {median:.2g} cm; check the unit"
        raise InputError(file, "anatomy.unit", unit, remedy)
    if median < THINNEST_END:
        return (
            f"anatomy: in {unit}, the median radius of the coronary ends is {10 * median:.2g} mm; check anatomy.unit",
        )
    return ()


def _aorta_added(file: Path, tree: Tree) -> Tree:
    try:
        return with_aorta(tree)
    except ValueError as error:
        raise InputError(file, "anatomy", None, str(error)) from None


def labelled(tree: Tree, branches: Mapping[str, str]) -> Tree:
    """Return the tree with every vessel labelled by the ends downstream of it (`branch_of`).

    branches: coronary end vessel → LAD, LCx or RCA; other ends are aortic.
    """
    relabelled = []
    for vessel in tree:
        fed = {branches.get(v.name, AORTA) for v in tree.subtree(vessel.name) if not tree.children(v.name)}
        relabelled.append(replace(vessel, branch=branch_of(fed)))
    return Tree(relabelled)


def _systemic(file: Path, description: Description, tree: Tree, unassigned: list[str]) -> dict[str, str]:
    if not description.systemic_outlets:
        if not unassigned:
            raise InputError(file, "systemic_outlets", None, "no end of the tree is left for the aorta")
        return {f"BC_RCR{k + 1}": name for k, name in enumerate(unassigned)}
    scale = LENGTHS[description.length_unit]
    systemic: dict[str, str] = {}
    for outlet in description.systemic_outlets:
        field = f"systemic_outlets.{outlet.name}"
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
    file: Path, description: Description, tree: Tree, settings: Settings
) -> tuple[list[Stenosis], tuple[str, ...]]:
    """Return the stenoses of the description, or those detected (`auto`), and notes on the detected ones."""
    if description.stenoses == "auto":
        detected = detected_stenoses(tree, settings.narrowing, settings.serial)
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
