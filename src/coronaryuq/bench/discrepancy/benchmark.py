"""Benchmark `discrepancy`: hidden effects, searched from a model that lacks them and noisy measurements."""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.bench.discrepancy.hidden_cases import (
    OUTSIDE,
    OUTSIDE_LOOP,
    WITH_STENOSIS,
    BenchmarkExperiment,
    closed_loop,
    open_loop,
    outside,
)
from coronaryuq.bench.discrepancy.score import score, scored
from coronaryuq.bench.discrepancy.tables import OPEN_LOOP
from coronaryuq.core import provenance
from coronaryuq.core.command_line import non_negative_int, positive_int
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.make_case import Noise, Truth
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.discrepancy.selection.search import discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.library import LIBRARY, effect
from coronaryuq.zerod.network.read import read_network

STRENGTHS = {"weak": (-1.0, 0.6), "medium": (0.0, 1.2), "strong": (1.0, 2.0)}
"""Sizes in prior standard deviations: of positive sizes, and the magnitude of signed ones."""
NOISES = {
    "half": Noise(scale=0.5),
    "nominal": Noise(),
    "double": Noise(scale=2.0),
    "understated": Noise(stated=2.0 / 3.0),
    "lasting": Noise(correlation=0.7),
}
LEAST_VISIBLE = 6.0
"""Trace in the fitted data, in noise standard deviations, below which an effect is drawn again elsewhere, and counted;
each of two effects must leave one in addition to the other."""
DRAWS = 6
MANY = 60
"""Maximum number of places of one effect in one network from which one is drawn."""
NOTHING_PER_SEED = 5
"""Cases without a hidden effect per seed: such a search is short, and a small rate needs many."""
PAIRS_OF_TWO = (
    ("quadratic_stenosis", "pressure_offset"),
    ("diffuse_narrowing", "mbf_underestimation"),
    ("diffuse_narrowing", "pressure_gain"),
    ("intramyocardial_pressure", "quadratic_stenosis"),
    ("intramyocardial_pressure", "intramyocardial_delay"),
    ("back_pressure", "flow_gain"),
)
LOOP_PAIRS = (("quadratic_stenosis", "pressure_offset"), ("intramyocardial_pressure", "diffuse_narrowing"))


@dataclass(frozen=True)
class Case:
    """One case. effects: names; places are drawn by `seed`. known: with a stenosis that the model has."""

    effects: tuple[str, ...]
    strength: str
    noise: str
    seed: int
    outside: str = ""
    known: bool = False

    @property
    def key(self) -> tuple:
        return self.label, self.strength, self.noise, self.seed

    @property
    def label(self) -> str:
        return f"outside:{self.outside}" if self.outside else "+".join(self.effects) or "none"


def cases(quick: bool, seeds: range, strengths: Sequence[str], noises: Sequence[str]) -> Iterator[Case]:
    """Yield the cases on the open loop: three if quick, else every effect of the library and the special cells."""
    if quick:
        yield Case((), "none", "nominal", 1)
        yield Case(("quadratic_stenosis",), "medium", "nominal", 2)
        yield Case((), "medium", "nominal", 3, "bulging_territory")
        return
    for seed in seeds:
        for noise in noises:
            for number in range(NOTHING_PER_SEED):
                yield Case((), "none", noise, seed + 1000 * number)
            for strength in strengths:
                for hidden in LIBRARY:
                    yield Case((hidden.name,), strength, noise, seed)
        for noise in _special_noises(noises):
            for name in OUTSIDE:
                yield Case((), "medium", noise, seed, name)
            for pair in PAIRS_OF_TWO:
                yield Case(pair, "medium", noise, seed)


def _special_noises(noises: Sequence[str]) -> list[str]:
    """Noises under which pairs and effects outside the library are hidden: all but its other scales."""
    return [noise for noise in noises if noise not in ("half", "double")] or ["nominal"]


def loop_cases(seeds: range, strengths: Sequence[str], noises: Sequence[str]) -> Iterator[Case]:
    """Yield the cases on a closed loop: none, every effect of the library, pairs, effects outside the library."""
    for seed in seeds:
        for noise in noises:
            yield Case((), "none", noise, seed)
            for strength in strengths:
                for hidden in LIBRARY:
                    if hidden.name not in WITH_STENOSIS:
                        yield Case((hidden.name,), strength, noise, seed)
        for name in (name for name in WITH_STENOSIS if name not in OUTSIDE_LOOP):
            yield Case((name,), "strong", "half", seed, known=True)
        for name in OUTSIDE_LOOP:
            known = name in WITH_STENOSIS
            yield Case((), "medium", "half" if known else "nominal", seed, name, known)
        for pair in LOOP_PAIRS:
            yield Case(pair, "medium", "nominal", seed)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--network", metavar="FILE", help="tuned closed loop, svZeroDSolver JSON (default open loop)")
    parser.add_argument("--solver", choices=("0d", "3d"), help="solver that makes the measurements (default 0d)")
    parser.add_argument("--seeds", metavar="N", type=positive_int, help="repetitions of every cell")
    parser.add_argument("--offset", metavar="SEED", type=non_negative_int, help="first seed")
    parser.add_argument("--strengths", nargs="+", choices=tuple(STRENGTHS), help="of hidden effects (default medium)")
    parser.add_argument("--noises", nargs="+", choices=tuple(NOISES), help="of measurements (default nominal)")
    parser.add_argument("--effects", nargs="+", metavar="CELL", help="cells to run, by their label (default all)")
    parser.add_argument("--threads", metavar="N", type=positive_int, help="threads of each search (default 1)")
    parser.add_argument("--resume", metavar="FILE", help="file of finished cases, to resume a run that was killed")


@dataclass(frozen=True)
class Options:
    """Options of the benchmark.

    Attributes
    ----------
    quick
        Only three cases.
    network
        Closed loop to hide effects in, svZeroDSolver JSON; by default the bundled open-loop tree.
    seeds, offset
        Repetitions of every cell, and the first seed.
    strengths, noises
        Keys of `STRENGTHS` and `NOISES`.
    effects
        Labels of cells, such as "none", "collateral" or "outside:drifting_bed"; by default all.
    solver
        "3d" takes the measurements from the 3D ensemble solver, see `hidden_3d`.
    threads
        Threads of each search.
    seconds
        Start no new case after this much CPU time; by default 40 s if quick.
    name
        Name of the network in the entries.
    resume
        File of finished cases, to resume a run that was killed.
    """

    quick: bool
    network: str | None = None
    seeds: int = 1
    strengths: Sequence[str] = ("medium",)
    noises: Sequence[str] = ("nominal",)
    offset: int = 100
    effects: Sequence[str] = ()
    solver: str = "0d"
    threads: int = 1
    seconds: float | None = None
    name: str | None = None
    resume: str | Path | None = None


def run(**options: Any) -> dict:
    """Hide effects, search for them and score the answers.

    Parameters
    ----------
    **options
        Fields of `Options`.

    Returns
    -------
    dict
        Cells, totals and confusion matrix of `score`, and the scored `cases`.

    Raises
    ------
    InputError
        For a network that is not a closed loop, unknown cells, and options that the 3D solver does not have.
    """
    given = Options(**options)
    limit = given.seconds if given.seconds is not None else (40.0 if given.quick else np.inf)
    name = given.name or (Path(given.network).stem if given.network else OPEN_LOOP)
    seeds = range(given.offset, given.offset + given.seeds)
    entries: Iterator[dict | None]
    if given.solver == "3d":
        default = Options(quick=given.quick)
        for option in ("network", "strengths", "noises", "resume"):
            value, usual = getattr(given, option), getattr(default, option)
            if value != usual and not (isinstance(value, list) and tuple(value) == usual):
                raise InputError("bench discrepancy", f"--{option}", value, "not an option of --solver 3d")
        cells = given.effects or (("lca1:moderate",) if given.quick else ())
        entries = trials_3d(seeds, cells, given.threads)
    else:
        experiment = _loop(given.network) if given.network else open_loop()
        every = loop_cases if given.network else partial(cases, given.quick)
        selected = list(every(seeds, given.strengths, given.noises))
        _check_cells(given.effects, [case.label for case in selected])
        selected = [case for case in selected if not given.effects or case.label in given.effects]
        finished = FinishedCases(given.resume, experiment, name) if given.resume else None
        entries = _trials(selected, experiment, given.threads, finished)
    start, scored_cases = time.process_time(), []
    for entry in entries:
        if entry is not None:
            scored_cases.append({"network": name, **entry})
            print(json.dumps(scored_cases[-1], default=float), file=sys.stderr, flush=True)
        if time.process_time() - start > limit:
            break
    return {"quick": given.quick, **score(scored_cases), "cases": scored_cases}


def _trials(
    selected: list[Case], experiment: BenchmarkExperiment, threads: int, finished: "FinishedCases | None"
) -> Iterator[dict | None]:
    """Search and score every case, or take it from an earlier run."""
    for case in selected:
        entry = finished.entries.get(case.key) if finished else None
        if entry is None:
            entry = trial(case, experiment, threads)
            if finished and entry is not None:
                finished.add(case, entry)
        yield entry


class FinishedCases:
    """Finished cases of a run, JSON lines after one that identifies the code and the network.

    entries: key of a case → entry, from an earlier run of the same code on the same network.
    """

    def __init__(self, path: str | Path, experiment: BenchmarkExperiment, name: str):
        self.path = Path(path)
        code = provenance.code_digest("coronaryuq.bench.discrepancy.benchmark")
        head = {"made_by": provenance.digest([name, experiment.network, code])}
        first, *rest = self._read() or [head]
        lines = rest if first == head else []
        self.entries = {tuple(line["key"]): line["entry"] for line in lines}
        write_text(self.path, "".join(json.dumps(line) + "\n" for line in [head, *lines]))

    def _read(self) -> list[dict]:
        """Its lines; empty if there is no file, `InputError` if the file is something else."""
        if not self.path.exists():
            return []
        try:
            # The part after the last line break was being written when the run was killed.
            lines = [json.loads(line) for line in self.path.read_text(encoding="utf-8").split("\n")[:-1]]
            if not lines or set(lines[0]) != {"made_by"} or any(set(line) != {"key", "entry"} for line in lines[1:]):
                raise ValueError
        except (ValueError, TypeError):
            remedy = "no finished cases of this benchmark; choose another file, or remove it to start anew"
            raise InputError(self.path, None, None, remedy) from None
        return lines

    def add(self, case: Case, entry: dict) -> None:
        """Append a finished case."""
        line = json.dumps({"key": case.key, "entry": entry}, default=float)
        with open(self.path, "a", encoding="utf-8") as file:
            file.write(line + "\n")


def _check_cells(wanted: Sequence[str], cells: list[str]) -> None:
    for label in wanted:
        if label not in cells:
            remedy = f"no cell of this benchmark; known: {', '.join(dict.fromkeys(cells))}"
            raise InputError("bench discrepancy", "--effects", label, remedy)


def _loop(path: str) -> BenchmarkExperiment:
    network = read_network(path)
    anatomy = Anatomy(network)
    if not anatomy.closed_loop or not anatomy.beds:
        raise InputError(path, None, None, "not a closed loop with coronary beds; tune one with coronaryuq tune")
    return closed_loop(network)


def trials_3d(seeds: range, wanted: Sequence[str], threads: int = 1) -> Iterator[dict]:
    """Search and score every shape with measurements from the 3D solver. wanted: labels; by default all."""
    from coronaryuq.bench.discrepancy import hidden_3d

    _check_cells(wanted, [shape.label for shape in hidden_3d.SHAPES])
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
                # The friction of a smooth stenosis looks like a narrowing, and may be the larger part of its loss.
                yield entry | {"at_vessel": any(one["place"] == shape.place for one in entry["found"])}


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


def hide(case: Case, experiment: BenchmarkExperiment, folder: Path) -> tuple[Truth | None, int]:
    """Write one case into `folder`; return what was hidden, None if undetectable, and the number of redraws."""
    experiment = experiment.with_stenosis if case.known else experiment
    random = generator(case.seed, "discrepancy", "bench", *case.effects, case.outside, case.strength, case.noise)
    places = {name: _places(effect(name), experiment, random) for name in case.effects}
    if not all(places.values()):
        return None, 0
    if Anatomy(experiment.network).closed_loop:
        places = {name: _detectable(effect(name), found, case, experiment) for name, found in places.items()}
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
        # Every cell has noise and nuisance parameters of its own, so that trials are independent.
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
