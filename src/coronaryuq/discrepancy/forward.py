"""Predictions of every measured series by a network with effects, under all conditions, in one batch of samples."""

import copy
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from coronaryuq import units
from coronaryuq.discrepancy.conditions import HEART, Condition, period_of, under
from coronaryuq.discrepancy.measurements import Measured
from coronaryuq.discrepancy.nuisance import Nuisance
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Situation
from coronaryuq.zerod.engine import Engine

Acting = tuple[Effect, str]
"""An effect at a place."""

FEEDBACK_ROUNDS = 3
MOST_ENGINES = 150
TOLERANCE = 1e-4
"""Cycle error of a run: well below the change that a finite difference of the sensitivities looks for."""

LOOSE, MOST_CYCLES = 5e-3, 40
"""Cycle error that will do where valves that open a step earlier or later keep a run from settling to `TOLERANCE`."""


@dataclass
class _Prepared:
    """An engine of one structure under one condition, and the periodic state of its own values.

    Every sample starts there, so that in a closed loop all hold the blood that the model as it is holds.
    """

    engine: Engine
    network: dict
    renamed: dict[str, str]
    start: np.ndarray | None


@dataclass
class Forward:
    """The analyst's model of one case: network, conditions, measured series, nuisance parameters.

    `predict(z, acting)` takes z (n, p): standard numbers of the nuisance parameters, then of the parameters of each
    acting effect in turn; it returns (n, N) in CGS, series after series, NaN where a run failed.
    """

    network: dict
    conditions: dict[str, Condition]
    measured: list[Measured]
    nuisances: list[Nuisance]
    anatomy: Anatomy
    pressure_factor: float
    steps_per_cycle: int
    threads: int = 1
    periods: dict[str, float] = field(default_factory=dict)
    resting: dict[str, float] = field(default_factory=dict)
    masses: dict[str, float] = field(default_factory=dict)
    alter: Callable[[dict, str], dict] | None = None
    """A further change of the network under a condition; hidden cases outside the library use it."""
    runs: int = 0
    _engines: dict = field(default_factory=dict)

    @property
    def size(self) -> int:
        return sum(series.value.size for series in self.measured)

    def parameters(self, acting: list[Acting]) -> list:
        """Parameters of the acting effects, in the order of z after the nuisance parameters."""
        return [parameter for effect, _ in acting for parameter in effect.parameters]

    def predict(self, z: np.ndarray, acting: list[Acting] = ()) -> np.ndarray:
        """Predictions (n, N) at z (n, p), all with the same effects."""
        return self.predict_rows([(row, list(acting)) for row in np.atleast_2d(z)])

    def predict_rows(self, rows: list[tuple[np.ndarray, list[Acting]]]) -> np.ndarray:
        """Predictions (n, N) at one point z (p,) each, every row with its own effects.

        Rows whose networks have the same elements share one batch; a row's numbers do not depend on the others.
        """
        found = np.full((len(rows), self.size), np.nan)
        groups: dict[tuple, list[int]] = {}
        for number, (_, acting) in enumerate(rows):
            groups.setdefault(_elements(acting), []).append(number)
        for numbers in groups.values():
            found[numbers] = self._predict_group([rows[i] for i in numbers])
        for number, (z, acting) in enumerate(rows):
            if any(effect.side == "measurement" for effect, _ in acting):
                found[number] = self._observe(found[number], z, acting)
        return found

    def _predict_group(self, rows) -> np.ndarray:
        sizes = [self._sizes(z, acting) for z, acting in rows]
        blocks: list[np.ndarray | None] = [None] * len(self.measured)
        for name, condition in self.conditions.items():
            mine = [i for i, series in enumerate(self.measured) if series.condition == name]
            if mine:
                for i, values in zip(mine, self._simulate(condition, rows, sizes, mine), strict=True):
                    blocks[i] = values
        return np.concatenate(blocks, axis=1)

    def _observe(self, row: np.ndarray, z, acting: list[Acting]) -> np.ndarray:
        blocks = self.split(row[None, :])
        for (effect, place), values in zip(acting, self._sizes(z, acting), strict=True):
            if effect.side == "measurement":
                blocks = effect.observe(place, {k: np.array([v]) for k, v in values.items()}, self.measured, blocks)
        return np.concatenate(blocks, axis=1)[0]

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Columns of (n, N), series by series."""
        ends = np.cumsum([series.value.size for series in self.measured])
        return np.split(values, ends[:-1], axis=1)

    def _sizes(self, z: np.ndarray, acting: list[Acting]) -> list[dict[str, float]]:
        column, found = len(self.nuisances), []
        for effect, _ in acting:
            values = {}
            for parameter in effect.parameters:
                values[parameter.name] = float(parameter.from_standard(z[column]))
                column += 1
            found.append(values)
        return found

    def structure(self, acting: list[Acting]) -> tuple[dict, dict[str, str]]:
        """The rest network with the elements of the acting effects, and old → new names of locations."""
        network, renamed = self.network, {}
        for effect, place in acting:
            anatomy = Anatomy(network, self.anatomy.pressure, self.anatomy.flow, self.anatomy.period)
            fresh = effect.aliases(place, anatomy)
            network = effect.insert(network, place, anatomy)
            renamed = {old: fresh.get(new, new) for old, new in renamed.items()} | {
                old: new for old, new in fresh.items() if old not in renamed.values()
            }
        return network, renamed

    def _engine(self, condition: Condition, acting: list[Acting]) -> "_Prepared":
        key = (condition.name, _elements(acting))
        if key not in self._engines:
            if len(self._engines) > MOST_ENGINES:
                self._engines.clear()
            network, renamed = self.structure([one for one in acting if _inserts(one[0])])
            network = under(network, condition)
            if self.alter is not None:
                network = self.alter(network, condition.name)
            engine = Engine(network)
            nominal = engine.run(periodic=True, steps_per_cycle=self.steps_per_cycle, tolerance=TOLERANCE)
            start = nominal.state[0] if nominal.ok[0] else None
            self._engines[key] = _Prepared(engine, network, renamed, start)
            self.runs += 1
        return self._engines[key]

    def _simulate(self, condition, rows, sizes, mine):
        prepared = self._engine(condition, rows[0][1])
        network, renamed = prepared.network, prepared.renamed
        n = len(rows)
        wanted = [self._variable(self.measured[i], renamed) for i in mine]
        names = [name for pair in wanted for name in pair]
        beds = {bed: renamed.get(f"{v}:{bed}", f"{v}:{bed}") for bed, v in self.anatomy.beds.items()}
        rounds = FEEDBACK_ROUNDS if any(effect.feedback for _, acting in rows for effect, _ in acting) else 1
        if rounds > 1:
            names += [f"pressure:{at}" for at in beds.values()]
        names = list(dict.fromkeys(names))
        pressure = [dict(self.resting) for _ in rows]
        for _ in range(rounds):
            tables = [
                self._changes(network, condition, z, acting, values, felt)
                for (z, acting), values, felt in zip(rows, sizes, pressure, strict=True)
            ]
            waveforms, time, alive = self._run(prepared, tables, names)
            if rounds > 1:
                means = {bed: waveforms[f"pressure:{at}"][:, :-1].mean(axis=1) for bed, at in beds.items()}
                pressure = [{bed: float(means[bed][i]) for bed in beds} for i in range(n)]
        z = np.array([row[: len(self.nuisances)] for row, _ in rows])
        found = []
        for i, pair in zip(mine, wanted, strict=True):
            values = self._series(self.measured[i], [waveforms[name] for name in pair], time, z)
            values[~alive] = np.nan
            found.append(values)
        return found

    def changes_at(self, network: dict, condition: Condition, z: np.ndarray, acting: list[Acting]) -> dict:
        """Changes "BLOCK.parameter" → value that a point z (p,) means for a network under a condition.

        `network` holds the elements of the acting effects. Feedback effects see the pressures of the fitted model.
        """
        pressure = dict(self.resting)
        if any(effect.feedback for effect, _ in acting) and condition.name in self.periods:
            pressure = self._felt(condition, z, acting)
        return self._changes(network, condition, z, acting, self._sizes(z, acting), pressure)

    def _felt(self, condition, z, acting) -> dict[str, float]:
        """Mean pressures at the beds that a feedback effect settles at."""
        prepared = self._engine(condition, acting)
        beds = {bed: f"{v}:{bed}" for bed, v in self.anatomy.beds.items()}
        names = {bed: f"pressure:{prepared.renamed.get(at, at)}" for bed, at in beds.items()}
        pressure = dict(self.resting)
        for _ in range(FEEDBACK_ROUNDS - 1):
            table = self._changes(prepared.network, condition, z, acting, self._sizes(z, acting), pressure)
            waveforms, _, _ = self._run(prepared, [table], list(names.values()))
            pressure = {bed: float(waveforms[name][0, :-1].mean()) for bed, name in names.items()}
        return pressure

    def _changes(self, network, condition, z, acting, sizes, pressure) -> dict[str, np.ndarray]:
        """Engine changes of one sample: nuisance factors and all effects on top of the network's own values.

        Two effects on one parameter combine as factors of the network's value, or as sums where that is zero.
        """
        felt = {bed: np.array([value]) for bed, value in pressure.items()}
        situation = Situation(
            condition.name,
            condition.coronary_resistance_scale,
            self.periods.get(condition.name, self.anatomy.period),
            felt,
            self.resting,
            condition.covariates,
        )
        changes: dict[str, np.ndarray] = {}
        for (effect, place), values in zip(acting, sizes, strict=True):
            if effect.side == "measurement":
                continue
            values = {name: np.array([value]) for name, value in values.items()}
            for name, value in effect.changes(network, place, values, self.anatomy, situation).items():
                value = np.asarray(value, dtype=float)[0]
                if name in changes and not np.ndim(value):
                    own = parameter_value(network, name)
                    value = changes[name] * value / own if own else changes[name] + value
                changes[name] = value
        for column, nuisance in enumerate(self.nuisances):
            if nuisance.condition in (None, condition.name):
                factor = float(nuisance.factor(z[column]))
                for name in _present(network, nuisance.targets):
                    present = changes[name] if name in changes else parameter_value(network, name)
                    changes[name] = present * factor
        return changes

    def _run(self, prepared: "_Prepared", tables: list[dict], names: list[str]):
        """Waveforms name → (n, steps + 1), time (steps + 1,) and which samples ran.

        The engine changes scalars only, so samples with a waveform of their own get an engine of their own.
        """
        self.runs += len(tables)
        groups: dict[tuple, list[int]] = {}
        for number, table in enumerate(tables):
            own = tuple((name, np.asarray(v).tobytes()) for name, v in table.items() if np.ndim(v))
            groups.setdefault(own, []).append(number)
        found = {name: np.full((len(tables), self.steps_per_cycle + 1), np.nan) for name in names}
        for own, numbers in groups.items():
            engine, scalars = prepared.engine, [tables[i] for i in numbers]
            if own:
                engine = Engine(with_waveforms(prepared.network, scalars[0]))
                scalars = [{name: value for name, value in table.items() if not np.ndim(value)} for table in scalars]
            start = None if prepared.start is None else np.repeat(prepared.start[None, :], len(numbers), axis=0)
            changes = _stack(prepared.network, scalars)
            left = np.arange(len(numbers))
            for tolerance in (TOLERANCE, LOOSE):
                result = engine.run(
                    {name: value[left] for name, value in changes.items()},
                    waveforms=names,
                    periodic=True,
                    cycles=MOST_CYCLES,
                    steps_per_cycle=self.steps_per_cycle,
                    tolerance=tolerance,
                    start=None if start is None else start[left],
                    threads=self.threads,
                )
                for name in names:
                    found[name][np.asarray(numbers)[left]] = result.waveforms[name]
                left = left[~result.ok]
                if not left.size:
                    break
        alive = np.isfinite(found[names[0]]).all(axis=1)
        return found, result.time, alive

    def _variable(self, series: Measured, renamed: dict[str, str]) -> tuple[str, ...]:
        """Engine names of the waveforms that a series is made of."""
        location = renamed.get(series.location, series.location)
        if series.quantity == "perfusion":
            vessel = self.anatomy.beds[series.location]
            at = f"{vessel}:{series.location}"
            return (f"flow:{renamed.get(at, at)}",)
        if series.quantity == "ratio":
            return f"pressure:{location}", f"pressure:{self.root}"
        if ":" in location and location.split(":")[1] == HEART:
            return (location,)
        return (f"{series.quantity}:{location}",)

    def bed_pressures(self) -> dict[str, dict[str, float]]:
        """Mean pressure before every bed under every condition, of the model as it is; the network's unit."""
        names = {bed: f"pressure:{vessel}:{bed}" for bed, vessel in self.anatomy.beds.items()}
        found = {}
        for condition in self.conditions.values():
            waveforms, _, _ = self._run(self._engine(condition, []), [{}], list(names.values()))
            found[condition.name] = {bed: float(waveforms[name][0, :-1].mean()) for bed, name in names.items()}
        return found

    @property
    def root(self) -> str:
        """Location of the pressure that drives the network: the first root vessel's inlet."""
        return self.anatomy.inlet(self.anatomy.roots[0])

    def _series(self, series: Measured, waveforms: list[np.ndarray], time: np.ndarray, z: np.ndarray) -> np.ndarray:
        if series.quantity == "ratio":
            means = [values[:, :-1].mean(axis=1) for values in waveforms]
            return (means[0] / means[1])[:, None]
        values = waveforms[0] * (self.pressure_factor if series.quantity == "pressure" else 1.0)
        if series.quantity == "perfusion":
            values = values / self._mass(series.location, z)[:, None]
        if series.statistic == "waveform":
            at = series.time % series.period
            return np.array([np.interp(at, time - time[0], row) for row in values])
        reduce = {
            "mean": lambda v: v[:, :-1].mean(axis=1),
            "min": lambda v: v.min(axis=1),
            "max": lambda v: v.max(axis=1),
        }
        return reduce[series.statistic](values)[:, None]

    def _mass(self, territory: str, z: np.ndarray) -> np.ndarray:
        column = next(i for i, nuisance in enumerate(self.nuisances) if nuisance.mass == territory)
        return self.masses[territory] * self.nuisances[column].factor(z[:, column])


def _present(network: dict, targets: tuple[str, ...]) -> list[str]:
    """Targets under the names that a changed structure gives them: CORONARY_VAR_RES has two Ra2."""
    kinds = {block["bc_name"]: block["bc_type"] for block in network["boundary_conditions"]}
    found = []
    for name in targets:
        block, _, parameter = name.rpartition(".")
        varying = parameter == "Ra2" and kinds.get(block) == "CORONARY_VAR_RES"
        found += [f"{name}_min", f"{name}_max"] if varying else [name]
    return found


def _inserts(effect: Effect) -> bool:
    return type(effect).insert is not Effect.insert


def _elements(acting: list[Acting]) -> tuple:
    """What tells the structure of a network with these effects from that of another."""
    return tuple((effect.name, place) for effect, place in acting if _inserts(effect))


def _stack(network: dict, tables: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Changes of all samples, (n,) or (n, k) per parameter; where a sample has none, the network's value."""
    names = list(dict.fromkeys(name for table in tables for name in table))
    return {
        name: np.array([t[name] if name in t else parameter_value(network, name) for t in tables]) for name in names
    }


def parameter_value(network: dict, name: str):
    """Value of "BLOCK.parameter" in a network; 0 for a vessel's element that the file leaves out."""
    block, _, parameter = name.rpartition(".")
    if block == HEART:
        return network["closed_loop_blocks"][0]["parameters"][parameter]
    for vessel in network["vessels"]:
        if vessel["vessel_name"] == block:
            return vessel["zero_d_element_values"].get(parameter, 0.0)
    return next(b["bc_values"] for b in network["boundary_conditions"] if b["bc_name"] == block).get(parameter, 0.0)


def with_waveforms(network: dict, table: dict) -> dict:
    """The network with the waveforms of one sample, on an even grid over the cycle."""
    network = copy.deepcopy(network)
    for name, value in table.items():
        if np.ndim(value):
            block, _, parameter = name.rpartition(".")
            values = next(b["bc_values"] for b in network["boundary_conditions"] if b["bc_name"] == block)
            if len(values["t"]) != len(value):
                values["t"] = np.linspace(0.0, period_of(network), len(value)).tolist()
            values[parameter] = np.asarray(value, dtype=float).tolist()
    return network


def pressure_factor(unit: str, root_pressure: float) -> float:
    """dyn/cm2 per pressure unit of the network; "auto" takes mmHg where the root's mean pressure is below 1000."""
    if unit == "auto":
        return units.MMHG if abs(root_pressure) < 1000.0 else 1.0
    return units.PRESSURES[unit]
