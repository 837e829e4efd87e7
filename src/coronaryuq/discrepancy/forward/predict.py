"""Predictions of every measured series by a network with effects, under all conditions, in one batch of samples."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from coronaryuq.core import units
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.feedback import Feedback
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.jobs import Job, Prepared, Scaled
from coronaryuq.discrepancy.forward.lockstep import Asking, side_by_side
from coronaryuq.discrepancy.forward.network_values import inner, with_values
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.simulation import Simulation, elements
from coronaryuq.discrepancy.forward.warm_starts import Point
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.solver.engine import Engine

MANY = 20
"""Collaterals that share one network: all pairs of outlets would couple everything with everything."""


@dataclass
class Forward:
    """The analyst's model of one case: network, conditions, measured series, nuisance parameters.

    `predict(z, hypothesis)` takes z (n, p), standard normal numbers as `Hypothesis` lays them out, and returns (n, N)
    in CGS, series after series, NaN where a run failed.
    """

    simulation: Simulation
    measured: list[Measured]
    nuisances: list[Nuisance]
    pressure_factor: float
    periods: dict[str, float] = field(default_factory=dict)
    resting: dict[str, float] = field(default_factory=dict)
    masses: dict[str, float] = field(default_factory=dict)
    shapes: np.ndarray | None = None
    """What the time steps may put predictions off by, (k, N) in CGS, with the nuisance parameters of that kind."""

    @property
    def network(self) -> dict:
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

    def predict(self, z: np.ndarray, hypothesis: Hypothesis = PLAIN) -> np.ndarray:
        """Predictions (n, N) at z (n, p), all with the same effects."""
        return self.predict_rows([(row, hypothesis) for row in np.atleast_2d(z)])

    def predict_rows(
        self,
        rows: list[tuple[np.ndarray, Hypothesis]],
        conditions: Collection[str] | None = None,
        grafts: Sequence[PlacedEffect] = (),
    ) -> np.ndarray:
        """Predictions (n, N) at one point z (p,) each, every row with its own effects; NaN for other `conditions`, but
        in rows with an effect on the measuring side, which may depend on all of them.

        Rows whose networks have the same elements share one batch, all conditions in it; the batches run side by side.
        grafts: effects that share one network (of many collaterals: a few), shut but where a row acts on them, for the
        rows that act on one of them.
        """
        found = np.full((len(rows), self.size), np.nan)
        groups: dict[tuple, tuple[list[PlacedEffect], dict[tuple, list[int]]]] = {}
        common = [placed for placed in rows[0][1] if all(placed in hypothesis for _, hypothesis in rows)]
        shares = _shares([placed for placed in self.simulation.inserting(grafts) if placed not in common])
        for number, (z, hypothesis) in enumerate(rows):
            # What a sensor or a map does to predictions may depend on all of them.
            all_of_them = any(effect.side == "measurement" for effect, _ in hypothesis)
            inserted = self.simulation.inserting(hypothesis)
            share = next((shares[placed] for placed in inserted if placed in shares), [])
            inserted = [*share, *(placed for placed in inserted if placed not in share)]
            # Effects that feel pressures are run more than once.
            feels = any(effect.feedback for effect, _ in hypothesis)
            _, alike = groups.setdefault((*elements(inserted), feels, all_of_them), (inserted, {}))
            alike.setdefault(self._simulated(z, hypothesis), []).append(number)
        asking = []
        for (*_, all_of_them), (inserted, alike) in groups.items():
            wanted = [n for n in self.conditions if all_of_them or conditions is None or n in conditions]
            asking.append(self._predict_group([rows[numbers[0]] for numbers in alike.values()], wanted, inserted))
        together = side_by_side(asking, self.simulation.threads)
        for predicted, (_, alike) in zip(together, groups.values(), strict=True):
            for values, numbers in zip(predicted, alike.values(), strict=True):
                found[numbers] = values
        for number, (z, hypothesis) in enumerate(rows):
            if any(effect.side == "measurement" for effect, _ in hypothesis):
                found[number] = self._observe(found[number], z, hypothesis)
            if self.shapes is not None:
                found[number] += z[self.shaping] @ self.shapes
        return found

    @property
    def shaping(self) -> list[int]:
        """Nuisance parameters that are weights of `shapes`."""
        return [column for column, nuisance in enumerate(self.nuisances) if nuisance.shape is not None]

    def _simulated(self, z: np.ndarray, hypothesis: Hypothesis) -> tuple:
        """What tells two readings of the network apart: most effects on the measuring side act on them afterwards."""
        sizes = hypothesis.physical_sizes(z)
        network = [
            (e.name, place, *v.values()) for (e, place), v in zip(hypothesis, sizes, strict=True) if e.side == "network"
        ]
        return hypothesis.nuisances(z).tobytes(), *self._late(hypothesis, sizes), *network

    def _predict_group(self, rows, names: list[str], inserted: list[PlacedEffect]) -> Asking[np.ndarray]:
        sizes = [hypothesis.physical_sizes(z) for z, hypothesis in rows]
        z = np.array([hypothesis.nuisances(row) for row, hypothesis in rows])
        waveforms, renamed = yield from self._simulate(rows, sizes, names, inserted)
        late = np.array([self._late(hypothesis, values) for (_, hypothesis), values in zip(rows, sizes, strict=True)])
        return np.concatenate(self.readings(waveforms, z, renamed, late), axis=1)

    def _late(self, hypothesis: Hypothesis, sizes: list[dict[str, float]]) -> list[float]:
        """By how much each series is read late, s."""
        late = np.zeros(len(self.measured))
        for (effect, place), values in zip(hypothesis, sizes, strict=True):
            if effect.side == "measurement":
                arrays = {name: np.array([value]) for name, value in values.items()}
                late += [effect.delay(place, arrays, series)[0] for series in self.measured]
        return late.tolist()

    def readings(
        self, waveforms: dict[str, dict], z: np.ndarray, renamed: dict[str, str], late: np.ndarray | None = None
    ) -> list[np.ndarray]:
        """What is measured of waveforms, condition → engine name → (n, k + 1) over a cycle: (n, values) of each series.

        z: (n, p), for the tissue masses. renamed: old → new names of locations. late: (n, series), by how many
        seconds each is read late. NaN under conditions not given.
        """
        late = np.zeros((len(z), len(self.measured))) if late is None else late
        blocks = [np.full((len(z), series.value.size), np.nan) for series in self.measured]
        for i, series in enumerate(self.measured):
            if series.condition in waveforms:
                used = [waveforms[series.condition][name] for name in self.variables(series, renamed)]
                period = self.periods.get(series.condition, series.period)
                blocks[i] = self._series(series, used, np.linspace(0.0, period, used[0].shape[1]), z, late[:, i])
                blocks[i][~np.isfinite(used[0]).all(axis=1)] = np.nan
        return blocks

    def _observe(self, row: np.ndarray, z, hypothesis: Hypothesis) -> np.ndarray:
        blocks = self.split(row[None, :])
        for (effect, place), values in zip(hypothesis, hypothesis.physical_sizes(z), strict=True):
            if effect.side == "measurement":
                blocks = effect.observe(place, {k: np.array([v]) for k, v in values.items()}, self.measured, blocks)
        return np.concatenate(blocks, axis=1)[0]

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Columns of (n, N), series by series."""
        ends = np.cumsum([series.value.size for series in self.measured])
        return np.split(values, ends[:-1], axis=1)

    def _simulate(
        self, rows, sizes, conditions: list[str], inserted: list[PlacedEffect]
    ) -> Asking[tuple[dict, dict[str, str]]]:
        """Waveforms, condition → engine name → (rows, steps + 1), of all rows; and renamed locations."""
        prepared = self.simulation.prepared(inserted)
        renamed = prepared.renamed
        names = [
            n for series in self.measured if series.condition in conditions for n in self.variables(series, renamed)
        ]
        beds = {bed: f"pressure:{renamed.get(f'{v}:{bed}', f'{v}:{bed}')}" for bed, v in self.anatomy.beds.items()}
        responds = [any(effect.feedback for effect, _ in hypothesis) for _, hypothesis in rows]
        names = list(dict.fromkeys(names + (list(beds.values()) if any(responds) else [])))
        points = [self._point(z, hypothesis) for z, hypothesis in rows]
        z = np.array([hypothesis.nuisances(row) for row, hypothesis in rows])
        factors = {name: self._factors(prepared, name, z) for name in conditions}
        runs = [(name, i) for name in conditions for i in range(len(rows))]
        feedback = Feedback(self.resting, [responds[i] for _, i in runs])

        def job(number: int) -> Job:
            name, i = runs[number]
            each, scaled = factors[name]
            effects = self._effects(prepared, name, rows[i][1], sizes[i], feedback.felt(number))
            return Job(points[i], name, effects, each[i], scaled)

        left, waves = np.arange(len(runs)), {}
        while left.size:
            found = yield from self.simulation.waveforms(prepared, [job(number) for number in left], names)
            waves = waves or found
            for key, wave in found.items():
                waves[key][left] = wave
            if not any(responds):
                break
            had = np.array([found[beds[bed]][:, :-1].mean(axis=1) for bed in feedback.beds]).T
            left = feedback.unsettled(left, had)
        for wave in waves.values():
            wave[feedback.astray] = np.nan
        waveforms = {
            name: {key: wave[k * len(rows) : (k + 1) * len(rows)] for key, wave in waves.items()}
            for k, name in enumerate(conditions)
        }
        return waveforms, renamed

    def condition_changes(self, name: str, z: np.ndarray, hypothesis: Hypothesis) -> tuple[dict, dict]:
        """What a point z (p,) means under one condition: changes "BLOCK.parameter" → value, and the network changed.

        Feedback effects see the pressures that the fitted model settles at.
        """
        prepared = self.simulation.prepared(hypothesis)
        sizes, point = hypothesis.physical_sizes(z), self._point(z, hypothesis)
        each, scaled = self._factors(prepared, name, hypothesis.nuisances(z)[None, :])
        feedback = Feedback(self.resting, [any(effect.feedback for effect, _ in hypothesis)])

        def job() -> Job:
            effects = self._effects(prepared, name, hypothesis, sizes, feedback.felt(0))
            return Job(point, name, effects, each[0], scaled)

        places = [f"{self.anatomy.beds[bed]}:{bed}" for bed in feedback.beds]
        at = [f"pressure:{prepared.renamed.get(place, place)}" for place in places]
        left = np.flatnonzero(feedback.responds)
        while left.size:
            asking = self.simulation.waveforms(prepared, [job()], at)
            (waves,) = side_by_side([asking], self.simulation.threads)
            left = feedback.unsettled(left, np.array([[waves[place][0, :-1].mean() for place in at]]))
        return job().table(prepared), prepared.networks[name]

    def _effects(self, prepared: Prepared, name: str, hypothesis, sizes, pressure) -> dict[str, np.ndarray | float]:
        """Values under a condition that all effects of one sample give.

        Each acts on the network as those before it have left it, in an order of their own, so that the order in which
        they were named is of no matter.
        """
        condition, network = self.conditions[name], prepared.networks[name]
        situation = ConditionState(
            condition.coronary_resistance_scale,
            self.periods.get(condition.name, self.anatomy.period),
            {bed: np.array([value]) for bed, value in pressure.items()},
            self.resting,
            condition.covariates,
        )
        changes: dict[str, np.ndarray | float] = {}
        present_effects = [
            (placed, values)
            for placed, values in zip(hypothesis, sizes, strict=True)
            if placed.effect.side == "network"
        ]
        for (effect, place), values in sorted(present_effects, key=lambda pair: pair[0].key):
            values = {name: np.array([value]) for name, value in values.items()}
            present = with_values(network, changes) if changes else network
            found = effect.changes(present, place, values, self.anatomy, situation)
            changes |= {key: np.asarray(value, dtype=float)[0] for key, value in found.items()}
        return changes

    def _factors(self, prepared: Prepared, name: str, z: np.ndarray) -> tuple[np.ndarray, Scaled]:
        """Factors (n, k) of recalibration at the nuisance parameters z (n, p) under a condition, and what they scale:
        the values that effects give, or the condition's own.
        """
        own, scaled, used = prepared.values[name], {}, []
        for column, nuisance in enumerate(self.nuisances):
            if nuisance.targets and nuisance.acts_under(name):
                for key in nuisance.targets:
                    # CORONARY_VAR_RES has two Ra2 where CORONARY has one.
                    for target in (key,) if key in own else (f"{key}_min", f"{key}_max"):
                        scaled.setdefault(target, []).append(len(used))
                used.append(nuisance.factor(z[:, column]))
        return np.array(used).reshape(-1, len(z)).T.copy(), scaled

    def _point(self, z: np.ndarray, hypothesis: Hypothesis) -> Point:
        """Where a run stands."""
        run = [n.simulated for n in self.nuisances if n.shape is None]
        sizes = {placed.key: hypothesis.sizes(z, placed) for placed in hypothesis if placed.effect.side == "network"}
        return Point(np.where(run, z[: len(run)], 0.0), sizes)

    def variables(self, series: Measured, renamed: dict[str, str]) -> tuple[str, ...]:
        """Engine names of the waveforms that a series is made of."""
        location = renamed.get(series.location, series.location)
        if series.quantity == "perfusion":
            vessel = self.anatomy.beds[series.location]
            at = f"{vessel}:{series.location}"
            return (f"flow:{renamed.get(at, at)}",)
        if series.quantity == "ratio":
            return f"pressure:{location}", f"pressure:{renamed.get(self.root, self.root)}"
        if location in self._inner:
            return (location,)
        return (f"{series.quantity}:{location}",)

    @cached_property
    def _inner(self) -> frozenset[str]:
        return frozenset(inner(Engine(self.network).unknowns))

    @property
    def root(self) -> str:
        """Location of the pressure that drives the network: the first root vessel's inlet."""
        return self.anatomy.inlet(self.anatomy.roots[0])

    def _series(
        self, series: Measured, waveforms: list[np.ndarray], time: np.ndarray, z: np.ndarray, late: np.ndarray
    ) -> np.ndarray:
        if series.quantity == "ratio":
            means = [values[:, :-1].mean(axis=1) for values in waveforms]
            return (means[0] / means[1])[:, None]
        values = waveforms[0] * (self.pressure_factor if series.quantity == "pressure" else 1.0)
        if series.quantity == "perfusion":
            values = values / self._mass(series.location, z)[:, None]
        if series.statistic == "waveform":
            at = (series.time - late[:, None]) % series.period
            return np.array([np.interp(own, time, row) for own, row in zip(at, values, strict=True)])
        reduce = {
            "mean": lambda v: v[:, :-1].mean(axis=1),
            "min": lambda v: v.min(axis=1),
            "max": lambda v: v.max(axis=1),
        }
        return reduce[series.statistic](values)[:, None]

    def _mass(self, territory: str, z: np.ndarray) -> np.ndarray:
        column = next(i for i, nuisance in enumerate(self.nuisances) if nuisance.mass == territory)
        return self.masses[territory] * self.nuisances[column].factor(z[:, column])


def _shares(grafts: list[PlacedEffect]) -> dict[PlacedEffect, list[PlacedEffect]]:
    """Each graft with all that share its network."""
    collaterals = [placed for placed in grafts if placed.effect.name == "collateral"]
    turn = {one: number // MANY for number, one in enumerate(collaterals)}
    shares: dict[int, list[PlacedEffect]] = {}
    for one in grafts:
        shares.setdefault(turn.get(one, 0), []).append(one)
    return {one: share for share in shares.values() for one in share}


def pressure_factor(unit: str, root_pressure: float) -> float:
    """dyn/cm2 per pressure unit of the network; "auto" takes mmHg where the root's mean pressure is below 1000."""
    if unit == "auto":
        return units.MMHG if abs(root_pressure) < 1000.0 else 1.0
    return units.PRESSURES[unit]
