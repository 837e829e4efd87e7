"""Base class of the effects that a model may be missing, and the objects they act on."""

import inspect
from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from coronaryuq.case.network.network import Network
from coronaryuq.core.interpolation import interpolated
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.pullback import Pullback
from coronaryuq.zerod.effects.readings import Readings

Values = dict[str, np.ndarray]
Channel = tuple[str, str]
"""Quantity and location of a reading."""
Number = TypeVar("Number", float, np.ndarray)
Z_90 = 1.6448536269514722
"""Half-width of the central 90 % of a standard normal distribution."""


@dataclass(frozen=True)
class Parameter:
    """One size of an effect with its prior; size zero means that the effect is absent.

    kind "lognormal": positive, median `centre`, standard deviation of its logarithm `spread`.
    kind "normal": signed, mean `centre`, standard deviation `spread`.
    """

    name: str
    unit: str
    kind: Literal["lognormal", "normal"]
    centre: float
    spread: float
    meaning: str

    def from_standard(self, z: np.ndarray | float) -> np.ndarray:
        """Convert a standard normal number to a size."""
        z = np.asarray(z, dtype=float)
        if self.kind == "lognormal":
            return self.centre * np.exp(self.spread * z)
        return self.centre + self.spread * z

    def to_standard(self, size: np.ndarray | float) -> np.ndarray:
        """Convert a size to a standard normal number."""
        size = np.asarray(size, dtype=float)
        if self.kind == "lognormal":
            return np.log(size / self.centre) / self.spread
        return (size - self.centre) / self.spread

    def with_interval(self, z: float, sd: float) -> list[float]:
        """Return the size at z, and at the ends of its 90 % interval if z has a standard deviation."""
        return [float(self.from_standard(z + k * sd)) for k in (0.0, -Z_90, Z_90)]

    @property
    def prior(self) -> str:
        """Description of the prior in words."""
        if self.kind == "lognormal":
            return f"log-normal, median {self.centre:g}, sd of the logarithm {self.spread:g}"
        return f"normal, mean {self.centre:g}, sd {self.spread:g}"


@dataclass(frozen=True)
class Series:
    """One block of predictions: one quantity at one location under one condition.

    time: (k,) s within the cycle for waveforms, None for mean, min and max. period: s. pullback: places of the readings
    of a wire that was pulled through several vessels; `location` is then its path. readings: those of which the values
    at `time` are averages. scale: usual size of what its sensor reads, CGS, to which offsets are relative.
    """

    condition: str
    quantity: str
    location: str
    statistic: str
    time: np.ndarray | None
    period: float
    pullback: Pullback | None = field(default=None, kw_only=True)
    readings: Readings | None = field(default=None, kw_only=True)
    scale: float | None = field(default=None, kw_only=True)

    @property
    def channel(self) -> Channel:
        return self.quantity, self.location

    @property
    def sample_times(self) -> np.ndarray:
        """Times of the samples of a waveform; raises `ValueError` for another series."""
        if self.time is None:
            raise ValueError(f"{self.quantity} at {self.location} is not a waveform")
        return self.time

    def sampled(self, waves: np.ndarray, duration: float, late: np.ndarray) -> np.ndarray:
        """Return the values (n, k) of a waveform read from waves (n, points) over a duration, each later by (n,), s."""
        if self.readings is None:
            return interpolated(waves, duration, self.sample_times, late, self.period)
        return self.readings.averaged(interpolated(waves, duration, self.readings.times, late, self.period))


@dataclass(frozen=True)
class ConditionState:
    """State of the condition under which an effect acts.

    resistance_scale: `coronary_resistance_scale` of the condition. period: s. bed_pressure: mean pressure (n,) at each
    bed, for effects with feedback. reference_pressure: mean pressure at each bed in the reference run of the model.
    covariates: measured waveforms that are not boundary conditions, such as `LV` → (t, value).
    """

    resistance_scale: float
    period: float
    bed_pressure: Mapping[str, np.ndarray]
    reference_pressure: Mapping[str, float]
    covariates: Mapping[str, tuple[np.ndarray, np.ndarray]]


class Effect(ABC):
    """One physical effect that a model may be missing.

    Effects on the network override `changes` (and `insert`, `aliases` if they add elements). Effects on the
    measurements override `observe`, which acts on predicted values, or one that acts on the simulated waveform: `read`
    (and `elsewhere`), or `delay`. A subclass with a `formula` gets sections on its formula, parameters and source in
    its docstring.

    Attributes
    ----------
    name, formula, source
        Name in tables and settings, governing equation and reference.
    signature
        How the effect appears in the data.
    native
        How a repaired network expresses it in svZeroDSolver's format.
    parameters
        Sizes with units and priors.
    side
        Whether it acts on the network or on the measurements.
    grafted
        True if `insert` adds vessels that carry almost no flow until `changes` opens them, so that one network can
        hold the vessels of many effects.
    beyond_probes
        True if the added vessels are distal to the probes at the ends of vessels, behind those of other effects.
    feedback
        True if `changes` needs the mean pressures at the beds, which takes repeated runs.
    acts_as_source
        True if it acts on all else as a flow out of one node would.
    changes_shape
        True if the response changes its shape with the size, so that a small size does not predict a large one: the
        change by a delay of a quarter of the period differs in shape from that by a short delay.
    across_conditions
        True if `observe` needs the predictions of all conditions, not only of those whose readings are wanted.
    recalibrated
        True if a parameter that is recalibrated has the same effect, with a narrower prior; it has to move back.
    nameable
        False for a wiring error of the model: if it explains best, the missing cause is not an effect.
    """

    name: ClassVar[str]
    formula: ClassVar[str]
    source: ClassVar[str]
    signature: ClassVar[str]
    native: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    side: ClassVar[Literal["network", "measurement"]] = "network"
    grafted: ClassVar[bool] = False
    beyond_probes: ClassVar[bool] = False
    feedback: ClassVar[bool] = False
    acts_as_source: ClassVar[bool] = False
    changes_shape: ClassVar[bool] = False
    across_conditions: ClassVar[bool] = False
    recalibrated: ClassVar[bool] = False
    nameable: ClassVar[bool] = True

    def __init_subclass__(cls) -> None:
        if "formula" in vars(cls):
            rows = "".join(f"{p.name} [{p.unit}]\n    {p.meaning}; prior {p.prior}\n" for p in cls.parameters)
            cls.__doc__ = (
                f"{inspect.getdoc(cls)}\n\nFormula: {cls.formula}\n\nParameters\n----------\n{rows}\n"
                f"References\n----------\n{cls.source}\n"
            )

    @property
    def is_measurement_error(self) -> bool:
        """Whether this is an error of an instrument, so that a size far outside its prior is implausible."""
        return self.side == "measurement"

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        """List the places where the effect may act.

        Parameters
        ----------
        anatomy
            Anatomy of the network.
        observed
            Measured series, on which effects on the measurements act.

        Returns
        -------
        list of str
            Names of vessels, beds or locations of the network, or of groups of them.
        """
        raise NotImplementedError

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        """Return the network with the elements that the effect needs, in a state that does not disturb the flow."""
        return network.deep_copy()

    def inserts(self, place: str, anatomy: Anatomy) -> bool:
        """Whether `insert` adds anything at that place."""
        return type(self).insert is not Effect.insert

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        """Return old name → new name of every location that `insert` renames."""
        return {}

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        """Return the solver parameters of the network with the effect.

        Parameters
        ----------
        network
            Network under the condition, with the elements of `insert`; its values are the starting point.
        place
            One of `places`.
        sizes
            Parameter name → sizes (n,).
        anatomy
            Anatomy of the network without the effect, with its reference pressure and flows.
        condition
            State of the condition.

        Returns
        -------
        dict
            "BLOCK.parameter" → values (n,), or waveforms (n, WAVE_POINTS), in the network's units.
        """
        return {}

    def extent(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> tuple[str, float, float] | None:
        """Return the added vessel of a loss within a vessel, and its start and end in it, cm; None without one."""
        return None

    exchanges: ClassVar[bool] = False
    """Whether two readings are exchanged, which is like an exchange of data."""

    @property
    def reads_elsewhere(self) -> bool:
        """Whether a reading contains a waveform of another location."""
        return type(self).elsewhere is not Effect.elsewhere

    @property
    def reads_waveforms(self) -> bool:
        """Whether it acts on simulated waveforms, before they are sampled or averaged."""
        return type(self).read is not Effect.read or type(self).delay is not Effect.delay

    def delay(self, place: str, sizes: Values, series: Series) -> np.ndarray:
        """Return by how much later a waveform is read than stated, (n,), s."""
        return np.zeros(1)

    def elsewhere(self, place: str, series: Series, anatomy: Anatomy) -> Channel | None:
        """Return quantity and location of the other waveform that the reading of a series contains; None without."""
        return None

    def read(
        self,
        place: str,
        sizes: Values,
        series: Series,
        wave: np.ndarray,
        other: np.ndarray | None,
        anatomy: Anatomy,
    ) -> np.ndarray:
        """Return a simulated waveform as the affected instrument would read it.

        Parameters
        ----------
        place, sizes
            One of `places`, and sizes (n,).
        series
            The series that the instrument reads.
        wave
            (n, k) on an even grid over the cycle without its end, in the network's units.
        other
            The waveform `elsewhere`, as simulated, in the same form.
        anatomy
            Anatomy of the network without effects.

        Returns
        -------
        np.ndarray
            (n, k); `wave` itself if the series is not affected.
        """
        return wave

    def observe(
        self, place: str, sizes: Values, series: Sequence[Series], predicted: list[np.ndarray]
    ) -> list[np.ndarray]:
        """Return the predictions (n, k) of each series as the affected instrument would read them."""
        return predicted

    def describe(self, parameter: Parameter, size: float, anatomy: Anatomy) -> tuple[str, float]:
        """Return the description of a size in this network, and its value in these terms."""
        return parameter.meaning, size

    def with_intervals(self, mean: ArrayLike, covariance: ArrayLike) -> list[dict[str, Any]]:
        """Return name, meaning and unit of every size, its value at the mean (k,) of z, and its 90 % interval."""
        sd = np.sqrt(np.diag(np.asarray(covariance)))
        each = zip(self.parameters, map(Parameter.with_interval, self.parameters, np.asarray(mean), sd), strict=True)
        return [
            {"name": one.name, "meaning": one.meaning, "unit": one.unit, "value": value, "low": low, "high": high}
            for one, (value, low, high) in each
        ]

    def assumption(self, anatomy: Anatomy, covariates: list[dict]) -> str:
        """Return a sentence on the waveform assumed where no measured one is given, or an empty string."""
        return ""

    def physical(self, place: str, sizes: dict[str, float], anatomy: Anatomy) -> dict[str, float]:
        """Return the sizes in physical terms, in the network's units, for the report."""
        return dict(sizes)
