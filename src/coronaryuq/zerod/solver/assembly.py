"""The system E ẏ + F y + c = 0 that the elements write: its structure, and its values for every sample of a batch."""

from dataclasses import dataclass, field

import numpy as np

from coronaryuq.case.network.network import HEART
from coronaryuq.zerod.network.numbering import PERIOD, Block, Model

# Fourier modes (cos, sin) of the ventricles' normalised elastance, as in svZeroDSolver.
ELASTANCE_MODES = np.array(
    [
        *[(0.283748803, 0.000000000), (0.031830626, -0.374299825), (-0.209472400, -0.018127770)],
        *[(0.020520047, 0.073971113), (0.008316883, -0.047249597), (-0.041677660, 0.003212163)],
        *[(0.000867323, 0.019441411), (-0.001675379, -0.005565534), (-0.011252277, 0.003401432)],
        *[(-0.000414677, 0.008376795), (0.000253749, -0.000071880), (-0.002584966, 0.001566861)],
        *[(0.000584752, 0.003143555), (0.000028502, -0.000024787), (0.000022961, -0.000007476)],
        *[(0.000018735, -0.000001281), (0.000015573, 0.000001781), (0.000013133, 0.000003494)],
        *[(0.000011199, 0.000004507), (0.000009634, 0.000005117), (0.000008343, 0.000005481)],
        *[(0.000007265, 0.000005687), (0.000006354, 0.000005789), (0.000005575, 0.000005821)],
        *[(0.000004903, 0.000005805)],
    ]
)


class Context:
    """Parameter values (samples,) and times of the steps of one cycle, for which elements are written.

    phases: time of each step over the cardiac period, (times,). Waveforms are read at phase times nominal period, so a
    changed period stretches them; activation and elastance use the sample's own period.
    """

    def __init__(
        self,
        model: Model,
        parameters: dict[str, np.ndarray],
        samples: int,
        phases: np.ndarray,
        steady: bool = False,
        offsets: dict[str, np.ndarray] | None = None,
    ):
        self.model, self.samples, self.phases, self.steady = model, samples, phases, steady
        self._parameters, self._offsets = parameters, offsets or {}
        self.period = self._value(PERIOD, model.period)
        self.time_in_cycle = np.fmod(phases, 1.0) * self.period[:, None]

    def _value(self, name: str, nominal: float) -> np.ndarray:
        value = self._parameters.get(name)
        if value is None:
            return np.full(self.samples, nominal)
        return np.broadcast_to(np.asarray(value, float), (self.samples,))

    def values(self, block: Block, *names: str) -> list[np.ndarray]:
        return [self._value(f"{block.name}.{name}", block.scalars[name]) for name in names]

    @property
    def heart(self) -> Block:
        return self.model.blocks[HEART]

    def offset(self, block: Block) -> np.ndarray:
        return np.broadcast_to(self._offsets.get(block.name, 1.0), (self.samples,))

    def series(self, block: Block, name: str) -> np.ndarray:
        """Return a waveform at the steps: (1, times), the same for all samples, or (samples, times) if changed."""
        if self.steady:
            return np.repeat(self.series_start(block, name, True)[:, None], self.phases.size, axis=1)
        changed = self._parameters.get(f"{block.name}.{name}")
        if changed is None:
            return block.series[name](self.phases * self.model.period)[None, :]
        grid, phases = np.linspace(0.0, 1.0, changed.shape[1]), np.fmod(self.phases, 1.0)
        return np.array([np.interp(phases, grid, row) for row in changed])

    def series_start(self, block: Block, name: str, steady: bool) -> np.ndarray:
        """Return a waveform's value at time 0, or its plain mean for a steady state: (1,) or (samples,)."""
        changed, series = self._parameters.get(f"{block.name}.{name}"), block.series[name]
        if changed is None:
            return np.array([series.mean if steady else float(series(np.zeros(1))[0])])
        return changed.mean(axis=1) if steady else changed[:, 0]

    def atrial_activation(self, block: Block) -> np.ndarray:
        """Return A(t), (samples, times)."""
        tsa, tpwave = (value[:, None] for value in self.values(block, "Tsa", "tpwave"))
        period, time = self.period[:, None], self.time_in_cycle
        tsa, tpwave = period * tsa, period / tpwave
        first = 0.5 * (1.0 - np.cos(2.0 * np.pi * (time - tpwave + tsa) / tsa))
        late = 0.5 * (1.0 - np.cos(2.0 * np.pi * (time - tpwave - (period - tsa)) / tsa))
        return np.where(time <= tpwave, first, np.where(time >= period - tsa + tpwave, late, 0.0))

    @property
    def ventricular_elastance(self) -> np.ndarray:
        """Normalised elastance, (1, times)."""
        return fourier_elastance(self.phases)[None, :]


def fourier_elastance(phases: np.ndarray) -> np.ndarray:
    """Evaluate the ventricles' normalised elastance at times (times,) over the cardiac period."""
    angle = 2.0 * np.pi * np.arange(len(ELASTANCE_MODES))[:, None] * np.fmod(phases, 1.0)
    return (ELASTANCE_MODES[:, :1] * np.cos(angle) - ELASTANCE_MODES[:, 1:] * np.sin(angle)).sum(axis=0)


@dataclass
class Terms:
    """Terms of one kind: integer columns that are structure, and coefficients (samples,) that are values."""

    where: list[tuple[int, ...]] = field(default_factory=list)
    coefficients: list[tuple[np.ndarray | float, ...]] = field(default_factory=list)

    def add(self, where: tuple[int, ...], *coefficients: np.ndarray | float) -> None:
        self.where.append(where)
        self.coefficients.append(coefficients)


class Assembly:
    """Terms in the order in which elements write them; the order is the same for every batch of one model.

    Linear terms: `e`, `f` (row, column), `constant` (row); `f_lagged` (row, column) belongs to F but not to Newton's
    Jacobian; `f_time`, `e_time` (row, column, shape), `c_time` (row, shape)
    multiply a shape over time; `f_valve` (row, column, valve). Solution-dependent terms: `square` (row, column) for
    a |y| y, `square_rate` (row, column) for a |y| ẏ, `exponentials` (row, column, shape) for
    shape · Kxp (exp(Kxv (y − rest)) − 1), `f_gate` (row, column, gate) for a s y, `constant_gate` (row, gate) for a s,
    with s = (1 + tanh(k (P_downstream − P_upstream))) / 2 of a gate of steepness k, or a step where k is 0;
    `gate_slope` (row, pressure, gate, column or -1) are their derivatives with respect to the pressures.
    `shapes`: arrays (samples or 1, times). `valves`: (upstream pressure, downstream pressure, flow). `gates`: (upstream
    pressure, downstream pressure), of `steepness` (samples,).
    """

    def __init__(self):
        self.e, self.f, self.constant = Terms(), Terms(), Terms()
        self.f_lagged = Terms()
        self.e_time, self.f_time, self.constant_time = Terms(), Terms(), Terms()
        self.f_valve, self.square, self.square_rate, self.exponentials = Terms(), Terms(), Terms(), Terms()
        self.f_gate, self.constant_gate, self.gate_slope = Terms(), Terms(), Terms()
        self.gates: list[tuple[int, int]] = []
        self.steepness: list[np.ndarray | float] = []
        self.shapes: list[np.ndarray] = []
        self.valves: list[tuple[int, int, int]] = []
        self._shape_number: dict[int, int] = {}

    def E(self, row, column, value):
        self.e.add((row, column), value)

    def F(self, row, column, value):
        self.f.add((row, column), value)

    def F_lagged(self, row, column, value):
        self.f_lagged.add((row, column), value)

    def c(self, row, value):
        self.constant.add((row,), value)

    def E_time(self, row, column, value, shape):
        self.e_time.add((row, column, self._shape(shape)), value)

    def F_time(self, row, column, value, shape):
        self.f_time.add((row, column, self._shape(shape)), value)

    def c_time(self, row, value, shape):
        self.constant_time.add((row, self._shape(shape)), value)

    def F_valve(self, row, column, value, valve):
        self.f_valve.add((row, column, valve), value)

    def quadratic(self, row, column, value):
        self.square.add((row, column), value)

    def quadratic_rate(self, row, column, value):
        self.square_rate.add((row, column), value)

    def exponential(self, row, column, scale, rate, rest, shape):
        self.exponentials.add((row, column, self._shape(shape)), scale, rate, rest)

    def valve(self, upstream: int, downstream: int, flow: int) -> int:
        self.valves.append((upstream, downstream, flow))
        return len(self.valves) - 1

    def gate(self, upstream: int, downstream: int, steepness: np.ndarray | float) -> int:
        self.gates.append((upstream, downstream))
        self.steepness.append(steepness)
        return len(self.gates) - 1

    def F_gate(self, row, column, value, gate):
        self.f_gate.add((row, column, gate), value)
        self._gate_slopes(row, gate, column, value)

    def c_gate(self, row, value, gate):
        self.constant_gate.add((row, gate), value)
        self._gate_slopes(row, gate, -1, value)

    def _gate_slopes(self, row, gate, column, value):
        upstream, downstream = self.gates[gate]
        self.gate_slope.add((row, upstream, gate, column), -value)
        self.gate_slope.add((row, downstream, gate, column), value)

    def _shape(self, shape: np.ndarray) -> int:
        if id(shape) not in self._shape_number:
            self._shape_number[id(shape)] = len(self.shapes)
            self.shapes.append(shape)
        return self._shape_number[id(shape)]
