"""Predictions of every measured series by a network with effects, under all conditions, in one batch of samples."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

from coronaryuq import units
from coronaryuq.discrepancy.conditions import HEART, Condition, under
from coronaryuq.discrepancy.measurements import Measured
from coronaryuq.discrepancy.networks import WAVE_POINTS, carried_over, differences, sampled, scalars
from coronaryuq.discrepancy.nuisance import Nuisance
from coronaryuq.discrepancy.starts import Point, Starts, Structure
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Situation
from coronaryuq.zerod.engine import Engine
from coronaryuq.zerod.result import Result

Acting = tuple[Effect, str]
"""An effect at a place."""

FEEDBACK_ROUNDS = 3
MOST_ENGINES = 150
TOLERANCE = 1e-4
"""Cycle error of a run: well below the change that a finite difference of the sensitivities looks for."""

LOOSE, MOST_CYCLES = 5e-3, 25
"""Cycle error that will do where valves that open a step earlier or later keep a run from settling to `TOLERANCE`."""
NEAR_SETTLED = 0.2
"""Cycle error below which a run that did not settle goes on from where it is."""


@dataclass
class _Prepared:
    """One structure: an engine that serves every condition, what each condition changes in it, and where runs start.

    networks, values: the network under each condition and its numbers, "BLOCK.parameter" → value.
    changes: of each condition against the engine's own network. start: periodic state (unknowns,) of each
    condition's own values, where every sample starts, so that in a closed loop all hold the blood that the model as
    it is holds.
    """

    engine: Engine
    networks: dict[str, dict]
    values: dict[str, dict[str, float]]
    changes: dict[str, dict]
    renamed: dict[str, str]
    start: dict[str, np.ndarray | None]

    @property
    def structure(self) -> Structure:
        return Structure(self.engine, self.renamed)


@dataclass(frozen=True)
class _Job:
    """One run: a point under one condition, with what it changes in the condition's network."""

    point: Point
    condition: str
    table: dict

    @property
    def key(self) -> tuple:
        """What tells two runs apart: tissue masses and other conditions' parameters need none of their own."""
        return self.condition, *((name, np.asarray(value).tobytes()) for name, value in self.table.items())


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
    _met: Starts = field(default_factory=Starts)

    @property
    def size(self) -> int:
        return sum(series.value.size for series in self.measured)

    def parameters(self, acting: list[Acting]) -> list:
        """Parameters of the acting effects, in the order of z after the nuisance parameters."""
        return [parameter for effect, _ in acting for parameter in effect.parameters]

    def predict(self, z: np.ndarray, acting: list[Acting] = ()) -> np.ndarray:
        """Predictions (n, N) at z (n, p), all with the same effects."""
        return self.predict_rows([(row, list(acting)) for row in np.atleast_2d(z)])

    def predict_rows(
        self,
        rows: list[tuple[np.ndarray, list[Acting]]],
        conditions: Collection[str] | None = None,
        grafts: list[Acting] = (),
    ) -> np.ndarray:
        """Predictions (n, N) at one point z (p,) each, every row with its own effects; NaN for other `conditions`.

        Rows whose networks have the same elements share one batch, all conditions in it. grafts: effects that share one
        network, shut but where a row acts on them, for the rows that act on one of them.
        """
        found = np.full((len(rows), self.size), np.nan)
        groups: dict[tuple, tuple[list[Acting], dict[tuple, list[int]]]] = {}
        common = [one for one in rows[0][1] if all(one in acting for _, acting in rows)]
        grafts = self._inserting(grafts)
        for number, (z, acting) in enumerate(rows):
            # What a sensor or a map does to predictions may depend on all of them.
            all_of_them = any(effect.side == "measurement" for effect, _ in acting)
            inserted = self._inserting(acting)
            if any(one in grafts and one not in common for one in inserted):
                inserted = [*grafts, *(one for one in inserted if one not in grafts)]
            # Effects that feel pressures are run more than once.
            feels = any(effect.feedback for effect, _ in acting)
            _, alike = groups.setdefault((*_elements(inserted), feels, all_of_them), (inserted, {}))
            alike.setdefault(self._simulated(z, acting), []).append(number)
        for (*_, all_of_them), (inserted, alike) in groups.items():
            wanted = [n for n in self.conditions if all_of_them or conditions is None or n in conditions]
            predicted = self._predict_group([rows[numbers[0]] for numbers in alike.values()], wanted, inserted)
            for values, numbers in zip(predicted, alike.values(), strict=True):
                found[numbers] = values
        for number, (z, acting) in enumerate(rows):
            if any(effect.side == "measurement" for effect, _ in acting):
                found[number] = self._observe(found[number], z, acting)
        return found

    def _inserting(self, acting: Collection[Acting]) -> list[Acting]:
        """Those that add elements to the network."""
        return [(effect, place) for effect, place in acting if effect.inserts(place, self.anatomy)]

    def _simulated(self, z: np.ndarray, acting: list[Acting]) -> tuple:
        """What tells two runs of the network apart: effects on the measuring side need none of their own."""
        sizes = self._sizes(z, acting)
        network = [
            (e.name, place, *v.values()) for (e, place), v in zip(acting, sizes, strict=True) if e.side == "network"
        ]
        return z[: len(self.nuisances)].tobytes(), *network

    def _predict_group(self, rows, names: list[str], inserted: list[Acting]) -> np.ndarray:
        sizes = [self._sizes(z, acting) for z, acting in rows]
        z = np.array([row[: len(self.nuisances)] for row, _ in rows])
        blocks = [np.full((len(rows), series.value.size), np.nan) for series in self.measured]
        waveforms, renamed = self._simulate(rows, sizes, names, inserted)
        for i, series in enumerate(self.measured):
            if series.condition in names:
                waves = waveforms[series.condition]
                time = np.linspace(0.0, self.periods.get(series.condition, series.period), self.steps_per_cycle + 1)
                used = [waves[name] for name in self._variable(series, renamed)]
                blocks[i] = self._series(series, used, time, z)
                blocks[i][~np.isfinite(used[0]).all(axis=1)] = np.nan
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

    def _prepared(self, acting: list[Acting]) -> _Prepared:
        inserted = self._inserting(acting)
        key = _elements(inserted)
        if key not in self._engines:
            if len(self._engines) > MOST_ENGINES:
                self._engines.clear()
            structure, renamed = self.structure(inserted)
            networks = {name: under(structure, condition) for name, condition in self.conditions.items()}
            if self.alter is not None:
                networks = {name: self.alter(network, name) for name, network in networks.items()}
            own = next(iter(networks.values()))
            values = {name: scalars(network) for name, network in networks.items()}
            changes = {name: differences(own, network) for name, network in networks.items()}
            prepared = _Prepared(Engine(own), networks, values, changes, renamed, {})
            prepared.start = self._starts(prepared, inserted)
            self._engines[key] = prepared
        return self._engines[key]

    def _starts(self, prepared: _Prepared, inserted: list[Acting]) -> dict[str, np.ndarray | None]:
        """Periodic states of the conditions' own values; a changed structure takes them over by name."""
        if inserted and self.alter is None:
            plain = self._prepared([])
            return {
                name: None
                if state is None
                else carried_over(plain.engine.state_names, state, prepared.engine.state_names, prepared.renamed)
                for name, state in plain.start.items()
            }
        prepared.start = dict.fromkeys(prepared.networks)
        nominal = prepared.engine.run(
            _stack(prepared, [_Job(self._point(), name, {}) for name in prepared.networks]),
            periodic=True,
            steps_per_cycle=self.steps_per_cycle,
            tolerance=TOLERANCE,
        )
        self.runs += len(prepared.networks)
        settled = nominal.cycle_error < LOOSE
        return {name: nominal.state[i] if settled[i] else None for i, name in enumerate(prepared.networks)}

    def _simulate(self, rows, sizes, conditions: list[str], inserted: list[Acting]) -> tuple[dict, dict[str, str]]:
        """Waveforms, condition → engine name → (rows, steps + 1), of all rows; and renamed locations."""
        prepared = self._prepared(inserted)
        renamed = prepared.renamed
        names = [
            n for series in self.measured if series.condition in conditions for n in self._variable(series, renamed)
        ]
        beds = {bed: f"pressure:{renamed.get(f'{v}:{bed}', f'{v}:{bed}')}" for bed, v in self.anatomy.beds.items()}
        rounds = FEEDBACK_ROUNDS if any(effect.feedback for _, acting in rows for effect, _ in acting) else 1
        names = list(dict.fromkeys(names + (list(beds.values()) if rounds > 1 else [])))
        felt = {name: [dict(self.resting) for _ in rows] for name in conditions}
        for _ in range(rounds):
            jobs = [
                _Job(self._point(z, acting), name, self._changes(prepared, name, z, acting, values, felt[name][i]))
                for name in conditions
                for i, ((z, acting), values) in enumerate(zip(rows, sizes, strict=True))
            ]
            found = self._run(prepared, jobs, names)
            waveforms = {
                name: {key: wave[k * len(rows) : (k + 1) * len(rows)] for key, wave in found.items()}
                for k, name in enumerate(conditions)
            }
            if rounds > 1:
                for name in conditions:
                    means = {bed: waveforms[name][at][:, :-1].mean(axis=1) for bed, at in beds.items()}
                    felt[name] = [{bed: float(means[bed][i]) for bed in beds} for i in range(len(rows))]
        return waveforms, renamed

    def condition_changes(self, name: str, z: np.ndarray, acting: list[Acting]) -> tuple[dict, dict]:
        """What a point z (p,) means under one condition: changes "BLOCK.parameter" → value, and the network changed.

        Feedback effects see the pressures that the fitted model settles at.
        """
        prepared = self._prepared(acting)
        pressure, sizes = dict(self.resting), self._sizes(z, acting)
        if any(effect.feedback for effect, _ in acting):
            beds = {bed: f"{v}:{bed}" for bed, v in self.anatomy.beds.items()}
            at = {bed: f"pressure:{prepared.renamed.get(place, place)}" for bed, place in beds.items()}
            for _ in range(FEEDBACK_ROUNDS - 1):
                table = self._changes(prepared, name, z, acting, sizes, pressure)
                waves = self._run(prepared, [_Job(self._point(z, acting), name, table)], list(at.values()))
                pressure = {bed: float(waves[place][0, :-1].mean()) for bed, place in at.items()}
        return self._changes(prepared, name, z, acting, sizes, pressure), prepared.networks[name]

    def _changes(self, prepared: _Prepared, name: str, z, acting, sizes, pressure) -> dict[str, np.ndarray | float]:
        """Changes of one sample: nuisance factors and all effects on top of the values under a condition.

        Two effects on one parameter combine as factors of the network's value, or as sums where that is zero.
        """
        condition, network, own = self.conditions[name], prepared.networks[name], prepared.values[name]
        felt = {bed: np.array([value]) for bed, value in pressure.items()}
        situation = Situation(
            condition.name,
            condition.coronary_resistance_scale,
            self.periods.get(condition.name, self.anatomy.period),
            felt,
            self.resting,
            condition.covariates,
        )
        changes: dict[str, np.ndarray | float] = {}
        for (effect, place), values in zip(acting, sizes, strict=True):
            if effect.side == "measurement":
                continue
            values = {name: np.array([value]) for name, value in values.items()}
            for key, value in effect.changes(network, place, values, self.anatomy, situation).items():
                value = np.asarray(value, dtype=float)[0]
                if key in changes and not np.ndim(value):
                    before = own.get(key, 0.0)
                    value = changes[key] * value / before if before else changes[key] + value
                changes[key] = value
        for column, nuisance in enumerate(self.nuisances):
            if nuisance.condition in (None, condition.name):
                factor = float(nuisance.factor(z[column]))
                for key in nuisance.targets:
                    # CORONARY_VAR_RES has two Ra2 where CORONARY has one.
                    for name in (key,) if key in own else (f"{key}_min", f"{key}_max"):
                        changes[name] = (changes[name] if name in changes else own[name]) * factor
        return changes

    def _point(self, z: np.ndarray | None = None, acting: Collection[Acting] = ()) -> Point:
        """Where a run stands; without z the model as it is."""
        count = len(self.nuisances)
        if z is None:
            return Point(np.zeros(count), {})
        sizes, column = {}, count
        for effect, place in acting:
            if effect.side == "network":
                sizes[effect.name, place] = z[column : column + len(effect.parameters)]
            column += len(effect.parameters)
        return Point(np.where([n.mass is None for n in self.nuisances], z[:count], 0.0), sizes)

    def _run(self, prepared: _Prepared, jobs: list[_Job], names: list[str]) -> dict[str, np.ndarray]:
        """Waveforms name → (jobs, steps + 1); NaN where a run failed."""
        seat: dict[tuple, int] = {}
        seats = [seat.setdefault(job.key, len(seat)) for job in jobs]
        found = self._run_each(prepared, [jobs[seats.index(k)] for k in range(len(seat))], names)
        return {name: waves[seats] for name, waves in found.items()}

    def _run_each(self, prepared: _Prepared, jobs: list[_Job], names: list[str]) -> dict[str, np.ndarray]:
        self.runs += len(jobs)
        found = {name: np.full((len(jobs), self.steps_per_cycle + 1), np.nan) for name in names}
        starts = [prepared.start[job.condition] for job in jobs]
        own = None if any(state is None for state in starts) else np.array(starts)
        for numbers in _batches(prepared, jobs):
            changes, left = _stack(prepared, [jobs[i] for i in numbers]), np.array(numbers)
            start = None if own is None else self._start(prepared, [jobs[i] for i in numbers], own[left], changes)
            for tolerance in (TOLERANCE, LOOSE, LOOSE):
                mine = np.isin(numbers, left)
                result = prepared.engine.run(
                    {name: value[mine] for name, value in changes.items()},
                    waveforms=names,
                    periodic=True,
                    cycles=MOST_CYCLES,
                    steps_per_cycle=self.steps_per_cycle,
                    tolerance=tolerance,
                    start=start,
                    threads=self.threads,
                )
                for name in names:
                    found[name][left] = result.waveforms[name]
                self._remember(prepared, [jobs[i] for i in left], result)
                again = tolerance == LOOSE
                start = None if own is None else own[left[~result.ok]] if again else _from_there(result, own[left])
                left = left[~result.ok]
                if not left.size:
                    break
        return found

    def _start(self, prepared: _Prepared, jobs: list[_Job], own: np.ndarray, changes: dict) -> np.ndarray:
        """Where the runs start; in an open loop, which forgets, by the model as it is."""
        if not self.anatomy.closed_loop or self.alter is not None:
            return own
        conditions, points = [job.condition for job in jobs], [job.point for job in jobs]
        return self._met.near(conditions, points, prepared.structure, own, changes)

    def _remember(self, prepared: _Prepared, jobs: list[_Job], result: Result) -> None:
        if self.anatomy.closed_loop and self.alter is None:
            for job, ok, state in zip(jobs, result.ok, result.state, strict=True):
                if ok:
                    self._met.keep(job.condition, job.point, prepared.structure, state)

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
        jobs = [_Job(self._point(), name, {}) for name in self.conditions]
        waves = self._run(self._prepared([]), jobs, list(names.values()))
        return {
            job.condition: {bed: float(waves[name][i, :-1].mean()) for bed, name in names.items()}
            for i, job in enumerate(jobs)
        }

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


def _elements(inserted: list[Acting]) -> tuple:
    """What tells the structure of a network with these effects from that of another."""
    return tuple((effect.name, place) for effect, place in inserted)


def _batches(prepared: _Prepared, jobs: list[_Job]) -> list[list[int]]:
    """Jobs that switch on elements which are nought in the network go apart: their equations are harder to solve."""
    nominal = prepared.engine.parameters
    apart = [any(nominal.get(name) == 0.0 for name in job.table) for job in jobs]
    groups = [[i for i, other in enumerate(apart) if other is kind] for kind in (False, True)]
    return [group for group in groups if group]


def _from_there(result: Result, own: np.ndarray) -> np.ndarray:
    """Starts of a second attempt of the runs that failed: where the first ended, if it was near to settling."""
    failed = ~result.ok
    near = result.cycle_error[failed] < NEAR_SETTLED
    return np.where(near[:, None], result.state[failed], own[failed])


def _stack(prepared: _Prepared, jobs: list[_Job]) -> dict[str, np.ndarray]:
    """Engine changes of all jobs, (n,) or (n, points); where a job has none, the value under its condition."""
    tables = [{**prepared.changes[job.condition], **job.table} for job in jobs]
    nominal = prepared.engine.parameters
    # Conditions that change nothing are samples too: one parameter says how many.
    some = next(name for name, value in nominal.items() if value != 0.0)
    found = {some: np.full(len(jobs), nominal[some])}
    for name in dict.fromkeys(name for table in tables for name in table):
        if name in nominal:
            found[name] = np.array([table.get(name, nominal[name]) for table in tables], dtype=float)
        else:
            own = sampled(next(iter(prepared.networks.values())), name)
            found[name] = np.array([_even(table[name]) if name in table else own for table in tables])
    return found


def _even(values: np.ndarray) -> np.ndarray:
    """A waveform on an even grid, on the grid of `WAVE_POINTS` points."""
    values = np.asarray(values, dtype=float)
    if len(values) == WAVE_POINTS:
        return values
    return np.interp(np.linspace(0.0, 1.0, WAVE_POINTS), np.linspace(0.0, 1.0, len(values)), values)


def pressure_factor(unit: str, root_pressure: float) -> float:
    """dyn/cm2 per pressure unit of the network; "auto" takes mmHg where the root's mean pressure is below 1000."""
    if unit == "auto":
        return units.MMHG if abs(root_pressure) < 1000.0 else 1.0
    return units.PRESSURES[unit]
