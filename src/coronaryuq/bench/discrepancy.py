"""Benchmark `discrepancy`: hidden effects, named from a model that lacks them and a table of noisy measurements."""

import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coronaryuq import files
from coronaryuq.bench.discovery_score import score, scored
from coronaryuq.bench.hidden_cases import OUTSIDE, Made, closed_loop, open_loop, outside
from coronaryuq.discrepancy import hidden
from coronaryuq.discrepancy.conditions import read_conditions
from coronaryuq.discrepancy.model import read_problem
from coronaryuq.discrepancy.search import Discovery, discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.seeds import generator
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.library import LIBRARY, effect
from coronaryuq.zerod.network import read_network

STRENGTHS = {"weak": (-1.0, 0.6), "medium": (0.0, 1.2), "strong": (1.0, 2.0)}
"""Sizes in prior standard deviations: of positive sizes, and the magnitude of signed ones."""
NOISES = {"half": 0.5, "nominal": 1.0, "double": 2.0}
LEAST_VISIBLE = 6.0
"""Hidden effects whose trace in the fitted data is below this many noise sd are drawn again elsewhere, and counted; of
two effects, each must leave one beside the other."""
DRAWS = 6
NOTHING_PER_SEED = 5
"""Cases with nothing hidden per seed: one discovery ends after its first step, and a small share wants many."""
PAIRS_OF_TWO = (
    ("quadratic_stenosis", "pressure_offset"),
    ("diffuse_narrowing", "mbf_underestimation"),
    ("diffuse_narrowing", "pressure_gain"),
    ("intramyocardial_pressure", "quadratic_stenosis"),
    ("back_pressure", "flow_gain"),
)


LOOP_EFFECTS = ("quadratic_stenosis", "diffuse_narrowing", "aortic_regurgitation", "collateral")
"""Hidden in a closed loop, where one search takes a minute, beside nothing at all."""


@dataclass(frozen=True)
class Case:
    """One hidden case before it is made. effects: names; places are drawn by `seed`."""

    effects: tuple[str, ...]
    strength: str
    noise: str
    seed: int
    outside: str = ""

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
        for name in OUTSIDE:
            yield Case((), "medium", "nominal", seed, name)
        for pair in PAIRS_OF_TWO:
            yield Case(pair, "medium", "nominal", seed)


def loop_cases(seeds: int, offset: int) -> Iterator[Case]:
    """The cases of a closed loop: nothing hidden, and effects of the vessels, of the heart and between arteries."""
    for seed in range(offset, offset + seeds):
        for name in LOOP_EFFECTS:
            yield Case((name,), "medium", "nominal", seed)
        yield Case((), "none", "nominal", seed)


def run(
    quick: bool,
    network: str | None = None,
    seeds: int = 1,
    strengths: tuple[str, ...] = ("medium",),
    noises: tuple[str, ...] = ("nominal",),
    offset: int = 100,
    seconds: float | None = None,
) -> dict:
    """Hide, discover, score; see BENCHMARKS for the keys.

    network: a closed loop (svZeroDSolver JSON) to hide in, by default the bundled open-loop tree. seeds: repetitions of
    every cell. seconds: stop starting new cases after this much CPU time (40 when quick).
    """
    made = closed_loop(read_network(network)) if network else open_loop()
    todo = loop_cases(seeds, offset) if network else cases(quick, seeds, strengths, noises, offset)
    limit = seconds if seconds is not None else (40.0 if quick else np.inf)
    start, found = time.process_time(), []
    for case in todo:
        if time.process_time() - start > limit:
            break
        entry = trial(case, made)
        if entry is not None:
            found.append(entry | {"network": Path(network).stem if network else "open_loop"})
            print(json.dumps(found[-1], default=float), file=sys.stderr, flush=True)
    return {"quick": quick, **score(found), "cases": found}


def trial(case: Case, made: Made) -> dict | None:
    """Make one case, search it, score the answer; None where the effect has no place."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth, redrawn = hide(case, made, folder)
        if truth is None:
            return None if not redrawn else {"effect": case.label, "skipped": True, "redrawn": redrawn}
        begin = time.process_time()
        answer = analyse(folder)
        cpu = time.process_time() - begin
    told = {"effect": case.label, "strength": case.strength, "noise": case.noise, "seed": case.seed}
    return {**told, **scored(truth, answer), "redrawn": redrawn, "cpu_s": cpu}


def analyse(folder: Path) -> Discovery:
    """The analyst's side: reads the three files and nothing else."""
    read = read_conditions(folder / "conditions.yaml")
    model = files.read_json(folder / "model.json")
    problem = read_problem(model, folder / "measurements.csv", read, folder / "conditions.yaml", Settings())
    return discover(problem, seed=1)


def hide(case: Case, made: Made, folder: Path) -> tuple[hidden.Truth | None, int]:
    """Write one case into `folder`; what was hidden, None where it left no trace, and how often it was drawn again."""
    network, conditions, plan = made
    random = generator(case.seed, "discrepancy", "bench", *case.effects, case.outside, case.strength, case.noise)
    anatomy = Anatomy(network, pressure=1e5)
    series = [
        Series(c, quantity, place, statistic, np.zeros(1) if statistic == "waveform" else None, 1.0)
        for c in conditions
        for quantity, place, statistic, _ in plan.entries
    ]
    for draw in range(DRAWS):
        acting, sizes = [], []
        for name in case.effects:
            one = effect(name)
            places = one.places(anatomy, series)
            if not places:
                return None, 0
            acting.append((one, places[int(random.integers(len(places)))]))
            positive, signed = STRENGTHS[case.strength]
            for parameter in one.parameters:
                sign = random.choice((-1.0, 1.0))
                sizes.append(positive if parameter.kind == "lognormal" else sign * signed)
        strange = outside(case.outside, network) if case.outside else None
        # Noise and nuisance parameters of their own in every cell, so that trials are independent.
        seed = int(random.integers(2**31))
        truth = hidden.hide(
            network, conditions, plan, acting, np.array(sizes), NOISES[case.noise], seed, folder, strange
        )
        if (not acting and not case.outside) or truth.visible >= LEAST_VISIBLE:
            return truth, draw
    return None, DRAWS
