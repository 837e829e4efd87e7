"""Benchmark `discrepancy`: hidden effects, named from a model that lacks them and a table of noisy measurements."""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.bench.discrepancy.hidden_cases import (
    BESIDE_A_STENOSIS,
    OUTSIDE,
    OUTSIDE_LOOP,
    Made,
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
    "half": {"noise": 0.5},
    "nominal": {"noise": 1.0},
    "double": {"noise": 2.0},
    "understated": {"noise": 1.0, "said": 2.0 / 3.0},
    "lasting": {"noise": 1.0, "keeps": 0.7},
}
"""Of the plan's noise, its size; the share that the table says of it; the share that lasts from sample to sample."""
LEAST_VISIBLE = 6.0
"""Hidden effects whose trace in the fitted data is below this many noise sd are drawn again elsewhere, and counted; of
two effects, each must leave one beside the other."""
DRAWS = 6
MANY = 60
"""Places of one effect in one network from which one is drawn."""
NOTHING_PER_SEED = 5
"""Cases with nothing hidden per seed: one discovery ends after its first step, and a small share wants many."""
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
    """One hidden case before it is made. effects: names; places are drawn by `seed`. known: beside a known stenosis."""

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


def cases(quick: bool, seeds: int, strengths: tuple[str, ...], noises: tuple[str, ...], offset: int) -> Iterator[Case]:
    """The benchmark's cases: a handful when quick, else every effect of the library and the special cells."""
    if quick:
        yield Case((), "none", "nominal", 1)
        yield Case(("quadratic_stenosis",), "medium", "nominal", 2)
        yield Case((), "medium", "nominal", 3, "bulging_territory")
        return
    for seed in range(offset, offset + seeds):
        for noise in noises:
            for number in range(NOTHING_PER_SEED):
                yield Case((), "none", noise, seed + 1000 * number)
            for strength in strengths:
                for one in LIBRARY:
                    yield Case((one.name,), strength, noise, seed)
        for noise in _of_all_cells(noises):
            for name in OUTSIDE:
                yield Case((), "medium", noise, seed, name)
            for pair in PAIRS_OF_TWO:
                yield Case(pair, "medium", noise, seed)


def _of_all_cells(noises: tuple[str, ...]) -> list[str]:
    """Noises under which effects outside the library and two at once are hidden, too: any but its other sizes."""
    return [one for one in noises if one not in ("half", "double")] or ["nominal"]


def loop_cases(seeds: int, strengths: tuple[str, ...], noises: tuple[str, ...], offset: int) -> Iterator[Case]:
    """The cases of a closed loop: nothing hidden, every effect of the library, two at once, outside it."""
    for seed in range(offset, offset + seeds):
        for noise in noises:
            yield Case((), "none", noise, seed)
            for strength in strengths:
                for one in LIBRARY:
                    if one.name not in BESIDE_A_STENOSIS:
                        yield Case((one.name,), strength, noise, seed)
        for name in (one for one in BESIDE_A_STENOSIS if one not in OUTSIDE_LOOP):
            yield Case((name,), "strong", "half", seed, known=True)
        for name in OUTSIDE_LOOP:
            known = name in BESIDE_A_STENOSIS
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


def run(
    quick: bool,
    network: str | None = None,
    seeds: int = 1,
    strengths: tuple[str, ...] = ("medium",),
    noises: tuple[str, ...] = ("nominal",),
    offset: int = 100,
    effects: tuple[str, ...] = (),
    solver: str = "0d",
    threads: int = 1,
    seconds: float | None = None,
    name: str | None = None,
    resume: str | Path | None = None,
) -> dict:
    """Hide, discover, score; see BENCHMARKS for the keys.

    network: a closed loop (svZeroDSolver JSON) to hide in, by default the bundled open-loop tree. seeds: repetitions of
    every cell. effects: labels of the cells that are wanted, such as "none", "collateral" or "outside:drifting_bed", by
    default all. solver: "3d" takes the data from runs of the 3D ensemble solver, see `hidden_3d`. threads: of each
    search. seconds: stop starting new cases after this much CPU time (40 when quick). name: of the network, in the
    entries. resume: file that keeps finished cases, of which a run that was killed goes on.
    """
    limit = seconds if seconds is not None else (40.0 if quick else np.inf)
    name = name or (Path(network).stem if network else OPEN_LOOP)
    if solver == "3d":
        given = {"network": network, "strengths": tuple(strengths), "noises": tuple(noises), "resume": resume}
        _takes_no(given, {"network": None, "strengths": ("medium",), "noises": ("nominal",), "resume": None})
        entries = trials_3d(range(offset, offset + seeds), effects or (("lca1:moderate",) if quick else ()), threads)
    else:
        made = _loop(network) if network else open_loop()
        every = loop_cases if network else partial(cases, quick)
        todo = list(every(seeds, strengths, noises, offset))
        _known_cells(effects, [one.label for one in todo])
        todo = [case for case in todo if not effects or case.label in effects]
        entries = _tried(todo, made, threads, Kept(resume, made, name) if resume else None)
    start, found = time.process_time(), []
    for entry in entries:
        if entry is not None:
            found.append({"network": name, **entry})
            print(json.dumps(found[-1], default=float), file=sys.stderr, flush=True)
        if time.process_time() - start > limit:
            break
    return {"quick": quick, **score(found), "cases": found}


def _tried(todo: list[Case], made: Made, threads: int, kept: "Kept | None") -> Iterator[dict | None]:
    """Every case, searched and scored, or taken from an earlier run that was killed."""
    for case in todo:
        entry = kept.entries.get(case.key) if kept else None
        if entry is None:
            entry = trial(case, made, threads)
            if kept and entry is not None:
                kept.add(case, entry)
        yield entry


class Kept:
    """Finished cases of a run, JSON lines after one that says by which code and in which network they were made.

    entries: key of a case → entry, of an earlier run by the same code in the same network.
    """

    def __init__(self, path: str | Path, made: Made, name: str):
        self.path = Path(path)
        code = [provenance.checksum(source) for source in provenance.sources("coronaryuq.bench.discrepancy.benchmark")]
        head = {"made_by": provenance.digest([name, made.network, code])}
        first, *rest = self._read() or [head]
        found = rest if first == head else []
        self.entries = {tuple(one["key"]): one["entry"] for one in found}
        write_text(self.path, "".join(json.dumps(one) + "\n" for one in [head, *found]))

    def _read(self) -> list[dict]:
        """Its lines; nothing where there is no file, `InputError` where it is another, which is left as it is."""
        if not self.path.exists():
            return []
        try:
            # What follows the last line's end was being written when the run was killed.
            found = [json.loads(line) for line in self.path.read_text(encoding="utf-8").split("\n")[:-1]]
            if not found or set(found[0]) != {"made_by"} or any(set(one) != {"key", "entry"} for one in found[1:]):
                raise ValueError
        except (ValueError, TypeError):
            remedy = "no finished cases of this benchmark; name another file, or remove it to begin anew"
            raise InputError(self.path, None, None, remedy) from None
        return found

    def add(self, case: Case, entry: dict) -> None:
        line = json.dumps({"key": case.key, "entry": entry}, default=float)
        with open(self.path, "a", encoding="utf-8") as file:
            file.write(line + "\n")


def _takes_no(given: dict, left_out: dict) -> None:
    """Options that data from the 3D solver do not know are not passed over in silence."""
    for name, value in given.items():
        if value != left_out[name]:
            raise InputError("bench discrepancy", f"--{name}", value, "not an option of --solver 3d")


def _known_cells(wanted: tuple[str, ...], cells: list[str]) -> None:
    for label in wanted:
        if label not in cells:
            remedy = f"no cell of this benchmark; it has {', '.join(dict.fromkeys(cells))}"
            raise InputError("bench discrepancy", "--effects", label, remedy)


def _loop(path: str) -> Made:
    network = read_network(path)
    anatomy = Anatomy(network)
    if not anatomy.closed_loop or not anatomy.beds:
        raise InputError(path, None, None, "no closed loop with coronary beds; tune one by coronaryuq tune")
    return closed_loop(network)


def trials_3d(seeds: range, wanted: tuple[str, ...], threads: int = 1) -> Iterator[dict]:
    """Every shape of a vessel with data from the 3D solver, searched and scored; wanted: labels, all where empty."""
    from coronaryuq.bench.discrepancy import hidden_3d

    _known_cells(wanted, [shape.label for shape in hidden_3d.SHAPES])
    for shape in hidden_3d.SHAPES:
        if wanted and shape.label not in wanted:
            continue
        with tempfile.TemporaryDirectory() as name:
            folders = [Path(name) / str(seed) for seed in seeds]
            for folder in folders:
                folder.mkdir()
            begin = time.process_time()
            truths = hidden_3d.hide(shape, seeds, folders)
            spent = (time.process_time() - begin) / len(truths)
            for seed, folder, truth in zip(seeds, folders, truths, strict=True):
                told = {"effect": "+".join(shape.effects) or "none", "strength": shape.kind, "noise": "nominal"}
                told |= {"network": "3d", "seed": seed, "shape": shape.label, "cpu_s_3d": spent}
                entry = told | _searched(truth, folder, threads)
                # What a smooth stenosis loses to friction looks like a narrowing, and may be the larger part.
                yield entry | {"at_vessel": any(one["place"] == shape.place for one in entry["found"])}


def trial(case: Case, made: Made, threads: int = 1) -> dict | None:
    """Make one case, search it, score the answer; None where the effect has no place."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth, redrawn = hide(case, made, folder)
        told = {"effect": case.label, "strength": case.strength, "noise": case.noise, "seed": case.seed}
        if truth is None:
            return {**told, "skipped": True, "redrawn": redrawn} if redrawn else None
        return {**told, **_searched(truth, folder, threads), "redrawn": redrawn}


def _searched(truth: make_case.Truth, folder: Path, threads: int) -> dict:
    begin, since = time.process_time(), time.monotonic()
    with threadpool_limits(1):  # as the command does
        answer = analyse(folder, threads)
        spent = {
            "cpu_s": time.process_time() - begin,
            "wall_s": time.monotonic() - since,
            "runs": answer.problem.forward.simulation.runs,
        }
        return spent | scored(truth, answer)


def analyse(folder: Path, threads: int = 1) -> Discovery:
    """The analyst's side: reads the three files and nothing else."""
    read = read_conditions(folder / "conditions.yaml")
    model, settings = read_network(folder / "model.json"), Settings(threads=threads)
    problem = read_problem(model, folder / "measurements.csv", read, folder / "conditions.yaml", settings)
    return discover(problem, seed=1)


def hide(case: Case, made: Made, folder: Path) -> tuple[make_case.Truth | None, int]:
    """Write one case into `folder`; what was hidden, None where it left no trace, and how often it was drawn again."""
    network, conditions, plan = made = made.beside_a_stenosis if case.known else made
    random = generator(case.seed, "discrepancy", "bench", *case.effects, case.outside, case.strength, case.noise)
    places = {name: _places(effect(name), made, random) for name in case.effects}
    if not all(places.values()):
        return None, 0
    if Anatomy(network).closed_loop:
        places = {name: _with_a_trace(effect(name), found, case, made) for name, found in places.items()}
        if not all(places.values()):
            return None, DRAWS
    for draw in range(DRAWS):
        effects, sizes = [], []
        for name in case.effects:
            one = effect(name)
            effects.append(PlacedEffect(one, places[name][int(random.integers(len(places[name])))]))
            positive, signed = STRENGTHS[case.strength]
            for parameter in one.parameters:
                sign = random.choice((-1.0, 1.0))
                sizes.append(positive if parameter.kind == "lognormal" else sign * signed)
        strange = outside(case.outside, network, random) if case.outside else None
        if case.outside and strange is None:
            return None, 0
        # Noise and nuisance parameters of their own in every cell, so that trials are independent.
        seed = int(random.integers(2**31))
        truth = make_case.hide(
            network,
            conditions,
            plan,
            Hypothesis(tuple(effects)),
            np.array(sizes),
            seed=seed,
            folder=folder,
            outside=strange,
            **NOISES[case.noise],
        )
        if (not effects and not case.outside) or truth.visible >= LEAST_VISIBLE:
            return truth, draw
    return None, DRAWS


def _places(one: Effect, made: Made, random: np.random.Generator) -> list[str]:
    """Where it may be hidden; of very many places some."""
    network, conditions, plan = made
    places = one.places(Anatomy(network, pressure=1e5), make_case.series_of(plan, conditions.values()))
    return places if len(places) <= MANY else list(random.choice(places, MANY, replace=False))


def _with_a_trace(one: Effect, places: list[str], case: Case, made: Made) -> list[str]:
    """Those of the places where it would leave a trace: in a loop few do, and a draw takes seconds."""
    positive, signed = STRENGTHS[case.strength]
    size = np.array([positive if parameter.kind == "lognormal" else signed for parameter in one.parameters])
    left = made.traces(NOISES[case.noise]["noise"]).of([(PlacedEffect(one, place), size) for place in places])
    return [place for place, trace in zip(places, left, strict=True) if trace >= LEAST_VISIBLE]
