"""What every effect is: formula and source, sizes with priors, places, a way into the network or the data."""

from abc import ABC
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.network.read import copy_of

Values = dict[str, np.ndarray]

WAVE_POINTS = 1201
"""Points of a waveform that differs between samples or conditions; four times as fine as the steps of a cycle."""


@dataclass(frozen=True)
class Parameter:
    """One size of an effect. Zero always means that the effect is absent.

    kind "lognormal": positive, median `centre`, standard deviation of its logarithm `spread`.
    kind "normal": signed, mean `centre`, standard deviation `spread`.
    """

    name: str
    unit: str
    kind: str
    centre: float
    spread: float
    meaning: str

    def from_standard(self, z: np.ndarray) -> np.ndarray:
        """The size from a standard normal number."""
        z = np.asarray(z, dtype=float)
        if self.kind == "lognormal":
            return self.centre * np.exp(self.spread * z)
        return self.centre + self.spread * z

    def to_standard(self, size: np.ndarray) -> np.ndarray:
        size = np.asarray(size, dtype=float)
        if self.kind == "lognormal":
            return np.log(size / self.centre) / self.spread
        return (size - self.centre) / self.spread


@dataclass(frozen=True)
class Series:
    """What one block of predictions stands for: one quantity at one location under one condition.

    time: (k,) s within the cycle for waveforms, None for mean, min and max. period: s.
    """

    condition: str
    quantity: str
    location: str
    statistic: str
    time: np.ndarray | None
    period: float


class Effect(ABC):
    """One physical effect that a model may lack; sizes in the units of `parameters`, places by the network's names.

    Network effects override `changes` (and `insert`, `aliases` where the structure changes); effects on the
    measuring side override `observe`, or `late` where they shift a waveform in time. `native` says how the repaired
    network expresses it in svZeroDSolver's format.
    """

    name: ClassVar[str]
    formula: ClassVar[str]
    source: ClassVar[str]
    signature: ClassVar[str]
    native: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    side: ClassVar[str] = "network"
    grafted: ClassVar[bool] = False
    """True when `insert` adds vessels that carry next to nothing until `changes` opens them: many fit one network."""
    feedback: ClassVar[bool] = False
    """True when `changes` needs the mean pressures at the beds, found by running twice."""
    turning: ClassVar[bool] = False
    """True where a small size does not tell what a larger one does: a wave that comes late by a quarter of its period
    differs in another shape than one that is hardly late."""
    nameable: ClassVar[bool] = True
    """False for a mistake in the model: where it explains best, what is missing is no effect."""

    @property
    def of_an_instrument(self) -> bool:
        """Whether it is of what was read and not of the patient: beyond its prior it is not to be believed."""
        return self.side == "measurement"

    def places(self, anatomy: Anatomy, observed: list[Series] = ()) -> list[str]:
        """Where it may act; `observed` are the measured series, which effects on the measuring side act on."""
        raise NotImplementedError

    def insert(self, network: dict, place: str, anatomy: Anatomy) -> dict:
        """The network with the elements that the effect needs, in a state that leaves the flow as it was."""
        return copy_of(network)

    def inserts(self, place: str, anatomy: Anatomy) -> bool:
        """Whether `insert` adds anything at that place."""
        return type(self).insert is not Effect.insert

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        """Old name → new name of every location that `insert` renames."""
        return {}

    def changes(self, network: dict, place: str, sizes: Values, anatomy: Anatomy, condition: "Situation") -> Values:
        """Engine changes `"BLOCK.parameter"` → (n,) for sizes (n,), from the values that `network` holds."""
        return {}

    def late(self, place: str, sizes: Values, series: Series) -> np.ndarray:
        """By how much a series is read late, (n,), s."""
        return np.zeros(1)

    def observe(self, place: str, sizes: Values, series: list[Series], predicted: list[np.ndarray]) -> list[np.ndarray]:
        """What would be measured: predictions (n, k) of each series after the effect on the measuring side."""
        return predicted

    def said(self, parameter: Parameter, size: float, anatomy: Anatomy) -> tuple[str, float]:
        """What a size is called in words, and its value there."""
        return parameter.meaning, size

    def assumed(self, anatomy: Anatomy, covariates: list[dict]) -> str:
        """What had to be assumed of the effect's shape, for want of a measured waveform under some condition."""
        return ""

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        """The sizes in physical terms, in the network's units, for the report."""
        return dict(sizes)


@dataclass(frozen=True)
class Situation:
    """What an effect may know of the condition under which it acts.

    vasodilated: `coronary_resistance_scale` of the condition. period: s.
    pressure: mean pressure (n,) at each bed, for effects with feedback.
    resting: mean pressure (float) at each bed in the reference run of the model.
    covariates: measured waveforms that are no boundary condition, such as `LV` → (t, value).
    """

    vasodilated: float
    period: float
    pressure: dict[str, np.ndarray]
    resting: dict[str, float]
    covariates: dict[str, tuple[np.ndarray, np.ndarray]]


def bed_values(network: dict, bed: str) -> dict:
    """The `bc_values` of one boundary condition."""
    return next(b["bc_values"] for b in network["boundary_conditions"] if b["bc_name"] == bed)


def vessel_values(network: dict, vessel: str) -> dict:
    """The `zero_d_element_values` of one vessel."""
    return next(v for v in network["vessels"] if v["vessel_name"] == vessel)["zero_d_element_values"]


def sampled(network: dict, name: str) -> np.ndarray:
    """A boundary condition's waveform on an even grid over its cycle, both ends included, (WAVE_POINTS,)."""
    block, _, parameter = name.rpartition(".")
    values = bed_values(network, block)
    time = np.asarray(values["t"], dtype=float)
    if len(values[parameter]) == 1:
        return np.full(WAVE_POINTS, float(values[parameter][0]))
    return np.interp(np.linspace(time[0], time[-1], WAVE_POINTS), time, np.asarray(values[parameter], dtype=float))
