"""Trials of the discrepancy benchmark: hide an effect in a case, search for it and score the answer."""

import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.bench.discrepancy.cases import NOISES, STRENGTHS, Case, check_cells
from coronaryuq.bench.discrepancy.hidden_cases import BenchmarkExperiment, outside
from coronaryuq.bench.discrepancy.score import scored
from coronaryuq.core.errors import InputError
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden.make_case import Noise, Signal, Subject, Truth
from coronaryuq.discrepancy.hidden.nature import OUR_ENGINE, Nature
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.discrepancy.selection.search import discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect, Parameter
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import read_network

LEAST_VISIBLE = 6.0
"""Signal in the fitted data, in noise standard deviations, below which an effect is drawn again at another place, and
counted; of two effects, each must leave such a signal given the other."""
DRAWS = 6
TRACE_WITHIN, MOST_SIZES, LARGEST_SIZE = 0.05, 8, 3.0
"""Relative tolerance of a wanted trace, sizes tried for it, and the largest size in prior standard deviations."""
MANY = 60
"""Maximum number of places of one effect in one network from which one is drawn."""


def trials_3d(seeds: range, wanted: Sequence[str], threads: int = 1) -> Iterator[dict]:
    """Search and score every shape with measurements from the 3D solver. wanted: labels; by default all."""
    from coronaryuq.bench.discrepancy import hidden_3d

    check_cells(wanted, [shape.label for shape in hidden_3d.SHAPES])
    for shape in hidden_3d.SHAPES:
        if wanted and shape.label not in wanted:
            continue
        with tempfile.TemporaryDirectory() as name:
            folders = [Path(name) / str(seed) for seed in seeds]
            for folder in folders:
                folder.mkdir()
            begin = time.process_time()
            truths = hidden_3d.hide(shape, seeds, folders)
            cost = (time.process_time() - begin) / len(truths)
            for seed, folder, truth in zip(seeds, folders, truths, strict=True):
                entry: dict[str, Any] = {
                    "effect": "+".join(shape.effects) or "none",
                    "strength": shape.kind,
                    "noise": "nominal",
                }
                entry |= {"network": "3d", "seed": seed, "shape": shape.label, "cpu_s_3d": cost}
                entry |= _search(truth, folder, threads)
                # The viscous loss of a smooth stenosis resembles a narrowing, and may be the larger part of its loss.
                yield entry | {"at_vessel": any(named["place"] == shape.place for named in entry["found"])}


def trial(case: Case, experiment: BenchmarkExperiment, nature: Nature, threads: int = 1) -> dict | None:
    """Make, search and score one case; None if the effect has no place.

    Data that the search refuses as mistyped, such as those of a coronary probe that reads the aorta's flow, are skipped
    with the message as `refused`. cpu_s_made: CPU time of making the data of all draws. cpu_s: of the search.
    """
    with tempfile.TemporaryDirectory() as name:
        folder, begin = Path(name), time.process_time()
        truth, redrawn = hide(case, experiment, folder, nature)
        made = {"cpu_s_made": time.process_time() - begin}
        cell: dict = {"effect": case.label, "strength": case.strength, "noise": case.noise, "seed": case.seed}
        if truth is None:
            return {**cell, **made, "skipped": True, "redrawn": redrawn} if redrawn else None
        try:
            return {**cell, **made, **_search(truth, folder, threads), "redrawn": redrawn}
        except InputError as error:
            return {**cell, **made, "skipped": True, "refused": str(error), "redrawn": redrawn}


def _search(truth: Truth, folder: Path, threads: int) -> dict:
    begin, since = time.process_time(), time.monotonic()
    with threadpool_limits(1):  # as the command does
        answer = analyse(folder, threads)
        cost = {
            "cpu_s": time.process_time() - begin,
            "wall_s": time.monotonic() - since,
            "runs": answer.problem.forward.simulation.runs,
        }
        return cost | scored(truth, answer)


def analyse(folder: Path, threads: int = 1) -> Discovery:
    """Search a case from its three files and nothing else."""
    return discover(read_case(folder, threads), seed=1)


def read_case(folder: Path, threads: int = 1) -> Problem:
    """Read the problem of a case from its three files and nothing else."""
    conditions = read_conditions(folder / "conditions.yaml")
    model, settings = read_network(folder / "model.json"), Settings(threads=threads)
    return read_problem(model, folder / "measurements.csv", conditions, folder / "conditions.yaml", settings)


def hide(
    case: Case, experiment: BenchmarkExperiment, folder: Path, nature: Nature = OUR_ENGINE
) -> tuple[Truth | None, int]:
    """Write one case into `folder`; return the hidden truth, None if undetectable, and the number of redraws."""
    experiment = experiment.with_stenosis if case.known else experiment
    names = (*case.effects, case.outside, case.strength, case.noise)
    random = generator(case.seed, "discrepancy", "bench", *names)
    places = {name: _places(effect(name), experiment, random) for name in case.effects}
    if not all(places.values()):
        return None, 0
    if Anatomy(experiment.network).closed_loop:
        places = {name: _detectable(effect(name), candidates, case, experiment) for name, candidates in places.items()}
        if not all(places.values()):
            return None, DRAWS
    subject, noise = experiment.subject(case.nature(nature), case.seed), NOISES[case.noise]
    for draw in range(DRAWS):
        effects, sizes = [], []
        for name in case.effects:
            hidden = effect(name)
            effects.append(PlacedEffect(hidden, places[name][int(random.integers(len(places[name])))]))
            sizes += _sizes(hidden, "medium" if case.trace else case.strength, random)
        change = outside(case.outside, experiment, random) if case.outside else None
        if case.outside and change is None:
            return None, 0
        # Every cell has its own noise.
        seed, hypothesis = int(random.integers(2**31)), Hypothesis(tuple(effects))
        try:
            if case.trace:
                signal, visible = with_trace(subject, hypothesis, np.array(sizes), noise, case.trace)
            else:
                signal = subject.simulate(hypothesis, np.array(sizes), change)
                visible = subject.visible(signal, noise)
        except FloatingPointError:
            # No such truth, or none of that trace: another place is drawn.
            continue
        least = 0.0 if case.trace or not (effects or case.outside) else LEAST_VISIBLE
        if visible >= least:
            return subject.write(signal, noise, seed, folder, visible), draw
    return None, DRAWS


def _sizes(hidden: Effect, strength: str, random: np.random.Generator) -> list[float]:
    """Draw the sizes z of an effect: the signs of signed ones."""
    positive, signed = STRENGTHS[strength]
    signs = [random.choice((-1.0, 1.0)) for _ in hidden.parameters]
    return [
        positive if parameter.kind == "lognormal" else sign * signed
        for parameter, sign in zip(hidden.parameters, signs, strict=True)
    ]


def with_trace(
    subject: Subject, hypothesis: Hypothesis, sizes: np.ndarray, noise: Noise, wanted: float
) -> tuple[Signal, float]:
    """Scale the first size of one effect until its trace is `wanted`, within `TRACE_WITHIN`.

    By secants in the logarithms of size and trace, the first with slope one.

    Raises
    ------
    FloatingPointError
        If no size within `LARGEST_SIZE` has that trace, or the model does not run with it.
    """
    ((hidden, _),) = hypothesis.effects
    parameter, sizes = hidden.parameters[0], sizes.copy()
    slope, before = 1.0, None
    for _ in range(MOST_SIZES):
        signal = subject.simulate(hypothesis, sizes.copy())
        visible = max(subject.visible(signal, noise), 1e-3)
        if abs(visible / wanted - 1.0) <= TRACE_WITHIN:
            return signal, visible
        size = float(parameter.from_standard(sizes[0]))
        here = np.log(abs(size - _absent(parameter))), np.log(visible)
        if before is not None and abs(here[0] - before[0]) > 1e-9:
            slope = float(np.clip((here[1] - before[1]) / (here[0] - before[0]), 0.3, 3.0))
        before = here
        step = np.clip((np.log(wanted) - here[1]) / slope, -3.0, 3.0)
        moved = _absent(parameter) + (size - _absent(parameter)) * np.exp(step)
        sizes[0] = np.clip(float(parameter.to_standard(moved)), -LARGEST_SIZE, LARGEST_SIZE)
    raise FloatingPointError("no plausible size has that trace")


def _absent(parameter: Parameter) -> float:
    """Return the size without the effect."""
    return parameter.centre if parameter.kind == "normal" else 0.0


def _places(hidden: Effect, experiment: BenchmarkExperiment, random: np.random.Generator) -> list[str]:
    """Places where an effect may be hidden, at most `MANY`."""
    places = hidden.places(Anatomy(experiment.network, pressure=1e5), experiment.series)
    return places if len(places) <= MANY else list(random.choice(places, MANY, replace=False))


def _detectable(hidden: Effect, places: list[str], case: Case, experiment: BenchmarkExperiment) -> list[str]:
    """Return the places where the effect would be detectable: in a loop few are, and a draw takes seconds."""
    positive, signed = STRENGTHS["strong" if case.trace else case.strength]
    size = np.array([positive if parameter.kind == "lognormal" else signed for parameter in hidden.parameters])
    traces = experiment.traces(NOISES[case.noise].scale)
    norms = traces.norms([(PlacedEffect(hidden, place), size) for place in places])
    return [place for place, norm in zip(places, norms, strict=True) if norm >= (case.trace or LEAST_VISIBLE)]
