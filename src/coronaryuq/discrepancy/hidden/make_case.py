"""Cases with a hidden effect: data made by other numerics than the analysis, nuisance parameters off as well."""

import copy
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from coronaryuq.case.network.network import Network
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import Condition, as_entry, drive_files, period_of, under, write_drive
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.hidden.detectability import least_trace
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.inference.time_step_error import time_steps
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.base import Series

UNIT = {"flow": "mL/s", "pressure": "dyn/cm2", "volume": "mL", "perfusion": "mL/s/g", "ratio": "1"}
TRUTH_STEPS = 1500
"""Time steps per cycle of the runs behind the data, against 300 of the analysis."""
NUISANCE_SPREAD, MASS_SPREAD = 0.6, 0.2
"""Standard deviation of the true nuisance parameters, and of the tissue masses, over the analyst's prior."""
TRUTH_RHO = 0.8
"""Spectral radius of the truth's time integration, against 0.5 of the analysis."""


@dataclass(frozen=True)
class Plan:
    """What is measured in every condition: (quantity, location, statistic, noise as a share of the series' size)."""

    entries: tuple[tuple[str, str, str, float], ...]
    points: int = 40


@dataclass(frozen=True)
class Truth:
    """What was hidden: effects with sizes in prior standard deviations, nuisance draws; for the scorer alone."""

    hypothesis: Hypothesis
    sizes: np.ndarray
    nuisance: np.ndarray
    visible: float
    """Norm of what the fitted data keep of the effect, in noise sd, once the model without it is recalibrated; of
    several the least. See `least_trace`."""

    @property
    def firsts(self) -> list[float]:
        """The size z of each effect's first parameter."""
        return [float(self.hypothesis.sizes(self.sizes, placed)[0]) for placed in self.hypothesis]


def hide(
    network: Network,
    conditions: dict[str, Condition],
    plan: Plan,
    hypothesis: Hypothesis,
    sizes: np.ndarray,
    noise: float,
    seed: int,
    folder: Path,
    outside: Callable[[dict, str], dict] | None = None,
    nuisance_spread: float = NUISANCE_SPREAD,
    said: float = 1.0,
    keeps: float = 0.0,
) -> Truth:
    """Write `model.json`, `measurements.csv` and `conditions.yaml` of one case into `folder`; return what was hidden.

    hypothesis, sizes: effects and their sizes z in prior standard deviations. noise: multiple of the plan's noise;
    said: share of its standard deviation that the table says; keeps: share of it that lasts from sample to sample.
    outside: a change of a condition's network that no effect of the library expresses. nuisance_spread: standard
    deviation of the true nuisance parameters over the analyst's prior, but for tissue masses (`MASS_SPREAD`).
    """
    network = copy.deepcopy(network)
    random = generator(seed, "discrepancy", "hidden")
    settings = Settings(steps_per_cycle=TRUTH_STEPS)
    truth_network = copy.deepcopy(network)
    truth_network["simulation_parameters"]["rho_infty"] = TRUTH_RHO
    blank = _blank(truth_network, conditions, plan, random)
    problem = make_problem(truth_network, conditions, blank, settings)
    forward = problem.forward
    forward.simulation = forward.simulation.changed(alter=outside)
    nuisance = _nuisance(forward, nuisance_spread, random)
    rows = [(np.concatenate([nuisance, sizes]), hypothesis), *_each_left_out(nuisance, sizes, hypothesis)]
    predicted, *unaffected = forward.predict_rows(rows)
    if not np.isfinite(predicted).all():
        raise FloatingPointError("the hidden case does not run")
    without = rows[1:]
    if outside is not None:
        forward.simulation = forward.simulation.changed(alter=None)
        without, unaffected = [(nuisance, PLAIN)], [forward.predict(nuisance)[0]]
    errors = _Errors(noise, said, keeps, random)
    sd = _write(network, conditions, plan, forward.measured, forward.split(predicted[None, :]), errors, folder)
    forward.simulation = forward.simulation.changed(steps_per_cycle=Settings().steps_per_cycle)
    visible = least_trace(problem, without, [predicted - other for other in unaffected], sd)
    return Truth(hypothesis, np.asarray(sizes, dtype=float), nuisance, visible)


@dataclass(frozen=True)
class Unmeasured:
    """A case whose data other runs than the 0D engine's make: its problem, true nuisance parameters, random numbers."""

    problem: Problem
    plan: Plan
    nuisance: np.ndarray
    random: np.random.Generator

    def write(self, waveforms: dict[str, dict], hypothesis: Hypothesis, sizes: np.ndarray, folder: Path) -> Truth:
        """Measure waveforms, condition → unknown of the network → (k + 1,) over the cycle, and write the case's files.

        hypothesis, sizes: the library's effects that come nearest to what was hidden, with sizes z.
        """
        forward = self.problem.forward
        rows = {condition: {name: wave[None, :] for name, wave in of.items()} for condition, of in waveforms.items()}
        readings = forward.readings(rows, self.nuisance[None, :], {})
        errors = _Errors(1.0, 1.0, 0.0, self.random)
        sd = _write(forward.network, forward.conditions, self.plan, forward.measured, readings, errors, folder)
        change = np.concatenate(readings, axis=1)[0] - forward.predict(self.nuisance)[0]
        visible = least_trace(self.problem, [(self.nuisance, PLAIN)], [change], sd)
        return Truth(hypothesis, sizes, self.nuisance, visible)


def prepare(network: Network, conditions: dict[str, Condition], plan: Plan, seed: int) -> Unmeasured:
    """What `hide` draws, for data that are run elsewhere."""
    random = generator(seed, "discrepancy", "hidden")
    problem = make_problem(network, conditions, _blank(network, conditions, plan, random), Settings())
    return Unmeasured(problem, plan, _nuisance(problem.forward, NUISANCE_SPREAD, random), random)


def _nuisance(forward: Forward, spread: float, random: np.random.Generator) -> np.ndarray:
    """True nuisance parameters z (p,); tissue masses have a spread of their own."""
    found = spread * random.standard_normal(len(forward.nuisances))
    for column, entry in enumerate(forward.nuisances):
        if entry.mass is not None:
            found[column] = MASS_SPREAD * random.standard_normal()
    return found


def series_of(plan: Plan, conditions: Iterable[Condition]) -> list[Series]:
    """What the plan measures, as effects on the measuring side want to know it."""
    return [
        Series(condition.name, quantity, place, statistic, np.zeros(1) if statistic == "waveform" else None, 1.0)
        for condition in conditions
        for quantity, place, statistic, _ in plan.entries
    ]


class Traces:
    """What effects would leave in the fitted data: as `Truth.visible`, about the model as it is and to first order.

    noise: multiple of the plan's noise.
    """

    def __init__(self, network: Network, conditions: dict[str, Condition], plan: Plan, noise: float):
        blank = _blank(network, conditions, plan, generator(0, "discrepancy", "traces"))
        self._problem = problem = make_problem(network, conditions, blank, Settings())
        nothing = np.zeros(problem.count)
        plain = problem.forward.predict(nothing)[0]
        shares = _deviations(plan, problem.forward.measured, problem.forward.split(plain[None, :]), noise)
        problem.y, sizes = plain, [one.value.size for one in problem.forward.measured]
        self._project = _absorbing(problem, nothing, np.repeat(shares, sizes)).projection

    def of(self, choices: list[tuple[PlacedEffect, np.ndarray]]) -> np.ndarray:
        """Of each choice, an effect at a place with its sizes z, by itself: (n,) in noise sd; nought where the model
        does not run with it. Does not depend on what was asked before.
        """
        problem, nothing = copy.copy(self._problem), np.zeros(self._problem.count)
        problem.forward = replace(problem.forward, simulation=problem.forward.simulation.branched())
        rows = [(np.concatenate([nothing, z]), Hypothesis((placed,))) for placed, z in choices]
        grafts = list(dict.fromkeys(placed for placed, _ in choices if placed.effect.grafted))
        changes = problem.fitted(rows, grafts)
        squares = [change @ self._project(change) if np.isfinite(change).all() else 0.0 for change in changes]
        return np.sqrt(np.maximum(squares, 0.0))


def _each_left_out(nuisance: np.ndarray, sizes: np.ndarray, hypothesis: Hypothesis) -> list[tuple]:
    """The rows of the truth with all effects but one."""
    return [
        (np.concatenate([nuisance, hypothesis.drop(sizes, placed)]), hypothesis.without(placed))
        for placed in hypothesis
    ]


def _absorbing(problem: Problem, nuisance: np.ndarray, sd: np.ndarray) -> Fit:
    """What takes up a trace about that point: the nuisance parameters, and the shapes of the time steps' error.

    sd: of the noise (N,); the problem gets it with the time steps' own share.
    """
    steps = time_steps(problem.forward, sd)
    problem.sd = np.hypot(sd, steps.sd)
    sensitivity = problem.sensitivity(nuisance, problem.whitened([(nuisance, PLAIN)])[0], PLAIN)
    columns = np.hstack([sensitivity, (steps.shapes / problem.sd).T])[problem.train]
    return Fit(np.zeros(columns.shape[1]), np.zeros(len(columns)), columns)


def _blank(network, conditions, plan, random) -> list[Measured]:
    found = []
    for name, condition in conditions.items():
        period = period_of(under(network, condition))
        for quantity, location, statistic, _ in plan.entries:
            time = None
            count = 1
            if statistic == "waveform":
                # Another grid than the analysis has, unevenly spaced.
                count = plan.points
                jitter = random.uniform(-0.3, 0.3, count)
                time = np.sort((np.arange(count) + 0.5 + jitter) / count * period)
            unit = 1.0 if quantity != "perfusion" else 1.0 / 60.0
            value = np.full(count, unit)
            found.append(Measured(name, quantity, location, statistic, time, period, value, 0.1 * value))
    return found


def _deviations(plan: Plan, series: list[Measured], predicted: list[np.ndarray], noise: float) -> list[float]:
    """Standard deviation of the noise of every series: the plan's share of its size where that is largest."""
    shares = {entry[:3]: entry[3] for entry in plan.entries}
    keys = [(one.quantity, one.location, one.statistic) for one in series]
    sizes: dict[tuple, float] = {}
    for key, values in zip(keys, predicted, strict=True):
        sizes[key] = max(sizes.get(key, 0.0), float(np.abs(values).mean()))
    return [noise * shares[key] * sizes[key] for key in keys]


@dataclass(frozen=True)
class _Errors:
    """Noise of the measurements: see `hide`."""

    noise: float
    said: float
    keeps: float
    random: np.random.Generator

    def of(self, count: int) -> np.ndarray:
        """Of unit standard deviation, (count,)."""
        found = self.random.standard_normal(count)
        for k in range(1, count if self.keeps else 0):
            found[k] = self.keeps * found[k - 1] + np.sqrt(1.0 - self.keeps**2) * found[k]
        return found


def _write(network, conditions, plan, series, predicted, errors: _Errors, folder) -> np.ndarray:
    """Write the case's three files; returns the standard deviations (N,) of the measurements."""
    rows = []
    deviations = _deviations(plan, series, predicted, errors.noise)
    for one, values, sd in zip(series, predicted, deviations, strict=True):
        read = values[0] + sd * errors.of(values.shape[1])
        for i, value in enumerate(read):
            time = "" if one.time is None else float(one.time[i])
            key = (one.quantity, one.location, one.statistic)
            rows.append((one.condition, *key, time, float(value), errors.said * sd, UNIT[one.quantity]))
    columns = ["condition", "quantity", "location", "statistic", "time", "value", "sd", "unit"]
    write_json(folder / "model.json", network)
    write_csv(folder / "measurements.csv", pd.DataFrame(rows, columns=columns))
    content = {name: as_entry(condition) for name, condition in conditions.items()}
    at = drive_files((name, block) for name, condition in conditions.items() for block in condition.drive)
    for (name, block), path in at.items():
        write_drive(folder / path, *conditions[name].drive[block])
        content[name].setdefault("drive", {})[block] = path
    write_text(folder / "conditions.yaml", yaml.safe_dump(content, sort_keys=False))
    return np.array([row[6] for row in rows])
