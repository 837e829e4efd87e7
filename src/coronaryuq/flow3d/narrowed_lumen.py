"""The lumen of samples with narrowings that a search found: what an adopted effect of a vessel in the mesh is in 3D.

The sizes of a sample give the loss by the law of the effect, and the loss the shape (`case.lumen.narrowing`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.lumen.narrowing import Narrowing, diffuse, stenosis
from coronaryuq.case.lumen.profiles import Lumen, lumen_of
from coronaryuq.case.network.build import Physics, shape_integrals
from coronaryuq.case.network.network import Network
from coronaryuq.flow3d.mesh.description import MeshDescription
from coronaryuq.flow3d.narrowed_network import Adopted, Interval, read_narrowed
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.effects.narrowing import DiffuseNarrowing

RESISTANCE, QUADRATIC = "R_poiseuille", "stenosis_coefficient"
POINTS = 201
"""Points along a narrowing, besides those of the centreline, at which its radii are integrated and searched."""


@dataclass(frozen=True)
class NarrowedLumen(Lumen):
    """A lumen, uncertain or not, with narrowings.

    Parameters
    ----------
    tree
        The segmented lumen.
    network
        The 0D loop without the narrowings.
    adopted
        What narrows its vessels.
    physics
        Blood and K_t.
    """

    tree: Tree
    network: Network
    adopted: Sequence[Adopted]
    physics: Physics

    def ratio(self, vessel: str, arc, z: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return true over segmented radius (samples, n) at arc lengths (n,) cm of a tree vessel."""
        if not any(one.place.vessel == vessel for one in self.adopted):
            return super().ratio(vessel, arc, z)
        arc = np.atleast_1d(np.asarray(arc, float))
        rows = [self._drawn(vessel, arc, one, self.shapes(vessel, one)) for one in _samples(self.names, z)]
        return np.array(rows) / self.tree[vessel].radius_at(arc)

    def knots(self, vessel: str) -> list[np.ndarray]:
        """Return arc lengths (n,) cm of a tree vessel, between which the ratio is all but linear."""
        places = [one.place for one in self.adopted if one.place.vessel == vessel]
        return [*super().knots(vessel), *(self._grid(vessel, place.start, place.end) for place in places)]

    def shapes(self, vessel: str, z: Mapping[str, float]) -> list[Narrowing]:
        """Return the narrowings of a tree vessel in one sample; of stenoses, those whose throat is in the mesh."""
        found: list[Narrowing] = []
        for one in self.adopted:
            sizes = one.sizes(z) if one.place.vessel == vessel else None
            if sizes is not None and self._in_mesh(one, sizes):
                found.append(self._shape(one, sizes, z, found))
        return found

    def additions(self, z: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return "BLOCK.parameter" → what the narrowings add to whole 0D vessels by their laws, (samples,)."""
        samples = _samples(self.names, z)
        found: dict[str, np.ndarray] = {}
        for one in self.adopted:
            stores = self.network.vessel_values(one.block).get("C", 0.0) > 0.0
            for k, sample in enumerate(samples):
                sizes = one.sizes(sample)
                for name, value in ({} if sizes is None else self._added(one, sizes)).items():
                    # A vessel that stores blood may have no solution with a strong loss, see `QuadraticLoss`.
                    if not (stores and name == QUADRATIC):
                        found.setdefault(f"{one.block}.{name}", np.zeros(len(samples)))[k] += value
        return found

    def outside(
        self, description: MeshDescription, z: Mapping[str, np.ndarray]
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Return what narrowings multiply the 0D parts of cut vessels by, and what they add to them.

        Both are "PART.parameter" → (samples,). A part outside is as narrow as its share of a shape in the mesh. A
        stenosis whose throat is outside has no shape: its part there has what the law adds.
        """
        samples = _samples(self.names, z)
        factors: dict[str, np.ndarray] = {}
        added: dict[str, np.ndarray] = {}
        for block, place in {one.block: one.place for one in self.adopted}.items():
            if block not in description.cut:
                continue
            cut, (first, last) = description.cut[block], place.meshed
            second = f"{block}_downstream" if cut.upstream is not None else block
            for name, side, start, end in (
                (block, cut.upstream, place.start, first), (second, cut.downstream, last, place.end)
            ):  # fmt: skip
                if side is not None and end > start:
                    rows = [self._narrower(place.vessel, start, end, sample) for sample in samples]
                    factors |= {f"{name}.{key}": np.array([row[key] for row in rows]) for key in rows[0]}
                    added |= self._beside(block, name, start, end, samples)
            if cut.upstream and cut.upstream.get(QUADRATIC) and block not in self.profiles:
                # The entrance from the aorta: the speed at the cap.
                factors[f"{block}.{QUADRATIC}"] = self.ratio(place.vessel, first, z)[:, 0] ** -4.0
        return factors, added

    def _narrower(self, vessel: str, start: float, end: float, z: Mapping[str, float]) -> dict[str, float]:
        """Return what the shapes in the lumen multiply R, L and C of a stretch by."""
        arc = self._grid(vessel, start, end)
        new, old = (shape_integrals(self._drawn(vessel, arc, z, some), arc) for some in (self.shapes(vessel, z), ()))
        fourth, second, mean = (float(a / b) for a, b in zip(new, old, strict=True))
        return {RESISTANCE: fourth, "L": second, "C": mean**2}

    def _beside(
        self, block: str, part: str, start: float, end: float, samples: Sequence[Mapping[str, float]]
    ) -> dict[str, np.ndarray]:
        """Return what stenoses with a throat between two arc lengths, outside the mesh, add to this part."""
        found: dict[str, np.ndarray] = {}
        for one in self.adopted:
            for k, sample in enumerate(samples):
                sizes = one.sizes(sample) if one.block == block else None
                if sizes is None or self._in_mesh(one, sizes) or not start <= sum(self._stretch(one, sizes)) / 2 <= end:
                    continue
                for name, value in self._added(one, sizes).items():
                    found.setdefault(f"{part}.{name}", np.zeros(len(samples)))[k] += value
        return found

    def _in_mesh(self, one: Adopted, sizes: Mapping[str, np.ndarray]) -> bool:
        """Return whether the lumen has a narrowing: all but a stenosis with its throat outside."""
        return one.member.effect == DiffuseNarrowing.name or one.place.has(0.5 * sum(self._stretch(one, sizes)))

    def _shape(
        self, one: Adopted, sizes: dict[str, np.ndarray], z: Mapping[str, float], before: Iterable[Narrowing]
    ) -> Narrowing:
        vessel, added = one.place.vessel, self._added(one, sizes)
        if one.member.effect == DiffuseNarrowing.name:
            arc = self._grid(vessel, one.place.start, one.place.end)
            centre = shape_integrals(self._drawn(vessel, arc, {}, ()), arc)[0]
            share = added[RESISTANCE] / self.network.vessel_values(one.block)[RESISTANCE]
            return diffuse(arc, self._drawn(vessel, arc, z, before), share * float(centre))
        start, end = self._stretch(one, sizes)
        throat = None if (start, end) == one.place.stenosis and one.place.lesion else 0.5 * (start + end)
        arc = self._grid(vessel, start, end)
        return stenosis(arc, self._drawn(vessel, arc, z, before), throat, added[QUADRATIC], self.physics)

    def _stretch(self, one: Adopted, sizes: Mapping[str, np.ndarray]) -> Interval:
        """Return start and end of a stenosis, arc lengths (cm): those of a focal one, or else those of its place."""
        place, law = one.place, one.member.law
        extent = law.extent(one.block, {name: float(size[0]) for name, size in sizes.items()}, self._anatomy(one))
        if extent is None:
            return place.stenosis
        start, end = (float(np.clip(place.start + x, place.start, place.end)) for x in extent[1:])
        return start, end

    def _added(self, one: Adopted, sizes: dict[str, np.ndarray]) -> dict[str, float]:
        """Return what the law of a narrowing adds to the parameters of its 0D vessel."""
        anatomy, own = self._anatomy(one), self.network.vessel_values(one.block)
        state = ConditionState(1.0, anatomy.period, {}, {}, {})
        values = one.member.law.changes(self.network, one.block, sizes, anatomy, state)
        parameters = {target.rpartition(".")[2]: float(np.ravel(value)[0]) for target, value in values.items()}
        return {name: value - own.get(name, 0.0) for name, value in parameters.items()}

    def _anatomy(self, one: Adopted) -> Anatomy:
        return self._anatomies[one.mixture.name]

    @cached_property
    def _anatomies(self) -> dict[str, Anatomy]:
        every = {one.mixture.name: one.mixture.scales for one in self.adopted}
        return {
            name: Anatomy(self.network, scales["pressure"], dict(scales["flow"]), scales["period"])
            for name, scales in every.items()
        }

    def _grid(self, vessel: str, start: float, end: float) -> np.ndarray:
        own = self.tree[vessel].arc
        arc = np.union1d(np.linspace(start, end, POINTS), own[(own > start) & (own < end)])
        return arc[np.r_[True, np.diff(arc) > 1e-9]]

    def _drawn(self, vessel: str, arc: np.ndarray, z: Mapping[str, float], shapes: Iterable[Narrowing]) -> np.ndarray:
        """Return the radii (n,) cm of one sample, with some narrowings."""
        one = {name: np.array([value]) for name, value in z.items()}
        radii = self.tree[vessel].radius_at(arc) * super().ratio(vessel, arc, one)[0]
        for shape in shapes:
            radii = radii * shape.ratio(arc)
        return radii


def narrowed_lumen(network: Network, tree: Tree, file: str | Path = "network") -> NarrowedLumen:
    """Return the lumen of a network with narrowings; raise `InputError` if they are malformed."""
    adopted, physics = read_narrowed(network, tree, file)
    plain = lumen_of(network, file) or Lumen([], {}, {})
    names = [*plain.names, *dict.fromkeys(name for one in adopted for name in one.names)]
    return NarrowedLumen(names, plain.profiles, plain.captured, tree, network, adopted, physics)


def _samples(names: Sequence[str], z: Mapping[str, np.ndarray]) -> list[dict[str, float]]:
    """Return the coordinates of each sample; one sample if none is given."""
    given = {name: np.ravel(z[name]) for name in names if name in z}
    count = max((len(value) for value in given.values()), default=1)
    columns = {name: np.broadcast_to(value, (count,)) for name, value in given.items()}
    return [{name: float(column[k]) for name, column in columns.items()} for k in range(count)]
