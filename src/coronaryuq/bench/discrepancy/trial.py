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
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.make_case import Truth
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.discrepancy.selection.search import discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import read_network

LEAST_VISIBLE = 6.0
"""Signal in the fitted data, in noise standard deviations, below which an effect is drawn again at another place, and
counted; of two effects, each must leave such a signal given the other."""
DRAWS = 6
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


def trial(case: Case, experiment: BenchmarkExperiment, threads: int = 1) -> dict | None:
    """Make, search and score one case; None if the effect has no place."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth, redrawn = hide(case, experiment, folder)
        cell: dict = {"effect": case.label, "strength": case.strength, "noise": case.noise, "seed": case.seed}
        if truth is None:
            return {**cell, "skipped": True, "redrawn": redrawn} if redrawn else None
        return {**cell, **_search(truth, folder, threads), "redrawn": redrawn}


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
    conditions = read_conditions(folder / "conditions.yaml")
    model, settings = read_network(folder / "model.json"), Settings(threads=threads)
    problem = read_problem(model, folder / "measurements.csv", conditions, folder / "conditions.yaml", settings)
    return discover(problem, seed=1)


NAMES_OF_SEEDS = {
    "stenosis_with_viscous_loss": "stenosis_with_friction",
    "underestimated": "understated",
    "correlated": "lasting",
}
"""Names in the seeds of recorded cases that have been renamed since; the cases stay reproducible."""


def hide(case: Case, experiment: BenchmarkExperiment, folder: Path) -> tuple[Truth | None, int]:
    """Write one case into `folder`; return the hidden truth, None if undetectable, and the number of redraws."""
    experiment = experiment.with_stenosis if case.known else experiment
    names = [NAMES_OF_SEEDS.get(name, name) for name in (*case.effects, case.outside, case.strength, case.noise)]
    random = generator(case.seed, "discrepancy", "bench", *names)
    places = {name: _places(effect(name), experiment, random) for name in case.effects}
    if not all(places.values()):
        return None, 0
    if Anatomy(experiment.network).closed_loop:
        places = {name: _detectable(effect(name), candidates, case, experiment) for name, candidates in places.items()}
        if not all(places.values()):
            return None, DRAWS
    for draw in range(DRAWS):
        effects, sizes = [], []
        for name in case.effects:
            hidden = effect(name)
            effects.append(PlacedEffect(hidden, places[name][int(random.integers(len(places[name])))]))
            positive, signed = STRENGTHS[case.strength]
            for parameter in hidden.parameters:
                sign = random.choice((-1.0, 1.0))
                sizes.append(positive if parameter.kind == "lognormal" else sign * signed)
        change = outside(case.outside, experiment.network, random) if case.outside else None
        if case.outside and change is None:
            return None, 0
        # Every cell has its own noise and nuisance parameters, so that trials are independent.
        seed = int(random.integers(2**31))
        hypothesis = Hypothesis(tuple(effects))
        truth = make_case.hide(experiment, hypothesis, np.array(sizes), NOISES[case.noise], seed, folder, change)
        if (not effects and not case.outside) or truth.visible >= LEAST_VISIBLE:
            return truth, draw
    return None, DRAWS


def _places(hidden: Effect, experiment: BenchmarkExperiment, random: np.random.Generator) -> list[str]:
    """Places where an effect may be hidden, at most `MANY`."""
    places = hidden.places(Anatomy(experiment.network, pressure=1e5), experiment.series)
    return places if len(places) <= MANY else list(random.choice(places, MANY, replace=False))


def _detectable(hidden: Effect, places: list[str], case: Case, experiment: BenchmarkExperiment) -> list[str]:
    """Return the places where the effect would be detectable: in a loop few are, and a draw takes seconds."""
    positive, signed = STRENGTHS[case.strength]
    size = np.array([positive if parameter.kind == "lognormal" else signed for parameter in hidden.parameters])
    traces = experiment.traces(NOISES[case.noise].scale)
    norms = traces.norms([(PlacedEffect(hidden, place), size) for place in places])
    return [place for place, norm in zip(places, norms, strict=True) if norm >= LEAST_VISIBLE]
