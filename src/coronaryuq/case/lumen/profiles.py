"""The uncertain radius of every 0D vessel, as it travels in a network file, and the element values that follow from it.

The part `lumen` of a network, which svZeroDSolver does not know, has one profile per coronary 0D vessel. Element values
change by the rules that built them (`case.network.build`), as factors on the values that the network has, which are
those at the coordinates' centre, zero: a network whose losses were tuned or learnt keeps them there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.lumen.law import LumenLaw, VesselLaw
from coronaryuq.case.lumen.throat_loss import throat_loss
from coronaryuq.case.network.build import Segment, shape_integrals
from coronaryuq.case.network.entrances import entrance_share
from coronaryuq.case.network.network import LUMEN, UNCERTAIN, Network
from coronaryuq.core.io.typed import checked


@dataclass(frozen=True)
class Profile:
    """Radius along one 0D vessel: tree vessel, segmented `radii` (n,) cm at the knots of its law, and what it is.

    stenosis: whether the 0D vessel has the loss of a stenosis. entrance: fraction of its stenosis coefficient that
    stands for its entrance from the aorta, on the segmented lumen.
    """

    vessel: str
    radii: np.ndarray
    law: VesselLaw
    stenosis: bool = False
    entrance: float = 0.0

    def between(self, start: float, end: float) -> "Profile":
        """Return the part between two arc lengths (cm) of the tree vessel, without a stenosis or an entrance."""
        arc = self.law.arc
        arc = np.concatenate([[start], arc[(arc > start + 1e-9) & (arc < end - 1e-9)], [end]])
        columns = {name: np.interp(arc, self.law.arc, column) for name, column in self.law.columns.items()}
        law = VesselLaw(arc, np.interp(arc, self.law.arc, self.law.mean), columns)
        return Profile(self.vessel, np.interp(arc, self.law.arc, self.radii), law)

    def factors(self, z: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return element parameter → its value over that at the centre, for coordinates: both (samples,).

        R and L by their integrals along the vessel, C by the squared mean radius, the stenosis coefficient by the areas
        at the throat and without the stenosis, its part for the entrance by the median radius along the vessel; a
        stenosis that takes no area has no coefficient to change. Absent coordinates are at their centre.
        """
        drawn = np.ascontiguousarray(self.radii * np.exp(self.law.log_ratio(self.law.arc, z)))
        return self._over(drawn, self.radii * np.exp(self.law.mean))

    def centre(self) -> dict[str, float]:
        """Return element parameter → its value at the coordinates' centre over that of the segmented lumen."""
        factors = self._over((self.radii * np.exp(self.law.mean))[None], self.radii)
        return {name: float(factor[0]) for name, factor in factors.items()}

    def _over(self, drawn: np.ndarray, other: np.ndarray) -> dict[str, np.ndarray]:
        """Return element parameter → its value for radii (samples, n) over that for radii (n,), (samples,)."""
        arc, factors = self.law.arc, {}
        for name, new, old in zip(
            ("R_poiseuille", "L", "C"), shape_integrals(drawn, arc), shape_integrals(other, arc), strict=True
        ):
            factors[name] = (new / old) ** (2 if name == "C" else 1)
        if self.stenosis or self.entrance:
            here = float(self._quadratic(other[None])[0])
            factors["stenosis_coefficient"] = self._quadratic(drawn) / here if here > 0.0 else np.ones(len(drawn))
        return factors

    def _quadratic(self, radii: np.ndarray) -> np.ndarray:
        """Return what the stenosis coefficient is proportional to, (samples,) for radii (samples, n)."""
        total = np.zeros(len(radii))
        if self.stenosis:
            segmented = float(throat_loss(self.radii[None], self.law.arc)[0])
            total += (1.0 - self.entrance) * (throat_loss(radii, self.law.arc) / segmented if segmented > 0.0 else 1.0)
        if self.entrance:
            total += self.entrance * (np.median(self.radii) / np.median(radii, axis=1)) ** 4
        return total


@dataclass(frozen=True)
class Lumen:
    """The uncertain lumen of a network.

    Parameters
    ----------
    names
        Coordinates: independent, standard normal.
    profiles
        0D vessel → its radius and law; vessels that are not listed are known exactly.
    captured
        Artery → fraction of its correlated variance that its own coordinates carry; see `lumen_law`.
    """

    names: list[str]
    profiles: Mapping[str, Profile]
    captured: Mapping[str, float]

    def factors(self, z: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return "BLOCK.parameter" → factor (samples,) on the network's value, for coordinates (samples,).

        Absent coordinates are at their centre.
        """
        return {
            f"{block}.{name}": factor
            for block, profile in self.profiles.items()
            for name, factor in profile.factors(z).items()
        }

    def ratio(self, vessel: str, arc, z: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return true over segmented radius (samples, n) at arc lengths (n,) cm of a tree vessel.

        Constant beyond the ends of the 0D vessels: an artery begins in 0D where it leaves the aorta.
        """
        own = sorted((p for p in self.profiles.values() if p.vessel == vessel), key=lambda p: p.law.arc[0])
        arc = np.atleast_1d(np.asarray(arc, float))
        samples = max((np.size(z[name]) for name in self.names if name in z), default=1)
        if not own:
            return np.ones((samples, len(arc)))
        parts = np.searchsorted([p.law.arc[0] for p in own[1:]], arc, side="right")
        log_ratio = np.empty((samples, len(arc)))
        for k, profile in enumerate(own):
            log_ratio[:, parts == k] = profile.law.log_ratio(arc[parts == k], z)
        return np.exp(log_ratio)

    def at_end(self, vessel: str) -> tuple[float, dict[str, float]]:
        """Return the mean of the logarithm of true over segmented radius at the end of a tree vessel.

        With it come its coefficients, coordinate → value; none if the vessel is known exactly.
        """
        own = [p for p in self.profiles.values() if p.vessel == vessel]
        if not own:
            return 0.0, {}
        law = max(own, key=lambda p: p.law.arc[-1]).law
        return float(law.mean[-1]), {name: float(column[-1]) for name, column in law.columns.items()}

    def knots(self, vessel: str) -> list[np.ndarray]:
        """Return arc lengths (n,) cm of a tree vessel, between which the logarithm of the ratio is linear."""
        return [profile.law.arc for profile in self.profiles.values() if profile.vessel == vessel]


class _Profile(BaseModel):
    model_config = ConfigDict(extra="forbid")

    vessel: str
    stenosis: bool = False
    entrance: float = 0.0
    arc: list[float]
    radii: list[float]
    mean: list[float]
    columns: dict[str, list[float]]


class _Lumen(BaseModel):
    model_config = ConfigDict(extra="forbid")

    names: list[str]
    captured: dict[str, float]
    profiles: dict[str, _Profile]


def with_lumen(network: Network, tree: Tree, segments: Sequence[Segment], law: LumenLaw) -> Network:
    """Return the network with the profiles of its 0D vessels along a tree, and their values at the law's centre.

    Parameters
    ----------
    network
        The 0D network.
    tree
        The segmented lumen.
    segments
        Its 0D vessels, see `vessels_along`.
    law
        The law of its radii.

    Returns
    -------
    Network
        A copy; without uncertainty and bias, the network as it is.
    """
    if not law.names and not any(np.any(own.mean) for own in law.vessels.values()):
        return network
    profiles = {}
    for segment in segments:
        if segment.vessel not in law.vessels:
            continue
        fine = law.knots(tree[segment.vessel])
        own = law.vessels[segment.vessel]
        columns = {name: np.interp(fine.arc, own.arc, column) for name, column in own.columns.items()}
        whole = Profile(
            segment.vessel, fine.radii, VesselLaw(fine.arc, np.interp(fine.arc, own.arc, own.mean), columns)
        )
        part = whole.between(segment.start, segment.end)
        entrance = entrance_share(network, segment.name)
        profiles[segment.name] = Profile(part.vessel, part.radii, part.law, segment.stenosis is not None, entrance)
    changed = network.deep_copy()
    for block, profile in profiles.items():
        values = changed.vessel_values(block)
        values |= {name: values[name] * factor for name, factor in profile.centre().items() if name in values}
    lumen = Lumen(law.names, profiles, law.captured)
    coordinates = [
        {"name": name, "distribution": "normal", "centre": 0.0, "spread": 1.0, "kind": LUMEN, "targets": {}}
        | {"meaning": "coordinate of the lumen's radius", "unit": "1"}
        for name in law.names
    ]
    return Network(changed | {UNCERTAIN: [*network.get(UNCERTAIN, []), *coordinates], LUMEN: content(lumen)})


def content(lumen: Lumen) -> dict[str, Any]:
    """Return the JSON object that a network file holds."""
    profiles = {
        block: _Profile(
            vessel=p.vessel,
            stenosis=p.stenosis,
            entrance=p.entrance,
            arc=p.law.arc.tolist(),
            radii=p.radii.tolist(),
            mean=p.law.mean.tolist(),
            columns={name: column.tolist() for name, column in p.law.columns.items()},
        )
        for block, p in lumen.profiles.items()
    }
    return _Lumen(names=lumen.names, captured=dict(lumen.captured), profiles=profiles).model_dump()


def lumen_of(network: Network, file: str | Path = "network") -> Lumen | None:
    """Return the uncertain lumen of a network, None if its lumen is known; raise `InputError` if it is malformed."""
    if LUMEN not in network:
        return None
    stored = checked(_Lumen, network[LUMEN], file, "run the case stage again")
    profiles = {}
    for block, p in stored.profiles.items():
        columns = {name: np.array(column) for name, column in p.columns.items()}
        profiles[block] = Profile(
            p.vessel, np.array(p.radii), VesselLaw(np.array(p.arc), np.array(p.mean), columns), p.stenosis, p.entrance
        )
    return Lumen(stored.names, profiles, stored.captured)
