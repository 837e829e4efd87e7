"""Cases of the benchmark's own kind, made cheaply, from which the classifier learns."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.bench.discrepancy.cases import STRENGTHS
from coronaryuq.bench.discrepancy.hidden_cases import OUTSIDE, OUTSIDE_LOOP, BenchmarkExperiment, outside
from coronaryuq.bench.discrepancy.trial import LEAST_VISIBLE
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, PlacedEffect
from coronaryuq.discrepancy.hidden.make_case import Subject, draw_subject
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.discrepancy.inference.gauss_newton import Fit, Search, maximise
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import make_problem, with_time_steps
from coronaryuq.discrepancy.selection.candidates import Candidate, all_candidates
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy

FIRST_SEED = 900_000
"""Seed of the first subject; no case of the benchmark has it."""
NONE, OTHER = "none", "something else"
"""Labels of cases without an effect, and with one outside the library."""
UNANSWERED = "bulging_territory"
"""Recalibration takes minutes."""


@dataclass(frozen=True, eq=False)
class Training:
    """A recalibrated case with its label: "effect@place", `NONE` or `OTHER`."""

    problem: Problem
    fit: Fit
    label: str


def training_cases(experiment: BenchmarkExperiment, nature: Nature, subjects: int) -> Iterator[list[Training]]:
    """Yield the cases of each subject: every effect at every place, nothing, and effects outside the library.

    They are drawn as the benchmark's, from other seeds, with sizes of all its strengths, and only those with a
    detectable signal count. To be cheap, effects of the library are simulated by our engine with the time steps of the
    analysis; all cases of a subject share their model, noise levels and prior means, and the detectable signal is that
    to first order. Every case is recalibrated in full.
    """
    for number in range(subjects):
        seed = FIRST_SEED + number
        random = generator(seed, "discrepancy", "bench", "rivals", "training")
        subject = draw_subject(experiment, replace(nature, program="own"), seed)
        plain = subject.problem.forward.predict(subject.nuisance)[0]
        problem = _model(experiment, subject, plain)
        labels, truths = [NONE] * 20, [plain] * 20
        for make in (_inside, _outside):
            more, values = make(experiment, subject, problem, random)
            labels += more
            truths += values
        yield _recalibrated(problem, plain, labels, truths, random)


def _model(experiment: BenchmarkExperiment, subject: Subject, plain: np.ndarray) -> Problem:
    """Return the problem of the noise-free data without an effect, with the noise of the plan."""
    blank = subject.problem.forward.measured
    values = subject.problem.forward.split(plain[None, :])
    deviations = experiment.plan.noise_sd(blank, values, 1.0)
    measured = [
        replace(one, value=value[0], sd=np.full(value.shape[1], sd))
        for one, value, sd in zip(blank, values, deviations, strict=True)
    ]
    return with_time_steps(make_problem(experiment.network, experiment.conditions, measured, Settings()))


def _inside(
    experiment: BenchmarkExperiment, subject: Subject, problem: Problem, random: np.random.Generator
) -> tuple[list[str], list[np.ndarray]]:
    candidates = all_candidates(problem, PLAIN)
    rows = [
        (np.concatenate([subject.nuisance, _size(candidate, random)]), PLAIN.with_(candidate.placed))
        for candidate in candidates
    ]
    values = subject.problem.forward.predict_rows(rows)
    return [label(candidate.placed) for candidate in candidates], list(values)


def _size(candidate: Candidate, random: np.random.Generator) -> np.ndarray:
    positive, signed = STRENGTHS[str(random.choice(list(STRENGTHS)))]
    return np.array(
        [
            positive if parameter.kind == "lognormal" else signed * random.choice((-1.0, 1.0))
            for parameter in candidate.effect.parameters
        ]
    )


def _outside(
    experiment: BenchmarkExperiment, subject: Subject, problem: Problem, random: np.random.Generator
) -> tuple[list[str], list[np.ndarray]]:
    values = []
    for name in OUTSIDE_LOOP if Anatomy(experiment.network).closed_loop else OUTSIDE:
        change = None if name == UNANSWERED else outside(name, experiment, random)
        if change is not None:
            try:
                values.append(subject.simulate(PLAIN, np.zeros(0), change).values)
            except FloatingPointError:
                continue
    return [OTHER] * len(values), values


def _recalibrated(
    problem: Problem, plain: np.ndarray, labels: list[str], truths: list[np.ndarray], random: np.random.Generator
) -> list[Training]:
    """Add noise to the data that have a detectable signal, and recalibrate the model to each."""
    prior = problem.linearisation_point(problem.calibrate(PLAIN), PLAIN)
    noise = np.concatenate([one.sd for one in problem.forward.measured])
    kept, searches = [], []
    for name, values in zip(labels, truths, strict=True):
        signal = ((values - plain) / noise)[problem.train]
        if not np.isfinite(values).all() or name != NONE and signal @ prior.projection(signal) < LEAST_VISIBLE**2:
            continue
        change = (values - plain + noise * random.standard_normal(len(noise))) / problem.sd
        exact = problem.linear_part()
        fresh = [column for column in range(problem.count) if column not in exact[0]]
        kept.append(name)
        searches.append(Search(change[problem.train], np.zeros(problem.count), fresh, exact=exact))

    def residuals(rows: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        return problem.fitted([(z, PLAIN) for z, _ in rows]) + np.array([change for _, change in rows])

    maximise(residuals, searches, problem.settings.iterations)
    return [
        Training(problem, search.fit, name) for name, search in zip(kept, searches, strict=True) if not search.failed
    ]


def label(placed: PlacedEffect) -> str:
    """Return the label of an effect at a place."""
    return "@".join(placed.key)
