"""From the anatomy named in `case.yaml` to a labelled tree: its ends matched to outlets, its stenoses placed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.centrelines import centreline_tree
from coronaryuq.case.anatomy.simvascular import read_project
from coronaryuq.case.anatomy.stenosis_detection import around, tightest
from coronaryuq.case.anatomy.surface import Cap, Surface, read_surface
from coronaryuq.case.anatomy.synthetic_aorta import NAMES, RADIUS, with_aorta
from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, branch_of, read_tree
from coronaryuq.case.description.fields import Description, StenosisPlace
from coronaryuq.case.settings import Settings
from coronaryuq.case.tables.read import OutletRow
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import LENGTHS

FARTHEST = 0.5
"""cm: an outlet's or stenosis's point must be this near to the tree, or twice the local radius if that is more."""
WIDEST_END, THINNEST_END = 0.4, 0.02
"""cm, median radius of the coronary ends: no animal's are wider, and CT shows none that are thinner."""


@dataclass(frozen=True)
class Placed:
    """Which end of the tree is which: outlet name → vessel, systemic boundary condition → vessel; notes on the way."""

    rows: list[OutletRow]
    vessels: dict[str, str]
    systemic: dict[str, str]
    notes: tuple[str, ...] = ()


def read_anatomy(
    file: Path, folder: Path, description: Description, rows: Sequence[OutletRow], settings: Settings
) -> tuple[Tree, tuple[str, ...]]:
    """The tree of a description's anatomy, cm, and notes on what was decided on the way."""
    anatomy = description.anatomy
    scale = LENGTHS[anatomy.unit]
    path = folder / getattr(anatomy, anatomy.kind)
    if anatomy.kind == "centrelines":
        return read_tree(path, scale), ()
    if anatomy.kind == "simvascular":
        return read_project(path, scale)
    if anatomy.kind == "mesh":
        path = path / "mesh-complete.exterior.vtp"
    surface = read_surface(path, scale)
    inlet, ends = _name_caps(file, folder, description, surface, rows)
    tree, notes = centreline_tree(path, surface, inlet, ends, settings.surface_spacing), surface.notes
    valve = None if anatomy.inlet is not None else _end_at_valve(tree, {row.name for row in rows})
    if valve is not None:
        inlet, ends[valve] = ends[valve], inlet
        tree = centreline_tree(path, surface, inlet, ends, settings.surface_spacing)
        notes += (f"surface: the aortic inlet is the end at {inlet}, nearest to the coronary ostia",)
    return tree, notes


def _end_at_valve(tree: Tree, coronary: set[str]) -> str | None:
    """The aortic end that lies nearer to a coronary ostium than the tree's root does, if one does.

    The coronary arteries leave the aorta right above its valve. coronary: names of the ends that are coronary.
    """
    ends = {v.name for v in tree.leaves()}
    feeding = {v.name for v in tree if {w.name for w in tree.subtree(v.name)} & ends <= coronary}
    first = [v for v in tree if v.name in feeding and v.parent is not None and v.parent not in feeding]
    if not first or not ends - coronary:
        return None
    # A path leaves the axis before it is level with the ostium: that lies one aortic radius on.
    ostia = [v.position_at(float(tree[v.parent].radii[-1])) for v in first]

    def away(point: np.ndarray) -> float:
        return float(np.mean([np.linalg.norm(point - ostium) for ostium in ostia]))

    nearest = min(ends - coronary, key=lambda name: away(tree[name].points[-1]))
    return nearest if away(tree[nearest].points[-1]) < away(tree.root.points[0]) else None


def _name_caps(
    file: Path, folder: Path, description: Description, surface: Surface, rows: Sequence[OutletRow]
) -> tuple[Cap, dict[str, Cap]]:
    """The aortic inlet's cap, and name of the vessel that ends there → cap for every other one.

    Coronary caps are those nearest to the outlets' points, systemic ones likewise; of the caps that are left the inlet
    is the one nearest to `anatomy.inlet`, or for now the largest, and the rest are systemic.
    """
    table, scale = folder / description.outlets, LENGTHS[description.anatomy.unit]
    free = list(surface.caps)
    ends: dict[str, Cap] = {}

    def shown(caps: Sequence[Cap]) -> str:
        """Caps in the unit in which the table is to name them."""
        places = [
            "(" + ", ".join(f"{x / scale:.4g}" for x in cap.centre) + f") radius {cap.radius / scale:.3g}"
            for cap in caps
        ]
        return f"{'; '.join(places) or 'none'} ({description.anatomy.unit})"

    def take(where: Path, field: str, point) -> Cap:
        place = np.array(point) * scale
        cap = min(free, key=lambda cap: float(np.linalg.norm(cap.centre - place)), default=None)
        if cap is None or np.linalg.norm(cap.centre - place) > max(FARTHEST, 2 * cap.radius):
            raise InputError(where, field, list(point), f"no free cap of the surface there; caps: {shown(free)}")
        free.remove(cap)
        return cap

    for row in rows:
        if row.point is None:
            raise InputError(
                table, f"x y z of {row.name}", None, f"needed with a surface; its caps: {shown(surface.caps)}"
            )
        ends[row.name] = take(table, f"x y z of {row.name}", row.point)
    for outlet in description.systemic_outlets:
        if outlet.point is not None:
            ends[outlet.vessel or outlet.name.removeprefix("BC_")] = take(
                file, f"systemic_outlets.{outlet.name}.point", outlet.point
            )
    if description.anatomy.inlet is not None:
        inlet = take(file, "anatomy.inlet", description.anatomy.inlet)
    elif free:
        inlet = free.pop(0)
    else:
        raise InputError(file, "anatomy.inlet", None, "no cap is left for the aortic inlet")
    for k, cap in enumerate(free):
        if cap.radius < 2 * max(ends[row.name].radius for row in rows):
            raise InputError(table, "name", shown([cap]), "a cap as small as the coronary ones is no row's; add it")
        ends["aorta_outlet" if k == 0 else f"aorta_outlet{k + 1}"] = cap
    return inlet, ends


def place_outlets(
    file: Path, folder: Path, description: Description, tree: Tree, rows: list[OutletRow]
) -> tuple[Tree, Placed]:
    """Match outlets and systemic outlets to the tree's ends, and label every vessel with its branch."""
    table, scale = folder / description.outlets, LENGTHS[description.anatomy.unit]
    ends = [v.name for v in tree.leaves()]
    vessels: dict[str, str] = {}
    for row in rows:
        taken = set(vessels.values())
        if row.vessel is not None:
            if row.vessel not in ends:
                raise InputError(
                    table, f"vessel of {row.name}", row.vessel, f"no end of the tree; ends: {', '.join(ends)}"
                )
            vessels[row.name] = row.vessel
        elif row.name in ends:
            vessels[row.name] = row.name
        elif row.point is not None:
            vessels[row.name] = _nearest_end(table, f"x y z of {row.name}", tree, ends, np.array(row.point) * scale)
        else:
            raise InputError(table, f"vessel of {row.name}", None, "give vessel, or x, y and z")
        if vessels[row.name] in taken:
            raise InputError(table, row.name, vessels[row.name], "another outlet has this end of the tree already")
    left = [name for name in ends if name not in vessels.values()]
    notes: tuple[str, ...] = ()
    if not left and not description.systemic_outlets:
        tree = _aorta_added(file, tree)
        left = [NAMES[-1]]
        notes = (f"anatomy: holds no aorta; one of radius {RADIUS:g} cm was added, for the 0D loop",)
    systemic = _systemic(file, description, tree, left)
    missing = [name for name in left if name not in systemic.values()]
    if missing:
        raise InputError(table, "vessel", ", ".join(missing), "ends of the tree without an outlet; add them")
    notes += _plausible_size(file, description.anatomy.unit, [float(tree[v].radii[-1]) for v in vessels.values()])
    branches = {vessels[row.name]: row.branch for row in rows}
    return labelled(tree, branches), Placed(rows, vessels, systemic, notes)


def _plausible_size(file: Path, unit: str, radii: list[float]) -> tuple[str, ...]:
    """A note where coronary ends are thinner than any seen by CT; InputError where no heart has such wide ones."""
    usual = float(np.median(radii))
    if usual > WIDEST_END:
        remedy = f"makes the coronary arteries end {usual:.2g} cm in radius; check the unit"
        raise InputError(file, "anatomy.unit", unit, remedy)
    if usual < THINNEST_END:
        return (f"anatomy: in {unit} the coronary arteries end {10 * usual:.2g} mm in radius; check anatomy.unit",)
    return ()


def _aorta_added(file: Path, tree: Tree) -> Tree:
    try:
        return with_aorta(tree)
    except ValueError as error:
        raise InputError(file, "anatomy", None, str(error)) from None


def labelled(tree: Tree, branches: dict[str, str]) -> Tree:
    """The tree with every vessel's branch, by the ends that it feeds (`branch_of`).

    branches: coronary end vessel → LAD, LCx or RCA; other ends are aortic.
    """
    relabelled = []
    for vessel in tree:
        fed = {branches.get(v.name, AORTA) for v in tree.subtree(vessel.name) if not tree.children(v.name)}
        relabelled.append(replace(vessel, branch=branch_of(fed)))
    return Tree(relabelled)


def _systemic(file: Path, description: Description, tree: Tree, left: list[str]) -> dict[str, str]:
    if not description.systemic_outlets:
        if not left:
            raise InputError(file, "systemic_outlets", None, "no end of the tree is left for the aorta")
        return {f"BC_RCR{k + 1}": name for k, name in enumerate(left)}
    scale = LENGTHS[description.anatomy.unit]
    systemic: dict[str, str] = {}
    for outlet in description.systemic_outlets:
        field = f"systemic_outlets.{outlet.name}"
        if outlet.vessel is None and outlet.point is None:
            raise InputError(file, field, None, "give vessel or point")
        if outlet.vessel is not None and outlet.vessel not in left:
            raise InputError(file, field, outlet.vessel, f"no free end of the tree; free: {', '.join(left) or 'none'}")
        systemic[outlet.name] = outlet.vessel or _nearest_end(file, field, tree, left, np.array(outlet.point) * scale)
    if len(set(systemic.values())) != len(systemic):
        raise InputError(file, "systemic_outlets", None, "two of them name the same end of the tree")
    return systemic


def _nearest_end(file: Path, field: str, tree: Tree, ends: list[str], point: np.ndarray) -> str:
    distances = {name: float(np.linalg.norm(tree[name].points[-1] - point)) for name in ends}
    if not distances:
        raise InputError(file, field, point.tolist(), "no end of the tree is left for it")
    name = min(distances, key=distances.__getitem__)
    if distances[name] > max(FARTHEST, 2 * tree[name].radii[-1]):
        raise InputError(
            file, field, point.tolist(), f"(cm) is {distances[name]:.2g} cm from the nearest end of the tree, {name}; "
            "check the point and anatomy.unit",
        )  # fmt: skip
    return name


def place_stenoses(
    file: Path, description: Description, tree: Tree, settings: Settings
) -> tuple[list[Stenosis], tuple[str, ...]]:
    """Stenoses on the tree, from vessel and extent, from points, or found (`auto`), and notes on those found."""
    if description.stenoses == "auto":
        found = tightest(tree, settings.narrowing)
        if not found:
            raise InputError(
                file,
                "stenoses",
                "auto",
                f"no narrowing below an area ratio of {settings.narrowing}; "
                "name a stretch of an artery (vessel, start, end), or write [] for none in 3D",
            )
        return found, tuple(f"stenosis {s.name}: found on {s.vessel}, {s.start:.2f} to {s.end:.2f} cm" for s in found)
    placed = [_stenosis(file, description, tree, wanted) for wanted in description.stenoses if wanted.block is None]
    return placed, ()


def _stenosis(file: Path, description: Description, tree: Tree, wanted: StenosisPlace) -> Stenosis:
    field = f"stenoses.{wanted.name}"
    if wanted.vessel is not None:
        if wanted.vessel not in tree:
            raise InputError(
                file, f"{field}.vessel", wanted.vessel, f"no vessel of the tree; it has {', '.join(tree.vessels)}"
            )
        vessel = tree[wanted.vessel]
        if wanted.end > vessel.length + 1e-6 or wanted.start < tree.emergence(vessel.name) - 1e-6:
            first = tree.emergence(vessel.name)
            raise InputError(
                file, f"{field}.end", wanted.end, f"the vessel runs from {first:.3g} to {vessel.length:.3g} cm"
            )
        stenosis = Stenosis(wanted.name, wanted.vessel, wanted.start, min(wanted.end, vessel.length))
    else:
        point = np.array(wanted.point) * LENGTHS[description.anatomy.unit]
        name, arc, distance = tree.nearest(point, [v.name for v in tree if v.branch == wanted.name])
        if distance > max(FARTHEST, 2 * float(tree[name].radius_at(arc))):
            raise InputError(
                file,
                f"{field}.point",
                wanted.point,
                f"is {distance:.2g} cm from the nearest vessel of the {wanted.name}",
            )
        stenosis = around(tree, wanted.name, name, arc, wanted.length)
    if tree[stenosis.vessel].branch != wanted.name:
        belongs = tree[stenosis.vessel].branch
        raise InputError(file, f"{field}.vessel", stenosis.vessel, f"belongs to the {belongs}, not the {wanted.name}")
    return stenosis
