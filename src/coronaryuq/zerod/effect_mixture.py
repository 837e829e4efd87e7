"""An effect of unknown identity as an uncertain parameter: several effects, one of which acts in each sample.

An entry of `uncertain_parameters` (`zerod.theta`) of kind `effect` has

    name        of its columns: NAME_size (and NAME_size_2, ...), the standard normal coordinates of the acting effect's
                sizes, and, with several members, NAME_member, the number of the one that acts, from 0
    scales      pressure, period and flow (by vessel) of the model that the sizes refer to
    members     list of {effect, place, probability, acts, mean, covariance, absent}: mean (k,) and covariance (k, k) of
                the sizes in standard deviations of their priors; absent: "BLOCK.parameter" → value without the effect
    renamed     0D locations of the network without the effects → their names in this one
    meaning, source     optional texts

The file's own values are those with the first member at the mean of its sizes. A target that is listed under `absent`
is held in calibration. One that is not (a bed's resistance) is tuned, with the effect in it, so that only the ratio to
the mean size changes it. A member that does not act (`acts: false`: an error of a sensor, or an effect that this model
cannot have) leaves all targets as they are without any effect.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Effect
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.changes import with_changes

KIND = "effect"
TEXTS = ("meaning", "source")


@dataclass(frozen=True)
class Member:
    """One of the effects of a mixture; see the module."""

    effect: str
    place: str
    probability: float
    acts: bool
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    absent: Mapping[str, float]

    @property
    def law(self) -> Effect:
        return effect(self.effect)

    def sizes(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the sizes, name → (n,), at standard normal coordinates (n, at least k)."""
        k = len(self.mean)
        root = np.linalg.cholesky(np.array(self.covariance) + 1e-12 * np.eye(k))
        standard = np.array(self.mean) + np.sum(z[:, None, :k] * root[None], axis=2)
        parameters = self.law.parameters
        return {one.name: np.asarray(one.from_standard(standard[:, j])) for j, one in enumerate(parameters)}


@dataclass(frozen=True)
class EffectMixture:
    """An entry of kind `effect`; see the module. scales: `pressure`, `period`, `flow`."""

    name: str
    members: tuple[Member, ...]
    scales: Mapping[str, Any]
    meaning: str = ""
    source: str = ""
    renamed: Mapping[str, str] = field(default_factory=dict)

    @property
    def dimension(self) -> int:
        """Largest number of sizes of a member, whether or not it acts: 0D and 3D have the same columns."""
        return max((len(member.mean) for member in self.members), default=0)

    @property
    def size_columns(self) -> list[str]:
        return [f"{self.name}_size" + (f"_{j + 1}" if j else "") for j in range(self.dimension)]

    @property
    def member_column(self) -> str | None:
        """Column of the number of the acting member; None if there is one member."""
        return f"{self.name}_member" if len(self.members) > 1 else None

    @property
    def absent(self) -> dict[str, float]:
        """Value of every held target without any effect."""
        return {target: value for member in self.members if member.acts for target, value in member.absent.items()}

    def content(self) -> dict[str, Any]:
        """Return the entry of a network file."""
        members = [
            {
                "effect": one.effect, "place": one.place, "probability": one.probability, "acts": one.acts,
                "mean": list(one.mean), "covariance": [list(row) for row in one.covariance], "absent": dict(one.absent),
            }
            for one in self.members
        ]  # fmt: skip
        held = {"name": self.name, "kind": KIND, "scales": dict(self.scales), "members": members}
        held |= {"renamed": dict(self.renamed)} if self.renamed else {}
        return held | {name: getattr(self, name) for name in TEXTS if getattr(self, name)}

    @classmethod
    def read(cls, entry: Mapping[str, Any], where: str, file: str | Path) -> "EffectMixture":
        """Read an entry; `InputError` for one that is none."""
        try:
            members = tuple(
                Member(
                    one["effect"], one["place"], float(one["probability"]), bool(one["acts"]), tuple(one["mean"]),
                    tuple(map(tuple, one["covariance"])), dict(one["absent"]),
                )
                for one in entry["members"]
            )  # fmt: skip
            texts = {name: entry.get(name, "") for name in TEXTS}
            renamed = dict(entry.get("renamed", {}))
            mixture = cls(entry["name"], members, entry["scales"], renamed=renamed, **texts)
            for member in members:
                member.sizes(np.zeros((1, len(member.mean))))
            total = sum(member.probability for member in members)
        except (KeyError, TypeError, ValueError, np.linalg.LinAlgError) as error:
            raise InputError(file, where, None, f"not an entry of kind effect ({error})") from None
        if not members or abs(total - 1.0) > 1e-6:
            raise InputError(file, f"{where}.members", total, "expected probabilities that add up to 1")
        return mixture


class Mixtures:
    """All mixtures of a network, applied to changes of its parameters.

    Parameters
    ----------
    network
        The network, whose values include the first member of each mixture at its mean.
    mixtures
        Its mixtures.
    """

    def __init__(self, network: Network, mixtures: Sequence[EffectMixture]):
        self.network, self.mixtures = network, mixtures

    @cached_property
    def absent(self) -> dict[str, float]:
        """Every held target without any effect."""
        return {target: value for mixture in self.mixtures for target, value in mixture.absent.items()}

    @property
    def renamed(self) -> dict[str, str]:
        """0D locations of the network without the effects → their names in this one."""
        return {old: new for mixture in self.mixtures for old, new in mixture.renamed.items()}

    @cached_property
    def _without(self) -> Network:
        return with_changes(self.network, self.absent)

    def apply(
        self, changes: dict[str, np.ndarray], own: Mapping[str, float], theta: Mapping[str, np.ndarray]
    ) -> dict[str, np.ndarray]:
        """Return changes with the effects of the columns of θ; absent columns are at their centres.

        changes: of the same samples so far. own: "BLOCK.parameter" → value in the file.
        """
        given = [np.size(theta[name]) for one in self.mixtures for name in _columns(one) if name in theta]
        if not given:
            return changes
        found = dict(changes)
        for target, value in self.absent.items():
            found[target] = np.asarray(found.get(target, own[target]) - own[target] + value)
        for mixture in self.mixtures:
            found = self._applied(mixture, found, own, theta, max(given))
        return found

    def _applied(
        self, mixture: EffectMixture, changes: dict[str, np.ndarray], own: Mapping[str, float], theta: Mapping,
        count: int,
    ) -> dict[str, np.ndarray]:  # fmt: skip
        z = np.zeros((count, mixture.dimension))
        for j, name in enumerate(mixture.size_columns):
            z[:, j] = theta.get(name, 0.0)
        acting = np.broadcast_to(np.asarray(theta.get(mixture.member_column, 0.0)), (len(z),))
        first = self._ratios(mixture, mixture.members[0], np.zeros((1, mixture.dimension)))
        found = dict(changes)
        for target, ratio in first.items():
            found[target] = np.asarray(found.get(target, own[target]) / ratio)
        for number, member in enumerate(mixture.members):
            here = acting == number
            if not member.acts or not np.any(here):
                continue
            for target, value in self._values(mixture, member, z).items():
                present = found.get(target, own[target])
                before = self._before(target)
                moved = present + (value - before) if target in member.absent else present * (value / before)
                found[target] = np.where(here, np.asarray(moved), present)
        return found

    def _values(self, mixture: EffectMixture, member: Member, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the targets of a member (n,) on the network without any effect."""
        scales = mixture.scales
        anatomy = Anatomy(self._without, scales["pressure"], dict(scales["flow"]), scales["period"])
        state = ConditionState(1.0, scales["period"], {}, {}, {})
        return member.law.changes(self._without, member.place, member.sizes(z), anatomy, state)

    def _ratios(self, mixture: EffectMixture, member: Member, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the factors of a member on the targets that are not held."""
        if not member.acts:
            return {}
        values = self._values(mixture, member, z)
        return {target: v / self._before(target) for target, v in values.items() if target not in member.absent}

    def _before(self, target: str) -> float:
        return self._own_without[target]

    @cached_property
    def _own_without(self) -> dict[str, float]:
        return {
            f"{element.name}.{name}": float(value)
            for element in self._without.elements()
            for name, value in element.values.items()
            if isinstance(value, int | float)
        } | self.absent


def _columns(mixture: EffectMixture) -> list[str]:
    return [*mixture.size_columns, *([mixture.member_column] if mixture.member_column else [])]
