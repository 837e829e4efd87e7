"""The uncertain radius of every 0D vessel, as it travels in a network file, and the element values that follow from it.

The part `lumen` of a network, which svZeroDSolver does not know, has one profile per coronary 0D vessel. Element values
change by the rules that built them (`case.network.build`), as factors on the values that the network has, which are
those at the coordinates' centre, zero: a network whose losses were tuned or learnt keeps them there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.lumen.law import LumenLaw, VesselLaw
from coronaryuq.case.lumen.throat_loss import throat_loss
from coronaryuq.case.network.build import Segment, shape_integrands
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
        return _Together([self]).factors(z)[0]

    def centre(self) -> dict[str, float]:
        """Return element parameter → its value at the coordinates' centre over that of the segmented lumen."""
        (factors,) = _Together([self]).over((self.radii * np.exp(self.law.mean))[None], self.radii)
        return {name: float(factor[0]) for name, factor in factors.items()}

    def quadratic(self, radii: np.ndarray) -> np.ndarray:
        """Return what the stenosis coefficient is proportional to, (samples,) for radii (samples, n)."""
        total = np.zeros(len(radii))
        if self.stenosis:
            segmented = float(throat_loss(self.radii[None], self.law.arc)[0])
            total += (1.0 - self.entrance) * (throat_loss(radii, self.law.arc) / segmented if segmented > 0.0 else 1.0)
        if self.entrance:
            total += self.entrance * (np.median(self.radii) / np.median(radii, axis=1)) ** 4
        return total


class _Together:
    """Profiles one after the other: a draw of all of them is a few operations on arrays, which samplers make often."""

    def __init__(self, profiles: Sequence[Profile]):
        self.profiles = profiles
        ends = np.cumsum([0, *(len(profile.radii) for profile in profiles)]).tolist()
        self.parts = [slice(*pair) for pair in pairwise(ends)]
        self.first = np.array(ends[:-1])
        arc = np.concatenate([profile.law.arc for profile in profiles])
        self.radii = np.concatenate([profile.radii for profile in profiles])
        self.mean = np.concatenate([profile.law.mean for profile in profiles])
        # From the end of one to the start of the next is no length.
        self.step = np.diff(arc)
        self.step[self.first[1:] - 1] = 0.0
        self.columns: dict[str, np.ndarray] = {}
        for profile, part in zip(profiles, self.parts, strict=True):
            for name, column in profile.law.columns.items():
                self.columns.setdefault(name, np.zeros(len(arc)))[part] = column
        self.reach: dict[str, slice] = {}
        for name, column in self.columns.items():
            nonzero = np.flatnonzero(column)
            self.reach[name] = slice(nonzero[0], nonzero[-1] + 1) if len(nonzero) else slice(0)

    @cached_property
    def centre(self) -> np.ndarray:
        """Radii (n,) at the coordinates' centre, cm."""
        return self.radii * np.exp(self.mean)

    def factors(self, z: Mapping[str, np.ndarray]) -> list[dict[str, np.ndarray]]:
        """Return `Profile.factors` of each."""
        given = {name: np.asarray(z[name], float).reshape(-1, 1) for name in self.columns if name in z}
        samples = max((len(values) for values in given.values()), default=1)
        log_ratio = np.repeat(self.mean[None], samples, axis=0)
        for name, values in given.items():
            log_ratio[:, self.reach[name]] += values * self.columns[name][self.reach[name]]
        return self.over(self.radii * np.exp(log_ratio), self.centre)

    def over(self, drawn: np.ndarray, other: np.ndarray) -> list[dict[str, np.ndarray]]:
        """Return element parameter → its value for radii (samples, n) over that for radii (n,), (samples,), of each."""
        new, old = self._elements(drawn), self._elements(other[None])
        found = []
        for k, (profile, part) in enumerate(zip(self.profiles, self.parts, strict=True)):
            factors = {name: new[name][:, k] / old[name][0, k] for name in new}
            if profile.stenosis or profile.entrance:
                here = float(profile.quadratic(other[None, part])[0])
                changed = profile.quadratic(drawn[:, part]) if here > 0.0 else np.ones(len(drawn))
                factors["stenosis_coefficient"] = changed / (here if here > 0.0 else 1.0)
            found.append(factors)
        return found

    def _elements(self, radii: np.ndarray) -> dict[str, np.ndarray]:
        """Return what R, L and C are proportional to, (samples, profiles) for radii (samples, n)."""
        fourth, second, first = (np.add.reduceat(one, self.first, axis=1) for one in shape_integrands(radii, self.step))
        return {"R_poiseuille": fourth, "L": second, "C": first**2}


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
        each = self._together.factors(z) if self.profiles else []
        return {
            f"{block}.{name}": factor
            for block, factors in zip(self.profiles, each, strict=True)
            for name, factor in factors.items()
        }

    @cached_property
    def _together(self) -> _Together:
        return _Together(list(self.profiles.values()))

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
