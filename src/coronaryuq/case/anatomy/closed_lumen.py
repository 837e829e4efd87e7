"""Read a closed lumen as a tree: which of its flat ends is which, in one piece with the aorta or in several without."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.centrelines import centreline_tree
from coronaryuq.case.anatomy.surface import Cap, Surface, read_surfaces
from coronaryuq.case.anatomy.synthetic_aorta import one_tree
from coronaryuq.case.anatomy.tree import AORTA, TRUNK, Tree, branch_of
from coronaryuq.case.description.fields import Anatomy, Description
from coronaryuq.case.settings import Settings
from coronaryuq.case.tables.read import OutletRow
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import LENGTHS

FARTHEST = 0.5
"""cm: largest distance of a point in a table from the cap that it means, or twice the cap's radius if that is more."""
AORTIC = 2.0
"""An end this many times as wide as the widest coronary end is one of the aorta."""


def lumen_tree(
    file: Path, description: Description, anatomy: Anatomy, rows: Sequence[OutletRow], settings: Settings
) -> tuple[Tree, tuple[str, ...]]:
    """Return the tree (cm) of a surface or of a mesh's walls, and notes for the user. `file`: the `case.yaml`.

    A surface with an aorta is one piece. Without one, each piece with a coronary outlet is a tree that begins at the
    widest end that no row names; several are joined by an aorta that is made.
    """
    path = file.parent / anatomy.path
    path = path / "mesh-complete.exterior.vtp" if anatomy.kind == "mesh" else path
    surfaces = read_surfaces(path, LENGTHS[anatomy.unit])
    notes = list(surfaces[0].notes)
    ends = _Ends(file, description, anatomy, surfaces)
    ends.take_those_of(rows)
    used = [k for k in range(len(surfaces)) if any(ends.of(k, row.name) for row in rows)]
    if len(used) < len(surfaces):
        notes.append(f"surface: left out {len(surfaces) - len(used)} pieces without a coronary outlet")
    trees: list[Tree] = []
    for k in used:
        inlet, outlets = ends.inlet_and_outlets(k, rows, alone=len(used) == 1)
        coronary = {row.name for row in rows} & outlets.keys()
        root = AORTA if outlets.keys() - coronary else _root_name(rows, coronary)
        taken = {vessel.name for tree in trees for vessel in tree} | {row.name for row in rows}
        tree = centreline_tree(path, surfaces[k], inlet, outlets, settings.surface_spacing, root, taken)
        valve = None if anatomy.inlet is not None else _end_at_valve(tree, coronary)
        if valve is not None:
            inlet, outlets[valve] = outlets[valve], inlet
            tree = centreline_tree(path, surfaces[k], inlet, outlets, settings.surface_spacing, root, taken)
            notes.append(f"surface: took the end nearest to the coronary ostia, at {inlet}, as the aortic inlet")
        elif root != AORTA:
            notes.append(f"surface: has no aorta; took the end at {inlet} as the ostium of {tree.root.name}")
        trees.append(tree)
    return one_tree(path, trees, notes), tuple(notes)


def _root_name(rows: Sequence[OutletRow], coronary: set[str]) -> str:
    """Return the name of the first vessel of a coronary tree: its artery, or the trunk of several."""
    branch = branch_of({row.branch for row in rows if row.name in coronary})
    return f"{branch}_ostium" if branch not in ("LM", TRUNK) else branch


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


class _Ends:
    """The caps of all pieces, and what is known of each."""

    def __init__(self, file: Path, description: Description, anatomy: Anatomy, surfaces: Sequence[Surface]):
        self.file, self.description, self.anatomy = file, description, anatomy
        self.table, self.scale = file.parent / description.outlets, LENGTHS[anatomy.unit]
        self.free = [(k, cap) for k, surface in enumerate(surfaces) for cap in surface.caps]
        self.all = [cap for _, cap in self.free]
        self.taken: dict[str, tuple[int, Cap]] = {}
        self.inlet: tuple[int, Cap] | None = None

    def take_those_of(self, rows: Sequence[OutletRow]) -> None:
        """Assign the caps that the tables and the anatomy name by a point."""
        for row in rows:
            if row.point is None:
                remedy = f"missing; a surface needs them. Its caps: {self.shown(self.all)}"
                raise InputError(self.table, f"x y z of {row.name}", None, remedy)
            self.taken[row.name] = self._nearest(self.table, f"x y z of {row.name}", row.point)
        for outlet in self.description.systemic_outlets:
            if outlet.point is not None:
                name, field = outlet.vessel or outlet.name.removeprefix("BC_"), f"systemic_outlets.{outlet.name}.point"
                self.taken[name] = self._nearest(self.file, field, outlet.point)
        if self.anatomy.inlet is not None:
            self.inlet = self._nearest(self.file, "anatomy.inlet", self.anatomy.inlet)

    def of(self, piece: int, name: str) -> bool:
        """Return whether the cap of this name is one of the piece."""
        return self.taken[name][0] == piece

    def inlet_and_outlets(self, piece: int, rows: Sequence[OutletRow], alone: bool) -> tuple[Cap, dict[str, Cap]]:
        """Return the inlet of a piece, and its other caps by the vessel that ends there.

        The inlet is the largest cap that nothing names, if `anatomy.inlet` does not name one. The others have to be
        aortic, and then the piece has to be alone.
        """
        free = [cap for k, cap in self.free if k == piece]
        outlets = {name: cap for name, (k, cap) in self.taken.items() if k == piece}
        if self.inlet is not None and self.inlet[0] == piece:
            inlet = self.inlet[1]
        elif free:
            inlet = free.pop(0)
        else:
            near = next(iter(outlets))
            remedy = f"every end of the lumen is an outlet, none is left for the inlet of the piece that ends at {near}"
            raise InputError(self.file, "anatomy.inlet", None, remedy)
        widest = max(cap.radius for name, cap in outlets.items() if name in {row.name for row in rows})
        for k, cap in enumerate(free):
            if cap.radius < AORTIC * widest:
                remedy = "no row of the table matches this coronary-sized cap; add one"
                raise InputError(self.table, "name", self.shown([cap]), remedy)
            outlets["aorta_outlet" if k == 0 else f"aorta_outlet{k + 1}"] = cap
        if free and not alone:
            remedy = (
                "the piece of the surface with this aortic end is not connected with the other coronary outlets; close "
                "the gap, or leave the aorta out"
            )
            raise InputError(self.file, "anatomy.surface", self.shown(free), remedy)
        return inlet, outlets

    def shown(self, caps: Sequence[Cap]) -> str:
        """List caps in the length unit of the table."""
        entries = [
            "(" + ", ".join(f"{x / self.scale:.4g}" for x in cap.centre) + f") radius {cap.radius / self.scale:.3g}"
            for cap in caps
        ]
        return f"{'; '.join(entries) or 'none'} ({self.anatomy.unit})"

    def _nearest(self, source: Path, field: str, point) -> tuple[int, Cap]:
        position = np.array(point) * self.scale
        found = min(self.free, key=lambda entry: float(np.linalg.norm(entry[1].centre - position)), default=None)
        if found is None or np.linalg.norm(found[1].centre - position) > max(FARTHEST, 2 * found[1].radius):
            remedy = (
                f"the surface has no unassigned cap there; unassigned caps: {self.shown([cap for _, cap in self.free])}"
            )
            raise InputError(source, field, list(point), remedy)
        self.free = [entry for entry in self.free if entry[1] is not found[1]]
        return found
