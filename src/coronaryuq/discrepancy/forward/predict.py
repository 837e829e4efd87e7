"""Predictions of all measured series by a network with effects, under all conditions."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect, Sizes, shared_grafts
from coronaryuq.discrepancy.forward.instruments import Instruments, as_read, delays, instruments, places_read, run_key
from coronaryuq.discrepancy.forward.jobs import Job, Prepared, Scaled
from coronaryuq.discrepancy.forward.nuisance import BLOOD, Nuisance
from coronaryuq.discrepancy.forward.pullbacks import REDUCE, Extents, extents, pressures, read
from coronaryuq.discrepancy.forward.simulation import TOLERANCE, Simulation
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Channel, ConditionState
from coronaryuq.zerod.effects.feedback import Feedback
from coronaryuq.zerod.effects.grafting import into_bed
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.network.output_names import inner_unknowns
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.lockstep import Computation, run_in_lockstep
from coronaryuq.zerod.solver.warm_starts import Point

Row = tuple[np.ndarray, Hypothesis]
"""A point z (p,) with its hypothesis."""
Waveforms = dict[str, dict[str, np.ndarray]]
"""Condition → solver name → (n, steps + 1) over a cycle, both ends included."""


@dataclass
class Forward:
    """Forward model of one case: network, conditions, measured series, nuisance parameters.

    Attributes
    ----------
    pressure_factor
        dyn/cm2 per pressure unit of the network.
    periods
        Period of each condition, s.
    reference_pressure
        Mean pressure at each bed in the reference run, in the network's units.
    masses
        Nominal tissue mass of each territory, g.
    shapes
        Possible errors of the predictions and of the data, (k, N) in CGS, weighted by the nuisance parameters `shape`.
    """

    simulation: Simulation
    measured: list[Measured]
    nuisances: list[Nuisance]
    pressure_factor: float
    periods: dict[str, float] = field(default_factory=dict)
    reference_pressure: dict[str, float] = field(default_factory=dict)
    masses: dict[str, float] = field(default_factory=dict)
    shapes: np.ndarray | None = None

    @property
    def network(self) -> Network:
        return self.simulation.network

    @property
    def conditions(self) -> dict[str, Condition]:
        return self.simulation.conditions

    @property
    def anatomy(self) -> Anatomy:
        return self.simulation.anatomy

    @property
    def size(self) -> int:
        return sum(series.value.size for series in self.measured)

    @property
    def rows(self) -> list[slice]:
        """Rows of each series among all N values."""
        ends = np.cumsum([series.value.size for series in self.measured]).tolist()
        return [slice(end - series.value.size, end) for series, end in zip(self.measured, ends, strict=True)]

    def refined(self, times: int) -> "Forward":
        """Return the model with more time steps per cycle by a factor."""
        return replace(self, simulation=self.simulation.refined(times))

    def with_nuisances(self, nuisances: list[Nuisance]) -> "Forward":
        """Return the model with other nuisance parameters, and with no states of runs at points of the old ones."""
        return replace(self, nuisances=nuisances, simulation=self.simulation.fresh())

    def predict(self, z: np.ndarray, hypothesis: Hypothesis = PLAIN) -> np.ndarray:
        """Return the predictions (n, N) in CGS at z (n, p), NaN if a run failed.

        z: standard normal numbers in the layout of `Hypothesis`. N: all values, series after series.
        """
        return self.predict_rows([(row, hypothesis) for row in np.atleast_2d(z)])

    def predict_rows(
        self, rows: list[Row], conditions: Collection[str] | None = None, grafts: Sequence[PlacedEffect] = ()
    ) -> np.ndarray:
        """Return predictions with different effects in every row.

        Rows whose networks have the same elements share one batch of all conditions; the batches run in parallel.

        Parameters
        ----------
        rows
            Point z (p,) and hypothesis of each row.
        conditions
            Conditions to run, by default all. Rows with an effect across conditions run all.
        grafts
            Effects inserted into common networks (`shared_grafts`), inactive except in the rows that have them.

        Returns
        -------
        np.ndarray
            (n, N) in CGS; NaN for conditions not run, and if a run failed.
        """
        predictions = np.full((len(rows), self.size), np.nan)
        groups: dict[tuple, tuple[list[PlacedEffect], dict[tuple, list[int]]]] = {}
        common = [placed for placed in next((own for _, own in rows), PLAIN) if all(placed in own for _, own in rows)]
        shares = shared_grafts([placed for placed in self.simulation.inserting(grafts) if placed not in common])
        for number, (z, hypothesis) in enumerate(rows):
            all_conditions = any(effect.across_conditions for effect, _ in hypothesis)
            inserted = self.simulation.inserting(hypothesis)
            share = next((shares[placed] for placed in inserted if placed in shares), [])
            inserted = [*share, *(placed for placed in inserted if placed not in share)]
            # Effects with feedback take several runs.
            feedback = any(effect.feedback for effect, _ in hypothesis)
            structure = tuple(placed.key for placed in inserted)
            _, identical = groups.setdefault((*structure, feedback, all_conditions), (inserted, {}))
            identical.setdefault(run_key(z, hypothesis), []).append(number)
        computations = []
        for (*_, all_conditions), (inserted, identical) in groups.items():
            names = [n for n in self.conditions if all_conditions or conditions is None or n in conditions]
            unique = [rows[numbers[0]] for numbers in identical.values()]
            computations.append(self._predict_group(unique, names, inserted))
        predicted = run_in_lockstep(computations, self.simulation.threads)
        for group, (_, identical) in zip(predicted, groups.values(), strict=True):
            for values, numbers in zip(group, identical.values(), strict=True):
                predictions[numbers] = values
        for number, (z, hypothesis) in enumerate(rows):
            if any(effect.side == "measurement" for effect, _ in hypothesis):
                predictions[number] = self._observe(predictions[number], z, hypothesis)
            if self.shapes is not None:
                predictions[number] += z[self.shape_columns] @ self.shapes
        return predictions

    @property
    def shape_columns(self) -> list[int]:
        """Columns of z that are weights of `shapes`."""
        return [column for column, nuisance in enumerate(self.nuisances) if nuisance.shape is not None]

    @property
    def noise_shapes(self) -> np.ndarray:
        """Those of `shapes` that are noise of the measurements, (k, N)."""
        rows = [nuisance.shape for nuisance in self.nuisances if nuisance.noise and nuisance.shape is not None]
        return np.zeros((0, self.size)) if self.shapes is None else self.shapes[rows]

    def _predict_group(
        self, rows: list[Row], names: list[str], inserted: list[PlacedEffect]
    ) -> Computation[np.ndarray]:
        prepared = self.simulation.prepared(inserted)
        sizes = [hypothesis.physical_sizes(z) for z, hypothesis in rows]
        z = np.array([hypothesis.nuisances(row) for row, hypothesis in rows])
        chains = [instruments(hypothesis, s) for (_, hypothesis), s in zip(rows, sizes, strict=True)]
        waveforms = yield from self.simulate(prepared, rows, sizes, chains, names)
        placed = [extents(hypothesis, s, self.anatomy) for (_, hypothesis), s in zip(rows, sizes, strict=True)]
        blocks = self.readings(waveforms, z, prepared.topology, prepared.renamed, chains, placed)
        return np.concatenate(blocks, axis=1)

    def readings(
        self,
        waveforms: Waveforms,
        z: np.ndarray,
        topology: Topology,
        renamed: dict[str, str] | None = None,
        chains: Sequence[Instruments] = (),
        placed: Sequence[Extents] = (),
    ) -> list[np.ndarray]:
        """Return the values (n, values) of each series from simulated waveforms; NaN under conditions not given.

        z: (n, p), for the tissue masses. topology: of the simulated network. renamed: old → new names of its locations.
        chains, placed: instruments, and places of focal losses, of each of n rows.
        """
        blocks = [np.full((len(z), series.value.size), np.nan) for series in self.measured]
        renamed = renamed or {}
        for i, series in enumerate(self.measured):
            waves = waveforms.get(series.condition)
            if waves is not None and series.pullback is not None:
                places, root = placed or [{}] * len(z), self._root_pressure(series.pullback.path[0], renamed)
                blocks[i] = read(series, waves, topology, places, root, self.pressure_factor)
            elif waves is not None:
                blocks[i] = self.reading(series, waves, z, renamed, chains)
        return blocks

    def reading(
        self, series: Measured, waves: dict, z: np.ndarray, renamed: dict[str, str], chains: Sequence[Instruments]
    ) -> np.ndarray:
        """Return the values (n, values) of one series that is no pullback, as `readings`."""
        used = [waves[name] for name in self.variables(series.channel, renamed)]
        used[0] = as_read(series, used[0], lambda read: waves[self.variables(read, renamed)[0]], chains, self.anatomy)
        period = self.periods.get(series.condition, series.period)
        values = self._series(series, used, period, z, delays(series, chains, len(z)))
        values[~np.isfinite(used[0]).all(axis=1)] = np.nan
        return values

    def root(self, vessel: str | None) -> str:
        """Return the location of the pressure that drives a vessel: the inlet of its root."""
        return self.anatomy.inlet(self.anatomy.root_of(vessel))

    def _root_pressure(self, vessel: str | None, renamed: dict[str, str]) -> str:
        return f"pressure:{renamed.get(self.root(vessel), self.root(vessel))}"

    def _observe(self, row: np.ndarray, z: np.ndarray, hypothesis: Hypothesis) -> np.ndarray:
        blocks = self.split(row[None, :])
        # As for the network, the order of the hypothesis does not matter.
        pairs = zip(hypothesis, hypothesis.physical_sizes(z), strict=True)
        for (effect, place), values in sorted(pairs, key=lambda pair: pair[0].key):
            if effect.side == "measurement":
                blocks = effect.observe(place, {k: np.array([v]) for k, v in values.items()}, self.measured, blocks)
        return np.concatenate(blocks, axis=1)[0]

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Split (n, N) into the columns of each series."""
        return [values[:, rows] for rows in self.rows]

    def simulate(
        self,
        prepared: Prepared,
        rows: list[Row],
        sizes: list[Sizes],
        chains: list[Instruments],
        conditions: list[str],
        tolerance: float = TOLERANCE,
    ) -> Computation[Waveforms]:
        """Return the waveforms of all rows, with a cycle error below a tolerance."""
        renamed = prepared.renamed
        measured = [series for series in self.measured if series.condition in conditions]
        names = [
            name
            for series in measured
            if series.pullback is None
            for read in (series.channel, *sorted(places_read(series, chains, self.anatomy)))
            for name in self.variables(read, renamed)
        ]
        for pullback in filter(None, (series.pullback for series in measured)):
            names += [*pressures(prepared.topology, pullback), self._root_pressure(pullback.path[0], renamed)]
        found, _ = yield from self._settled(prepared, rows, sizes, conditions, names, tolerance)
        return {
            name: {key: wave[k * len(rows) : (k + 1) * len(rows)] for key, wave in found.items()}
            for k, name in enumerate(conditions)
        }

    def _settled(
        self, prepared: Prepared, rows: list[Row], sizes: list[Sizes], conditions: list[str], names: list[str],
        tolerance: float = TOLERANCE,
    ) -> Computation[tuple[dict[str, np.ndarray], Callable[[int], Job]]]:  # fmt: skip
        """Return waveforms by solver name, all rows of one condition after the other, and the job of such a number.

        Effects with feedback use the pressures to which the model converges; without names, only rows with these run.
        """
        points = [self.point(*row) for row in rows]
        z = np.array([hypothesis.nuisances(row) for row, hypothesis in rows])
        responds = [any(effect.feedback for effect, _ in hypothesis) for _, hypothesis in rows]
        factors = {name: self.factors(prepared, name, z) for name in conditions}
        runs = [(name, i) for name in conditions for i in range(len(rows))]
        feedback = Feedback(self.reference_pressure, [responds[i] for _, i in runs])
        known: dict[tuple, dict[str, np.ndarray | float]] = {}

        def job(number: int) -> Job:
            name, i = runs[number]
            each, scaled = factors[name]
            assumed = feedback.assumed(number)
            # Most rows of a batch differ in nuisance parameters alone, on which these values do not depend.
            key = (name, tuple(assumed.values()) if responds[i] else (), *rows[i][1].on_network(sizes[i]))
            if key not in known:
                known[key] = self.effect_values(prepared, name, rows[i][1], sizes[i], assumed)
            return Job(points[i], name, known[key], each[i], scaled)

        left = np.arange(len(runs)) if names else np.flatnonzero(feedback.responds)
        places = [f"{self.anatomy.beds[bed]}:{bed}" for bed in feedback.beds if any(responds)]
        beds = [f"pressure:{prepared.renamed.get(place, place)}" for place in places]
        names = list(dict.fromkeys([*names, *beds]))
        waves = {name: np.full((len(runs), self.simulation.steps_per_cycle + 1), np.nan) for name in names}
        while left.size:
            new = yield from self.simulation.waveforms(prepared, list(map(job, left.tolist())), names, tolerance)
            for key, wave in new.items():
                waves[key][left] = wave
            if not any(responds):
                break
            left = feedback.unsettled(left, np.array([new[bed][:, :-1].mean(axis=1) for bed in beds]).T)
        for wave in waves.values():
            wave[feedback.failed] = np.nan
        return waves, job

    def condition_changes(self, name: str, z: np.ndarray, hypothesis: Hypothesis) -> tuple[dict, Network]:
        """Return the changes "BLOCK.parameter" → value at a point z (p,) under one condition, and the network."""
        prepared, job = self._job(name, z, hypothesis)
        return job.table(prepared), prepared.networks[name]

    def initial_state(self, name: str, z: np.ndarray, hypothesis: Hypothesis) -> dict[str, float]:
        """Return unknown → value where a run at a point z (p,) under a condition starts; empty if unknown."""
        prepared, job = self._job(name, z, hypothesis)
        states = self.simulation.own_starts(prepared, [job])
        return {} if states is None else dict(zip(prepared.engine.unknowns, states[0].tolist(), strict=False))

    def _job(self, name: str, z: np.ndarray, hypothesis: Hypothesis) -> tuple[Prepared, Job]:
        prepared, sizes = self.simulation.prepared(hypothesis), hypothesis.physical_sizes(z)
        settled = self._settled(prepared, [(z, hypothesis)], [sizes], [name], [])
        ((_, job),) = run_in_lockstep([settled], self.simulation.threads)
        return prepared, job(0)

    def effect_values(
        self, prepared: Prepared, name: str, hypothesis: Hypothesis, sizes: Sizes, bed_pressure: dict[str, float]
    ) -> dict[str, np.ndarray | float]:
        """Return the parameter values set by all effects of one sample under a condition.

        Each acts on the network as changed by those before it: sorted by name, so that the order of the hypothesis does
        not matter, and those that add vessels last.
        """
        condition, network = self.conditions[name], prepared.networks[name]
        situation = ConditionState(
            condition.coronary_resistance_scale,
            self.periods.get(condition.name, self.anatomy.period),
            {bed: np.array([value]) for bed, value in bed_pressure.items()},
            self.reference_pressure,
            condition.covariates,
        )
        changes: dict[str, np.ndarray | float] = {}
        acting = [pair for pair in zip(hypothesis, sizes, strict=True) if pair[0].effect.side == "network"]
        for (effect, place), values in sorted(acting, key=lambda pair: (pair[0].effect.grafted, pair[0].key)):
            arrays = {name: np.array([value]) for name, value in values.items()}
            present = with_changes(network, changes) if changes else network
            found = effect.changes(present, place, arrays, self.anatomy, situation)
            changes |= {key: np.asarray(value, dtype=float)[0] for key, value in found.items()}
        return changes

    def factors(self, prepared: Prepared, name: str, z: np.ndarray) -> tuple[np.ndarray, Scaled]:
        """Return factors (n, k) at the nuisance parameters z (n, p) under a condition, and the values they scale."""
        own, copies = prepared.values[name], prepared.networks[name].copies
        scaled: Scaled = {}
        used: list[np.ndarray] = []
        for column, nuisance in enumerate(self.nuisances):
            if nuisance.targets and name in (nuisance.conditions or (name,)):
                for key in nuisance.targets:
                    block, _, parameter = key.rpartition(".")
                    for one in (key, *(f"{copy}.{parameter}" for copy in copies.get(block, []))):
                        # CORONARY_VAR_RES has two Ra2 where CORONARY has one.
                        for target in (one,) if one in own or one == BLOOD else (f"{one}_min", f"{one}_max"):
                            scaled.setdefault(target, []).append(len(used))
                used.append(nuisance.factor(z[:, column]))
        return np.array(used).reshape(-1, len(z)).T.copy(), scaled

    def point(self, z: np.ndarray, hypothesis: Hypothesis) -> Point:
        """Return the point of a run in the space of the warm starts."""
        run = [n.simulated for n in self.nuisances if n.shape is None]
        sizes = {placed.key: hypothesis.sizes(z, placed) for placed in hypothesis if placed.effect.side == "network"}
        return Point(np.where(run, z[: len(run)], 0.0), sizes)

    def variables(self, read: Channel, renamed: dict[str, str]) -> tuple[str, ...]:
        """Return the solver names of the waveforms that a channel reads."""
        quantity, place = read
        location = renamed.get(place, place)
        if quantity == "perfusion":
            end = f"{self.anatomy.beds[place]}:{place}"
            return (f"flow:{into_bed(renamed.get(end, end), place)}",)
        if quantity == "ratio":
            return f"pressure:{location}", self._root_pressure(self.anatomy.vessel_at(place), renamed)
        return (location if location in self._inner else f"{quantity}:{location}",)

    @cached_property
    def _inner(self) -> frozenset[str]:
        return frozenset(inner_unknowns(Engine(self.network).unknowns))

    def _series(
        self, series: Measured, waveforms: list[np.ndarray], period: float, z: np.ndarray, late: np.ndarray
    ) -> np.ndarray:
        if series.quantity == "ratio":
            means = [values[:, :-1].mean(axis=1) for values in waveforms]
            return (means[0] / means[1])[:, None]
        values = waveforms[0] * (self.pressure_factor if series.quantity == "pressure" else 1.0)
        if series.quantity == "perfusion":
            values = values / self._mass(series.location, z)[:, None]
        if series.time is not None:
            return series.sampled(values, period, late)
        return REDUCE[series.statistic](values[:, :-1] if series.statistic == "mean" else values, axis=1)[:, None]

    def _mass(self, territory: str, z: np.ndarray) -> np.ndarray:
        column = next(i for i, nuisance in enumerate(self.nuisances) if nuisance.mass == territory)
        return self.masses[territory] * self.nuisances[column].factor(z[:, column])
