"""Cases with hidden effects: synthetic measurements of a network with effects that are unknown to the analysis.

The truth is simulated with finer time steps and another time integration than the analysis uses, and its nuisance
parameters differ from their prior means.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.network.network import Network
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import as_entry, write_conditions
from coronaryuq.discrepancy.data.measurements import COLUMNS, Measured
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis
from coronaryuq.discrepancy.forward.predict import Forward, Waveforms
from coronaryuq.discrepancy.hidden.detectability import Row, least_trace
from coronaryuq.discrepancy.hidden.experiment import Experiment
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.settings import Settings

UNIT = {"flow": "mL/s", "pressure": "dyn/cm2", "volume": "mL", "perfusion": "mL/s/g", "ratio": "1"}
TRUTH_STEPS = 1500
"""Time steps per cycle of the truth; the analysis uses 300."""
NUISANCE_SPREAD, MASS_SPREAD = 0.6, 0.2
"""Standard deviation of the true nuisance parameters, and of the tissue masses, over the analyst's prior."""
TRUTH_RHO = 0.8
"""Spectral radius of the time integration of the truth; the analysis uses 0.5."""


@dataclass(frozen=True)
class Noise:
    """Noise of the measurements.

    scale: multiple of the plan's noise. stated: standard deviation in the table over the true one. correlation: of
    successive samples of a waveform.
    """

    scale: float = 1.0
    stated: float = 1.0
    correlation: float = 0.0

    def draw(self, count: int, random: np.random.Generator) -> np.ndarray:
        """Draw noise of unit standard deviation, (count,)."""
        noise = random.standard_normal(count)
        for k in range(1, count if self.correlation else 0):
            noise[k] = self.correlation * noise[k - 1] + np.sqrt(1.0 - self.correlation**2) * noise[k]
        return noise


@dataclass(frozen=True)
class Truth:
    """The hidden effects with sizes in prior standard deviations, and the nuisance parameters; for scoring only.

    visible: norm of the signal of the effect in the fitted data, in noise standard deviations, after recalibration
    without it (`least_trace`); the smallest of several effects.
    """

    hypothesis: Hypothesis
    sizes: np.ndarray
    nuisance: np.ndarray
    visible: float

    @property
    def firsts(self) -> list[float]:
        """The size z of each effect's first parameter."""
        return [float(self.hypothesis.sizes(self.sizes, placed)[0]) for placed in self.hypothesis]


def hide(
    experiment: Experiment,
    hypothesis: Hypothesis,
    sizes: np.ndarray,
    noise: Noise,
    seed: int,
    folder: Path,
    outside: Callable[[Network, str], Network] | None = None,
    nuisance_spread: float = NUISANCE_SPREAD,
) -> Truth:
    """Write `model.json`, `measurements.csv` and `conditions.yaml` of a case with hidden effects.

    Parameters
    ----------
    experiment
        Network without the effects, conditions and measurements.
    hypothesis, sizes
        Effects to hide, and their sizes z in prior standard deviations.
    noise, seed
        Noise of the measurements; seed of noise, times and nuisance parameters.
    folder
        Folder for the files.
    outside
        Change of a condition's network that no effect of the library expresses.
    nuisance_spread
        Standard deviation of the true nuisance parameters over the analyst's prior, except tissue masses.

    Returns
    -------
    Truth
        The hidden effects.

    Raises
    ------
    FloatingPointError
        If the network does not run with the effects.
    """
    random = generator(seed, "discrepancy", "hidden")
    network = copy.deepcopy(experiment.network)
    network["simulation_parameters"]["rho_infty"] = TRUTH_RHO
    blank = experiment.plan.blank(network, experiment.conditions, random)
    problem = make_problem(network, experiment.conditions, blank, Settings(steps_per_cycle=TRUTH_STEPS))
    forward = problem.forward
    forward.simulation = forward.simulation.changed(alter=outside)
    nuisance = _draw_nuisance(forward, nuisance_spread, random)
    without: list[Row] = [
        (np.concatenate([nuisance, hypothesis.drop(sizes, placed)]), hypothesis.without(placed))
        for placed in hypothesis
    ]
    predicted, *unaffected = forward.predict_rows([(np.concatenate([nuisance, sizes]), hypothesis), *without])
    if not np.isfinite(predicted).all():
        raise FloatingPointError("the hidden case does not run")
    if outside is not None:
        forward.simulation = forward.simulation.changed(alter=None)
        without, unaffected = [(nuisance, PLAIN)], [forward.predict(nuisance)[0]]
    sd = _write(experiment, forward.measured, forward.split(predicted[None, :]), noise, random, folder)
    forward.simulation = forward.simulation.changed(steps_per_cycle=Settings().steps_per_cycle)
    visible = least_trace(problem, without, [predicted - other for other in unaffected], sd)
    return Truth(hypothesis, np.asarray(sizes, dtype=float), nuisance, visible)


@dataclass(frozen=True)
class ExternalCase:
    """A case whose data come from another solver: its problem, true nuisance parameters and random numbers."""

    experiment: Experiment
    problem: Problem
    nuisance: np.ndarray
    random: np.random.Generator

    def write(self, waveforms: dict[str, dict], hypothesis: Hypothesis, sizes: np.ndarray, folder: Path) -> Truth:
        """Write the files of the case from simulated waveforms.

        waveforms: condition → unknown of the network → (k + 1,) over the cycle. hypothesis, sizes: the effects of the
        library closest to the truth, with sizes z.
        """
        forward = self.problem.forward
        rows: Waveforms = {
            condition: {name: wave[None, :] for name, wave in waves.items()} for condition, waves in waveforms.items()
        }
        readings = forward.readings(rows, self.nuisance[None, :], {})
        sd = _write(self.experiment, forward.measured, readings, Noise(), self.random, folder)
        change = np.concatenate(readings, axis=1)[0] - forward.predict(self.nuisance)[0]
        visible = least_trace(self.problem, [(self.nuisance, PLAIN)], [change], sd)
        return Truth(hypothesis, sizes, self.nuisance, visible)


def prepare_external(experiment: Experiment, seed: int) -> ExternalCase:
    """Draw the times and nuisance parameters of a case whose data come from another solver."""
    random = generator(seed, "discrepancy", "hidden")
    blank = experiment.plan.blank(experiment.network, experiment.conditions, random)
    problem = make_problem(experiment.network, experiment.conditions, blank, Settings())
    return ExternalCase(experiment, problem, _draw_nuisance(problem.forward, NUISANCE_SPREAD, random), random)


def _draw_nuisance(forward: Forward, spread: float, random: np.random.Generator) -> np.ndarray:
    """Draw the true nuisance parameters z (p,)."""
    nuisance = spread * random.standard_normal(len(forward.nuisances))
    for column, parameter in enumerate(forward.nuisances):
        if parameter.mass is not None:
            nuisance[column] = MASS_SPREAD * random.standard_normal()
    return nuisance


def _write(
    experiment: Experiment,
    series: list[Measured],
    predicted: list[np.ndarray],
    noise: Noise,
    random: np.random.Generator,
    folder: Path,
) -> np.ndarray:
    """Write the three files of the case; return the stated standard deviations (N,)."""
    rows = []
    deviations = experiment.plan.noise_sd(series, predicted, noise.scale)
    for one, values, sd in zip(series, predicted, deviations, strict=True):
        readings = values[0] + sd * noise.draw(values.shape[1], random)
        for i, value in enumerate(readings):
            time = "" if one.time is None else float(one.time[i])
            key = (one.condition, one.quantity, one.location, one.statistic)
            rows.append((*key, time, float(value), noise.stated * sd, UNIT[one.quantity]))
    conditions = experiment.conditions
    write_json(folder / "model.json", experiment.network)
    write_csv(folder / "measurements.csv", pd.DataFrame(rows, columns=list(COLUMNS)))
    drives = {(name, block): wave for name, condition in conditions.items() for block, wave in condition.drive.items()}
    write_conditions(folder, {name: as_entry(condition) for name, condition in conditions.items()}, drives)
    return np.array([row[6] for row in rows])
