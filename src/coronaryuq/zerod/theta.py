"""θ: what differs between the samples of a campaign, and how it changes the 0D network.

A table of θ has one column per coronary bed (r, a multiplier of its resistances), `R_cor_scaling` (s, a factor on all
of them), and one column per uncertain parameter of the network: an entry of the list `uncertain_parameters` of its
file, which svZeroDSolver does not know. The file's own values are those at the parameter's centre. An entry has

    name            of the column
    distribution    "lognormal": median `centre`, standard deviation of the logarithm `spread`;
                    "normal": mean `centre`, standard deviation `spread`;
                    "choice": 0, 1, ... with `probabilities`, of kind effect only
    loadings        optional, name of an earlier entry → coefficient: what that entry's standard normal coordinate adds,
                    times the coefficient, to this value (to its logarithm); so correlated parameters are expressed
    kind, targets   how the network changes, see `KINDS`; `lumen`: by the network's part of this name, without targets
    meaning, unit, source     optional texts

    {"name": "lad_radius", "distribution": "lognormal", "centre": 1.0, "spread": 0.05, "kind": "factor",
     "targets": {"LAD.R_poiseuille": -4.0, "LAD.C": 3.0}}

The posterior samples their standard normal coordinates with the multipliers of the beds, so that measured flows inform
them. Entries of kind `effect` have several columns, see `zerod.effect_mixture`. To add a kind with one column per
entry, write a subclass of `Kind`, and name it in `KINDS`; `spread`
zero must leave the network unchanged to the bit.
"""

from abc import ABC, abstractmethod
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from scipy.special import ndtr, ndtri

from coronaryuq.case.lumen.profiles import Lumen, lumen_of
from coronaryuq.case.network.network import LUMEN, UNCERTAIN, Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.records import STATE
from coronaryuq.zerod.effect_mixture import KIND, EffectMixture, Mixtures
from coronaryuq.zerod.network.beds import SCALING, beds, resistance_changes
from coronaryuq.zerod.network.blocks import finite
from coronaryuq.zerod.network.numbering import Model

TAKEN = ("sample", *STATE, "generation", "log_density", SCALING)
"""Columns of tables of θ or of draws that no parameter may be called."""
TEXTS = ("meaning", "unit", "source")


class Kind(ABC):
    """How the value of an uncertain parameter changes one target of the network."""

    distributions: ClassVar[tuple[str, ...]] = ("lognormal", "normal")

    @abstractmethod
    def amount(self, value: np.ndarray, centre: float, coefficient: float) -> np.ndarray:
        """Return by how much targets of this coefficient change at values (n,) of the parameter."""

    @abstractmethod
    def change(self, present: Any, amount: np.ndarray) -> np.ndarray:
        """Return the target (n,) changed by an amount (n,); present: at the parameter's centre, a number or (n,)."""


class Factor(Kind):
    """target x (value / centre)^coefficient."""

    distributions = ("lognormal",)

    def amount(self, value: np.ndarray, centre: float, coefficient: float) -> np.ndarray:
        return (value / centre) ** coefficient

    def change(self, present: Any, amount: np.ndarray) -> np.ndarray:
        return present * amount


class Addition(Kind):
    """target + coefficient (value - centre)."""

    def amount(self, value: np.ndarray, centre: float, coefficient: float) -> np.ndarray:
        return coefficient * (value - centre)

    def change(self, present: Any, amount: np.ndarray) -> np.ndarray:
        return present + amount


class LumenCoordinate(Kind):
    """A coordinate of the network's part `lumen`, which says what it does to all vessels; it has no targets."""

    distributions = ("normal",)

    def amount(self, value: np.ndarray, centre: float, coefficient: float) -> np.ndarray:
        raise TypeError("a coordinate of the lumen changes no target by itself")

    def change(self, present: Any, amount: np.ndarray) -> np.ndarray:
        raise TypeError("a coordinate of the lumen changes no target by itself")


KINDS: dict[str, Kind] = {"factor": Factor(), "add": Addition(), LUMEN: LumenCoordinate()}
"""Kinds by their name in a network file."""


@dataclass(frozen=True)
class UncertainParameter:
    """One entry of `uncertain_parameters`; see the module."""

    name: str
    distribution: str
    centre: float
    spread: float
    kind: str
    targets: Mapping[str, float]
    loadings: Mapping[str, float] = field(default_factory=dict)
    probabilities: tuple[float, ...] = ()
    meaning: str = ""
    unit: str = ""
    source: str = ""

    def content(self) -> dict[str, Any]:
        """Return the entry of a network file."""
        held = {"name": self.name, "distribution": self.distribution, "centre": self.centre, "spread": self.spread}
        held |= {"kind": self.kind, "targets": dict(self.targets)}
        held |= {"loadings": dict(self.loadings)} if self.loadings else {}
        return held | {name: getattr(self, name) for name in TEXTS if getattr(self, name)}


class Laws:
    """Joint law of some parameters: values (n, k) from independent standard normal coordinates z (n, k), and back."""

    def __init__(self, parameters: Sequence[UncertainParameter] = ()):
        self.names = [one.name for one in parameters]
        self.centre = np.array([one.centre for one in parameters], dtype=float)
        self.logged = np.array([one.distribution == "lognormal" for one in parameters], dtype=bool)
        self.choices = {
            column: _limits(one.probabilities) for column, one in enumerate(parameters) if one.distribution == "choice"
        }
        """Column of each choice → the coordinates (k - 1,) at which the number that is chosen rises."""
        self.factor = np.diag([float(one.spread) for one in parameters]).reshape(len(parameters), len(parameters))
        for row, one in enumerate(parameters):
            for other, coefficient in one.loadings.items():
                self.factor[row, self.names.index(other)] = coefficient

    def __len__(self) -> int:
        return len(self.names)

    def values(self, z: np.ndarray) -> np.ndarray:
        """Return the values (n, k) at coordinates z (n, k); each row is summed in the same order, however many."""
        moved = np.sum(z[:, None, :] * self.factor[None], axis=2)
        with np.errstate(over="ignore"):
            found = np.where(self.logged, self.centre * np.exp(np.where(self.logged, moved, 0.0)), self.centre + moved)
        return self.stepped(found)

    def stepped(self, z: np.ndarray) -> np.ndarray:
        """Return coordinates z (n, k) with those of choices replaced by the number that they choose."""
        if not self.choices:
            return z
        found = z.copy()
        for column, limits in self.choices.items():
            found[:, column] = np.searchsorted(limits, z[:, column])
        return found

    def coordinates(self, values: np.ndarray) -> np.ndarray:
        """Return the coordinates z (n, k) of values (n, k); 0 where a parameter without spread leaves them open."""
        positive = np.where(self.logged, values / np.where(self.logged, self.centre, 1.0), 1.0)
        moved = np.where(self.logged, np.log(positive), values - self.centre)
        z = np.zeros_like(moved)
        for row in range(len(self)):
            spread = self.factor[row, row]
            rest = moved[:, row] - np.sum(z[:, :row] * self.factor[row, :row], axis=1)
            z[:, row] = rest / spread if spread > 0 else 0.0
        for column, limits in self.choices.items():
            ends = ndtr(np.concatenate([[-np.inf], limits, [np.inf]]))
            z[:, column] = ndtri(0.5 * (ends[:-1] + ends[1:]))[values[:, column].astype(int)]
        return z


def _limits(probabilities: Sequence[float]) -> np.ndarray:
    return ndtri(np.clip(np.cumsum(probabilities)[:-1], 0.0, 1.0))


class Theta:
    """θ of one network: its columns, their laws, and what they change.

    Parameters
    ----------
    network
        A checked network, read from `file`.

    Raises
    ------
    InputError
        If an entry of `uncertain_parameters` is not one, or changes what the network does not have.
    """

    def __init__(self, network: Network, file: str | Path = "network"):
        self.network, self.file = network, file
        self.parameters, mixtures = _parameters(network, file)
        self.mixtures = Mixtures(network, mixtures)
        self.laws = Laws([*self.parameters, *(column for one in mixtures for column in _columns_of(one))])
        self.lumen = lumen_of(network, file)
        if self.lumen is not None or any(one.kind == LUMEN for one in self.parameters):
            _check_lumen(self.lumen, self.parameters, self._own, file)

    @property
    def columns(self) -> list[str]:
        """Names of all columns that a table of θ may have."""
        return [*beds(self.network), SCALING, *self.laws.names]

    @cached_property
    def _own(self) -> dict[str, float]:
        return Model(self.network, self.file).parameters

    def changes(self, theta: Mapping[str, np.ndarray], wanted: Container[str] | None = None) -> dict[str, np.ndarray]:
        """Return changes for `Engine.run_cycles` from columns (n,) of a table of θ.

        Absent beds have the multiplier 1, an absent `R_cor_scaling` is 1, absent parameters are at their centres.
        wanted: the network's parameters that matter; others may then be as if they did not change.
        """
        given = set(self.laws.names)
        multipliers = {name: value for name, value in theta.items() if name != SCALING and name not in given}
        changes = resistance_changes(self.network, multipliers, theta.get(SCALING, 1.0))
        for one in self.parameters:
            if one.name not in theta:
                continue
            value, kind = np.asarray(theta[one.name], dtype=float), KINDS[one.kind]
            targets = {name: by for name, by in one.targets.items() if wanted is None or name in wanted}
            amounts = {c: kind.amount(value, one.centre, c) for c in set(targets.values())}
            for target, coefficient in targets.items():
                changes[target] = kind.change(changes.get(target, self._own[target]), amounts[coefficient])
        if self.mixtures.mixtures:
            changes = self.mixtures.apply(changes, self._own, theta)
        if self.lumen is not None and any(name in theta for name in self.lumen.names):
            for target, factor in self.lumen.factors(theta).items():
                present = changes.get(target, self._own[target])
                # What a missing effect adds to a vessel is not the lumen's.
                without = self.mixtures.absent.get(target)
                changes[target] = present * factor if without is None else present + without * (factor - 1.0)
        return changes


def theta_changes(network: Network, theta: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return `Theta.changes` of a network, for one table."""
    return Theta(network).changes(theta)


def read_theta(
    samples_csv: str | Path, first: int, count: int, network: Network, file: str | Path = "network"
) -> pd.DataFrame:
    """Read rows `first` to `first + count` of a table of θ.

    Parameters
    ----------
    samples_csv
        CSV with `sample`, one column per coronary bed, `R_cor_scaling`, and one column per uncertain parameter of the
        network; columns `chain` and `draw` are dropped.
    first, count
        Rows to read, from 0.
    network, file
        The network that the columns belong to, and its file.

    Returns
    -------
    pandas.DataFrame
        The `count` rows.

    Raises
    ------
    InputError
        The table is too short, or a column is neither a coronary bed nor an uncertain parameter of the network.
    """
    table = read_csv(samples_csv, ("sample",)).drop(columns=list(STATE), errors="ignore")
    theta = table.iloc[first : first + count]
    if len(theta) < count:
        raise InputError(samples_csv, "sample", len(table), f"expected at least {first + count} rows")
    known = {*Theta(network, file).columns, "sample"}
    for column in theta.columns:
        if column not in known:
            raise InputError(samples_csv, column, None, f"not a coronary bed of {file}")
    return theta


def _columns_of(mixture: EffectMixture) -> list[UncertainParameter]:
    """Return the laws of the columns of a mixture."""
    columns = [UncertainParameter(name, "normal", 0.0, 1.0, KIND, {}) for name in mixture.size_columns]
    if mixture.member_column:
        shares = tuple(member.probability for member in mixture.members)
        columns.append(UncertainParameter(mixture.member_column, "choice", 0.0, 1.0, KIND, {}, probabilities=shares))
    return columns


def _parameters(network: Network, file: str | Path) -> tuple[list[UncertainParameter], list[EffectMixture]]:
    entries = network.get(UNCERTAIN, [])
    found: list[UncertainParameter] = []
    mixtures: list[EffectMixture] = []
    if not entries:
        return [], []
    scalars, taken = Model(network, file).parameters, {*TAKEN, *beds(network)}
    for number, entry in enumerate(entries):
        where = f"{UNCERTAIN}[{number}]"
        if entry.get("kind") == KIND:
            mixtures.append(_mixture(entry, where, file, {*taken, *scalars}, scalars))
            taken |= {column.name for column in _columns_of(mixtures[-1])}
            continue
        one = _parameter(entry, where, file)
        if not one.name or one.name in taken:
            raise InputError(file, f"{where}.name", one.name, "expected a name that is no bed's nor another column's")
        for other in one.loadings:
            if other not in [earlier.name for earlier in found]:
                raise InputError(file, f"{where}.loadings", other, "not an earlier entry")
        for target in one.targets:
            if target not in scalars:
                raise InputError(file, f"{where}.targets", target, "no such scalar parameter in the network")
        taken.add(one.name)
        found.append(one)
    return found, mixtures


def _mixture(
    entry: Mapping[str, Any], where: str, file: str | Path, taken: set[str], scalars: Mapping[str, float]
) -> EffectMixture:
    """Return an entry of kind effect, checked against the network's scalar parameters and the columns taken."""
    mixture = EffectMixture.read(entry, where, file)
    for column in _columns_of(mixture):
        if column.name in taken:
            raise InputError(file, f"{where}.name", mixture.name, "expected a name whose columns are no others'")
    for target in mixture.absent:
        if target not in scalars:
            raise InputError(file, f"{where}.members", target, "no such scalar parameter in the network")
    return mixture


def _check_lumen(
    lumen: Lumen | None, parameters: Sequence[UncertainParameter], known: Mapping[str, float], file: str | Path
) -> None:
    """Raise `InputError` if the coordinates of the lumen are not those listed, or it changes what is not there."""
    listed = [one.name for one in parameters if one.kind == LUMEN]
    named = [] if lumen is None else lumen.names
    for name in listed:
        if name not in named:
            raise InputError(file, UNCERTAIN, name, f"no such coordinate in the part `{LUMEN}` of the network")
    for one in parameters:
        if one.kind == LUMEN and (one.targets or one.centre != 0.0 or one.spread != 1.0):
            raise InputError(file, f"{UNCERTAIN}.{one.name}", None, "expected centre 0, spread 1 and no targets")
    if lumen is None:
        return
    for name in named:
        if name not in listed:
            raise InputError(file, f"{LUMEN}.names", name, f"not in {UNCERTAIN}; list it there with kind {LUMEN}")
    for block in lumen.profiles:
        if f"{block}.R_poiseuille" not in known:
            raise InputError(file, f"{LUMEN}.profiles", block, "the network has no such vessel")


def _parameter(entry: Any, where: str, file: str | Path) -> UncertainParameter:
    """Return one entry, checked for itself."""
    if not isinstance(entry, dict):
        raise InputError(file, where, entry, "expected an object")
    texts = {"name": None, "distribution": ("lognormal", "normal"), "kind": tuple(KINDS)} | dict.fromkeys(TEXTS)
    tables = ("targets", "loadings")
    known = {*texts, *tables, "centre", "spread"}
    for key in entry:
        if key not in known:
            raise InputError(file, f"{where}.{key}", None, f"unknown key; known: {', '.join(sorted(known))}")
    for key in ("name", "distribution", "kind", "centre", "spread", "targets"):
        if key not in entry:
            raise InputError(file, f"{where}.{key}", None, "missing")
    for key, allowed in texts.items():
        value = entry.get(key, "")
        if not isinstance(value, str) or (allowed is not None and value not in allowed):
            raise InputError(file, f"{where}.{key}", value, f"expected {' or '.join(allowed) if allowed else 'text'}")
    for key in tables:
        value = entry.get(key, {})
        if not isinstance(value, dict) or not all(map(finite, value.values())):
            raise InputError(file, f"{where}.{key}", value, "expected an object of names and numbers")
    logged = entry["distribution"] == "lognormal"
    if not finite(entry["centre"]) or (logged and not entry["centre"] > 0):
        remedy = "expected a positive number" if logged else "expected a number"
        raise InputError(file, f"{where}.centre", entry["centre"], remedy)
    if not finite(entry["spread"]) or entry["spread"] < 0:
        raise InputError(file, f"{where}.spread", entry["spread"], "expected a number that is not negative")
    if entry["distribution"] not in KINDS[entry["kind"]].distributions:
        needed = " or ".join(KINDS[entry["kind"]].distributions)
        raise InputError(file, f"{where}.distribution", entry["distribution"], f"{entry['kind']} needs {needed}")
    return UncertainParameter(**entry)
