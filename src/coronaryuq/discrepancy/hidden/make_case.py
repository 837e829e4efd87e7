"""Cases with hidden effects: synthetic measurements of a network with effects that are unknown to the analysis.

The truth differs from the searched model as a `Nature` says, and is simulated by another program, or by our engine with
finer time steps and another time integration than the analysis uses.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.correlated_noise import autoregressive
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import as_entry, write_conditions
from coronaryuq.discrepancy.data.measurements import COLUMNS, Measured
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis
from coronaryuq.discrepancy.forward.predict import Forward, Waveforms
from coronaryuq.discrepancy.forward.simulation import Simulation
from coronaryuq.discrepancy.hidden.detectability import Row, least_trace
from coronaryuq.discrepancy.hidden.experiment import Experiment
from coronaryuq.discrepancy.hidden.nature import OUR_ENGINE, Law, Nature, Outside, Records
from coronaryuq.discrepancy.hidden.other_solver import SvZeroDSimulation
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.inference.time_step_error import FINER, oscillates
from coronaryuq.discrepancy.settings import Settings

UNIT = {"flow": "mL/s", "pressure": "dyn/cm2", "volume": "mL", "perfusion": "mL/s/g", "ratio": "1"}


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
        return autoregressive(count, self.correlation, random)


@dataclass(frozen=True)
class Truth:
    """The hidden effects with sizes in prior standard deviations, and the nuisance parameters; for scoring only.

    visible: norm of the signal of the effect in the fitted data, in standard deviations of the true noise, after
    recalibration without it (`least_trace`); the smallest of several effects. made_by: the program that made the data.
    """

    hypothesis: Hypothesis
    sizes: np.ndarray
    nuisance: np.ndarray
    visible: float
    made_by: str = "own"

    @property
    def firsts(self) -> list[float]:
        """The size z of each effect's first parameter."""
        return [float(self.hypothesis.sizes(self.sizes, placed)[0]) for placed in self.hypothesis]


@dataclass(frozen=True)
class Signal:
    """Data of a subject without noise, (N,) CGS, and the rows of the model without each effect with its change."""

    hypothesis: Hypothesis
    sizes: np.ndarray
    values: np.ndarray
    without: list[Row]
    changes: list[np.ndarray]
    made_by: str


@dataclass(frozen=True)
class Subject:
    """One draw of the truth: its problem about the true vessels, and its nuisance parameters z (p,).

    Effects are hidden in it in turn, and share the runs without any.
    """

    experiment: Experiment
    nature: Nature
    problem: Problem
    nuisance: np.ndarray

    @cached_property
    def _model(self) -> Forward:
        """The searched model about the truth; where it oscillates, with steps that resolve this."""
        forward = self.problem.forward
        values = forward.split(forward.predict(self.nuisance))
        oscillating = oscillates(self.problem.error_runs(), self._noise_sd(values, 1.0))
        return forward.refined(FINER) if oscillating else forward

    @cached_property
    def _forward(self) -> Forward:
        """The model of the truth."""
        forward = self.problem.forward
        times = self._model.simulation.steps_per_cycle // forward.simulation.steps_per_cycle
        simulation = self.nature.simulation(forward.network, forward.conditions, forward.anatomy, times)
        return replace(forward, simulation=simulation)

    def simulate(self, hypothesis: Hypothesis, sizes: np.ndarray, outside: Outside | None = None) -> Signal:
        """Return the noise-free data with effects of sizes z, or with one outside the library.

        Raises
        ------
        FloatingPointError
            If the network does not run with the effects.
        """
        forward = self._forward
        runs = _by_engine(forward)
        without: list[Row] = [
            (np.concatenate([self.nuisance, hypothesis.drop(sizes, placed)]), hypothesis.without(placed))
            for placed in hypothesis
        ]
        row = np.concatenate([self.nuisance, sizes]), hypothesis
        acting = forward
        if outside is None:
            predicted, *unaffected = forward.predict_rows([row, *without])
        else:
            if outside.network is not None:
                acting = replace(forward, simulation=forward.simulation.changed(alter=outside.network))
            predicted = self._recorded(acting, row, outside.records)
            without, unaffected = [(self.nuisance, PLAIN)], [forward.predict(self.nuisance)[0]]
        if not np.isfinite(predicted).all():
            raise FloatingPointError("the hidden case does not run")
        made_by = "own" if max(_by_engine(acting), _by_engine(forward)) > runs else self.nature.program
        return Signal(hypothesis, sizes, predicted, without, [predicted - other for other in unaffected], made_by)

    def signal_of(self, waveforms: dict[str, dict], hypothesis: Hypothesis, sizes: np.ndarray) -> Signal:
        """Return the data of waveforms from another solver.

        waveforms: condition → unknown of the network → (k + 1,) over the cycle. hypothesis, sizes: the effects of the
        library closest to the truth, with sizes z.
        """
        forward = self.problem.forward
        rows: Waveforms = {
            condition: {name: wave[None, :] for name, wave in waves.items()} for condition, waves in waveforms.items()
        }
        values = np.concatenate(forward.readings(rows, self.nuisance[None, :], forward.anatomy), axis=1)[0]
        change = values - forward.predict(self.nuisance)[0]
        return Signal(hypothesis, sizes, values, [(self.nuisance, PLAIN)], [change], "3d")

    @staticmethod
    def _recorded(forward: Forward, row: Row, law: Law | None) -> np.ndarray:
        """Return the data (N,) with waveforms changed by a law, which needs them over the whole cycle."""
        if law is None:
            return forward.predict_rows([row])[0]
        count = forward.simulation.steps_per_cycle
        grid = np.arange(count) / count
        dense = [
            one if one.time is None else replace(one, time=grid * one.period, value=np.zeros(count), sd=np.ones(count))
            for one in forward.measured
        ]
        whole = replace(forward, measured=dense)
        values = [block[0] for block in whole.split(whole.predict_rows([row]))]
        records: Records = {}
        for one, wave in zip(dense, values, strict=True):
            if one.time is not None:
                records.setdefault(one.condition, {})[one.quantity, one.location] = wave
        changed = law(records, {one.condition: one.period for one in dense})
        return np.concatenate(
            [
                wave
                if one.time is None
                else np.interp(one.time, grid * one.period, changed[one.condition][one.quantity, one.location],
                               period=one.period)
                for one, wave in zip(forward.measured, values, strict=True)
            ]
        )  # fmt: skip

    def visible(self, signal: Signal, noise: Noise) -> float:
        """Return the least signal of an effect, in standard deviations of the true noise; see `Truth`."""
        sd = self._noise_sd(self._split(signal), noise.scale)
        return least_trace(self.problem, self._model, signal.without, signal.changes, sd)

    def _noise_sd(self, values: list[np.ndarray], scale: float) -> np.ndarray:
        """Return the standard deviations (N,) of the noise of data, by series."""
        measured = self.problem.forward.measured
        deviations = self.experiment.plan.noise_sd(measured, values, scale)
        return np.repeat(deviations, [one.value.size for one in measured])

    def _split(self, signal: Signal) -> list[np.ndarray]:
        return self.problem.forward.split(signal.values[None, :])

    def write(self, signal: Signal, noise: Noise, seed: int, folder: Path, visible: float) -> Truth:
        """Write `model.json`, `measurements.csv` and `conditions.yaml`. seed: of the noise."""
        random = generator(seed, "discrepancy", "hidden", "noise")
        _write(self.experiment, self.problem.forward.measured, self._split(signal), noise, random, folder)
        return Truth(signal.hypothesis, np.asarray(signal.sizes, dtype=float), self.nuisance, visible, signal.made_by)


def _by_engine(forward: Forward) -> int:
    """Return the number of runs that svZeroDSolver left to our engine."""
    simulation = forward.simulation
    return simulation.by_engine if isinstance(simulation, SvZeroDSimulation) else 0


def draw_subject(experiment: Experiment, nature: Nature, seed: int) -> Subject:
    """Draw vessels, nuisance parameters and the times of the measurements."""
    network, conditions = experiment.network, experiment.conditions
    blank = experiment.plan.blank(network, conditions, generator(seed, "discrepancy", "hidden", "times"))
    problem = make_problem(network, conditions, blank, Settings())
    forward, body = problem.forward, nature.body(network, seed)
    problem.forward = replace(
        forward, simulation=Simulation(body, conditions, forward.anatomy, forward.simulation.steps_per_cycle)
    )
    nuisance = np.array([nature.nuisance(parameter, forward.anatomy, seed) for parameter in forward.nuisances])
    return Subject(experiment, nature, problem, nuisance)


def hide(
    experiment: Experiment,
    hypothesis: Hypothesis,
    sizes: np.ndarray,
    noise: Noise,
    seed: int,
    folder: Path,
    outside: Outside | None = None,
    nature: Nature = OUR_ENGINE,
) -> Truth:
    """Write `model.json`, `measurements.csv` and `conditions.yaml` of a case with hidden effects.

    Parameters
    ----------
    experiment
        Network without the effects, conditions and measurements.
    hypothesis, sizes
        Effects to hide, and their sizes z in prior standard deviations.
    noise, seed
        Noise of the measurements; seed of noise, times, vessels and nuisance parameters.
    folder
        Folder for the files.
    outside
        Effect that the library does not express.
    nature
        Program that makes the data, and how far the truth is off from the model.

    Returns
    -------
    Truth
        The hidden effects.

    Raises
    ------
    FloatingPointError
        If the network does not run with the effects.
    """
    subject = draw_subject(experiment, nature, seed)
    signal = subject.simulate(hypothesis, sizes, outside)
    return subject.write(signal, noise, seed, folder, subject.visible(signal, noise))


def _write(
    experiment: Experiment,
    series: list[Measured],
    predicted: list[np.ndarray],
    noise: Noise,
    random: np.random.Generator,
    folder: Path,
) -> None:
    """Write the three files of the case."""
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
