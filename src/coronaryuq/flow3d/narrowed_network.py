"""The part `narrowed` of a network for 3D runs: which members of its mixtures narrow a vessel in the mesh, and where.

svZeroDSolver does not know it, and the members (`zerod.effect_mixture`) do not act on the network itself.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict

from coronaryuq.case.anatomy.tree import Tree, Vessel
from coronaryuq.case.lumen.narrowing import LENGTH
from coronaryuq.case.network.build import Physics
from coronaryuq.case.network.network import NARROWED, UNCERTAIN, Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.typed import checked
from coronaryuq.zerod.effect_mixture import KIND, EffectMixture, Member
from coronaryuq.zerod.effects.narrowing import DiffuseNarrowing
from coronaryuq.zerod.effects.stenosis import FocalStenosis, QuadraticStenosis, StenosisWithViscousLoss

SHAPES = tuple(law.name for law in (DiffuseNarrowing, QuadraticStenosis, StenosisWithViscousLoss, FocalStenosis))
"""Effects that are shapes of a lumen."""
Interval = tuple[float, float]


@dataclass(frozen=True)
class Place:
    """Where a 0D vessel lies along a tree vessel; all are arc lengths of this, cm.

    Parameters
    ----------
    vessel
        The tree vessel.
    start, end
        Of the 0D vessel.
    meshed
        The part of it in the mesh.
    stenosis
        From where to where a stenosis goes whose law does not say it.
    lesion
        Whether that is the vessel's declared lesion.
    """

    vessel: str
    start: float
    end: float
    meshed: Interval
    stenosis: Interval
    lesion: bool = False

    @classmethod
    def of(cls, vessel: Vessel, start: float, end: float, kept: Interval, lesion: Interval | None = None) -> "Place":
        """Return the place of a 0D vessel; kept: the stretch of its tree vessel in the mesh.

        Without a lesion a stenosis is in the middle of the 0D vessel's part in the mesh, `LENGTH` diameters long or as
        long as the part. If the part is shorter than twice that, so that the jet would reach a cap, it is in the
        middle of the longest part outside, unless all of these are shorter than a diameter.
        """
        first, last = (float(np.clip(cut, start, end)) for cut in kept)
        if lesion is not None:
            return cls(vessel.name, start, end, (first, last), lesion, True)
        diameter = 2.0 * float(vessel.radius_at(0.5 * (first + last)))
        low, high = max((start, first), (last, end), key=lambda part: part[1] - part[0])
        if last - first >= 2.0 * LENGTH * diameter or high - low < diameter:
            low, high = first, last
        middle = 0.5 * (low + high)
        half = min(LENGTH * float(vessel.radius_at(middle)), 0.5 * (high - low))
        return cls(vessel.name, start, end, (first, last), (middle - half, middle + half))

    def has(self, arc: float) -> bool:
        """Return whether a place along the tree vessel lies in the mesh."""
        return self.meshed[0] <= arc <= self.meshed[1]


class _Member(BaseModel):
    model_config = ConfigDict(extra="forbid")

    parameter: str
    member: int
    vessel: str
    start: float
    end: float
    meshed: Interval
    stenosis: Interval
    lesion: bool


class _Narrowed(BaseModel):
    model_config = ConfigDict(extra="forbid")

    stenosis_loss: float
    density: float
    members: list[_Member]


def content(members: Mapping[tuple[str, int], Place], physics: Physics) -> dict[str, Any]:
    """Return the part `narrowed` of a network; members: name of the mixture and number of the member → its place."""
    rows = [_Member(parameter=name, member=k, **asdict(place)) for (name, k), place in members.items()]
    held = _Narrowed(stenosis_loss=physics.stenosis_loss, density=physics.density, members=rows)
    return held.model_dump(mode="json")


def where(effect: str, block: str, place: Place) -> str:
    """Return where along a 0D vessel the lumen has an effect, and what of this is assumed; empty if it is outside."""
    if effect == DiffuseNarrowing.name:
        return f"all along {block}, with ramps at its ends"
    if effect == FocalStenosis.name:
        return f"in {block}, where the search found it"
    if place.lesion:
        return f"in the declared lesion of {block}, tighter than segmented; this place is assumed"
    if not place.has(0.5 * sum(place.stenosis)):
        return ""
    long = 10.0 * (place.stenosis[1] - place.stenosis[0])
    return f"in the middle of what 3D has of {block}, {long:.0f} mm long; place and length are assumed"


@dataclass(frozen=True)
class Adopted:
    """A member of a mixture, with its number, that narrows a 0D vessel at a place."""

    mixture: EffectMixture
    number: int
    place: Place

    @property
    def member(self) -> Member:
        return self.mixture.members[self.number]

    @property
    def block(self) -> str:
        """The 0D vessel."""
        return self.member.place

    @property
    def names(self) -> list[str]:
        """Columns of θ that it depends on."""
        column = self.mixture.member_column
        return [*self.mixture.size_columns, *([column] if column else [])]

    def sizes(self, z: Mapping[str, float]) -> dict[str, np.ndarray] | None:
        """Return the sizes (1,) of one sample, None if another member acts; absent columns are at their centres."""
        if int(z.get(self.mixture.member_column or "", 0)) != self.number:
            return None
        return self.member.sizes(np.array([[z.get(name, 0.0) for name in self.mixture.size_columns]]))


def read_narrowed(network: Network, tree: Tree, file: str | Path = "network") -> tuple[list[Adopted], Physics]:
    """Read the part `narrowed` of a network that has one; raise `InputError` if it is malformed."""
    stored = checked(_Narrowed, network[NARROWED], file, "write the network for 3D runs again")
    mixtures = {
        entry["name"]: EffectMixture.read(entry, UNCERTAIN, file)
        for entry in network.get(UNCERTAIN, [])
        if entry["kind"] == KIND
    }
    adopted = []
    for row in stored.members:
        mixture = mixtures.get(row.parameter)
        if mixture is None or not 0 <= row.member < len(mixture.members):
            raise InputError(file, NARROWED, row.parameter, f"no effect with a member {row.member} in {UNCERTAIN}")
        if row.vessel not in tree:
            raise InputError(file, NARROWED, row.vessel, "no vessel of the case's tree.vtp")
        place = Place(**row.model_dump(exclude={"parameter", "member"}))
        adopted.append(Adopted(mixture, row.member, place))
    return adopted, Physics(density=stored.density, stenosis_loss=stored.stenosis_loss)
