"""Benchmark `discrepancy`: search for hidden effects with a model that lacks them and noisy measurements."""

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from coronaryuq.bench.discrepancy.cases import (
    NOISES,
    STRENGTHS,
    TRACE,
    VIOLATED_BEDS,
    VIOLATED_VESSELS,
    Case,
    check_cells,
    closed_loop_cases,
    open_loop_cases,
    set_aside_cases,
)
from coronaryuq.bench.discrepancy.evidence import evidence_trial
from coronaryuq.bench.discrepancy.evidence import summary as evidence_summary
from coronaryuq.bench.discrepancy.hidden_cases import BenchmarkExperiment, closed_loop, open_loop
from coronaryuq.bench.discrepancy.loop import EFFECTS as PREDICTED
from coronaryuq.bench.discrepancy.loop import prediction
from coronaryuq.bench.discrepancy.loop import summary as loop_summary
from coronaryuq.bench.discrepancy.rivals.compare import SUBJECTS, every_rival, outcomes, rival_trial
from coronaryuq.bench.discrepancy.score import score
from coronaryuq.bench.discrepancy.tables import OPEN_LOOP
from coronaryuq.bench.discrepancy.trial import trial, trials_3d
from coronaryuq.core import provenance
from coronaryuq.core.command_line import non_negative_int, positive_int
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text
from coronaryuq.discrepancy.hidden.experiment import loop_experiment
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.svzerodsolver.program import installed

QUICK_SUBJECTS = 4
"""Subjects from which the classifier among the rivals learns with --quick."""
NATURE = Nature("svzerod", vessels=0.08, beds=0.15, states=0.05, parts=0.15)
"""Usual nature of the truth: the search's priors of the beds, half of its prior of the conditions' states."""
SPREADS = {
    "vessels": "R, L and C of every vessel",
    "beds": "resistance and compliance of each bed, other nuisance parameters in proportion to their priors",
    "states": "coronary resistance of each condition",
    "parts": "parts of each bed (Rp and Rd, Ca and Cim), which keep their sum,",
}
PREDICTION = "prediction"
"""In place of the strength of a case whose prediction is scored: sizes are drawn."""
INSTEAD = ("rivals", "evidence", "loop")
"""Options each of which scores something else than the search's names."""
NOT_IN_3D = (
    "network", "strengths", "noises", "resume", "trace", "nature", *SPREADS, "set_aside", "rivals", "evidence", "loop",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument(
        "--network", metavar="FILE", help="tuned closed loop, svZeroDSolver JSON (default: bundled open-loop tree)"
    )
    parser.add_argument("--solver", choices=("0d", "3d"), help="solver that generates the measurements (default: 0d)")
    parser.add_argument("--seeds", metavar="N", type=positive_int, help="repetitions of every cell (default: 1)")
    parser.add_argument(
        "--offset", metavar="SEED", type=non_negative_int, help="seed of the first repetition (default: 100)"
    )
    parser.add_argument(
        "--strengths", nargs="+", choices=tuple(STRENGTHS), help="sizes of the hidden effects (default: medium)"
    )
    parser.add_argument(
        "--noises", nargs="+", choices=tuple(NOISES), help="noise of the measurements (default: nominal)"
    )
    parser.add_argument(
        "--trace",
        nargs="+",
        metavar="SD",
        type=_positive,
        help="scale single effects until they leave these signals, in noise sd, instead of --strengths: 3 6 10 20 50",
    )
    parser.add_argument(
        "--nature",
        choices=("svzerod", "own"),
        help="program that makes the data (default: svzerod, svZeroDSolver, if it is installed)",
    )
    for name, what in SPREADS.items():
        usual = getattr(NATURE, name)
        help = f"relative sd of the truth's {what} about the searched model (default: {usual:g})"
        parser.add_argument(f"--{name}", metavar="SD", type=_share, help=help)
    parser.add_argument("--set-aside", metavar="FILE", help="run only the effects and seeds of this file")
    parser.add_argument("--effects", nargs="+", metavar="CELL", help="labels of the cells to run (default: all)")
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--rivals", action="store_true", help="let other methods answer in place of the search")
    instead.add_argument(
        "--evidence", action="store_true", help="compare the evidence of each answer with that by importance sampling"
    )
    instead.add_argument(
        "--loop",
        action="store_true",
        help="adopt what the search finds, and predict FFR and bed flows before, after and with the truth; "
        "needs --network",
    )
    parser.add_argument("--threads", metavar="N", type=positive_int, help="threads of each search (default: 1)")
    parser.add_argument("--resume", metavar="FILE", help="file of finished cases, to resume a run that was killed")


def _positive(text: str) -> float:
    """Return the positive number of an argument."""
    number = _share(text)
    if number == 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return number


def _share(text: str) -> float:
    """Return the number of an argument, zero or more."""
    try:
        number = float(text)
    except ValueError:
        number = np.nan
    if not 0.0 <= number < np.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of 0 or more")
    return number


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
    trace
        Signals in noise sd that single effects are scaled to, instead of `strengths`.
    nature
        Program that makes the data; by default svZeroDSolver if it is installed.
    vessels, beds, states
        Relative standard deviations of the truth; by default those of `NATURE`.
    set_aside
        File of the effects and seeds to run only, see `set_aside_cases`.
    rivals
        Other methods answer, see `rivals.compare`.
    evidence
        Compute the evidence of each answer by importance sampling, too, see `evidence`, in place of the scores.
    loop
        Predict with what the search finds, see `loop`, in place of the cases.
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
    trace: Sequence[float] = ()
    nature: Literal["svzerod", "own"] | None = None
    vessels: float | None = None
    beds: float | None = None
    states: float | None = None
    parts: float | None = None
    set_aside: str | None = None
    rivals: bool = False
    evidence: bool = False
    loop: bool = False

    def drawn(self) -> Nature:
        """Return the nature of the truth; says on standard error where svZeroDSolver is missing."""
        program = self.nature or ("svzerod" if installed() else "own")
        if program == "svzerod" and not installed():
            raise InputError("bench discrepancy", "--nature", program, "pip install svzerod, or use own")
        if self.nature is None and program == "own":
            print("svZeroDSolver is not installed: the data are made by our engine", file=sys.stderr)
        spreads = {name: getattr(self, name) for name in SPREADS if getattr(self, name) is not None}
        return replace(NATURE, program=program, **spreads)

    def cases(self) -> list[Case]:
        """Return the cases to run; `InputError` for an unknown cell."""
        if self.set_aside:
            selected = list(set_aside_cases(self.set_aside))
        else:
            seeds = range(self.offset, self.offset + self.seeds)
            strengths = [f"{TRACE}{trace:g}" for trace in self.trace] or self.strengths
            every = closed_loop_cases if self.network else partial(open_loop_cases, self.quick)
            selected = list(every(seeds, strengths, self.noises))
        check_cells(self.effects, [case.label for case in selected])
        return [case for case in selected if not self.effects or case.label in self.effects]


def run(**options: Any) -> dict:
    """Hide effects, search for them and score the answers.

    Parameters
    ----------
    **options
        Fields of `Options`.

    Returns
    -------
    dict
        Cells, totals and confusion matrix of `score`, and the scored `cases`; with `rivals` their outcomes by group in
        place of these, with `evidence` how far it differs.

    Raises
    ------
    InputError
        For a network that is not a closed loop, unknown cells, and options that the 3D solver does not have.
    """
    chosen = Options(**options)
    asked = [f"--{name}" for name in INSTEAD if getattr(chosen, name)]
    if len(asked) > 1:
        raise InputError("bench discrepancy", asked[1], None, f"not together with {asked[0]}")
    if chosen.loop:
        return _predicted(chosen)
    limit = chosen.seconds if chosen.seconds is not None else (40.0 if chosen.quick else np.inf)
    name = chosen.name or (Path(chosen.network).stem if chosen.network else OPEN_LOOP)
    entries: Iterator[dict | None]
    stated: dict = {"program": "3d"}
    if chosen.solver == "3d":
        default = Options(quick=chosen.quick)
        for option in NOT_IN_3D:
            value, usual = getattr(chosen, option), getattr(default, option)
            if value != usual and not (isinstance(value, list) and tuple(value) == usual):
                remedy = "not an option of --solver 3d"
                raise InputError("bench discrepancy", f"--{option.replace('_', '-')}", value, remedy)
        cells = chosen.effects or (("lca1:moderate",) if chosen.quick else ())
        entries = trials_3d(range(chosen.offset, chosen.offset + chosen.seeds), cells, chosen.threads)
    else:
        experiment = _loop(chosen.network) if chosen.network else open_loop()
        nature, selected = chosen.drawn(), chosen.cases()
        stated = nature.stated() | {"violated": {"vessels": VIOLATED_VESSELS, "each bed": VIOLATED_BEDS}}
        answering = partial(trial, experiment=experiment, nature=nature, threads=chosen.threads)
        if chosen.evidence:
            stated |= {"evidence": "importance sampling"}
            answering = partial(evidence_trial, experiment=experiment, nature=nature, threads=chosen.threads)
        elif chosen.rivals:
            rivals = every_rival(experiment, nature, QUICK_SUBJECTS if chosen.quick else SUBJECTS)
            stated |= {"rivals": [rival.name for rival in rivals]}
            answering = partial(
                rival_trial, experiment=experiment, nature=nature, rivals=rivals, threads=chosen.threads
            )
        finished = FinishedCases(chosen.resume, experiment, name, stated) if chosen.resume else None
        entries = _trials(selected, answering, finished)
    start, scored_cases = time.process_time(), []
    for entry in entries:
        if entry is not None:
            scored_cases.append({"network": name, **entry})
            print(json.dumps(scored_cases[-1], default=float), file=sys.stderr, flush=True)
        if time.process_time() - start > limit:
            break
    return {"quick": chosen.quick, "nature": stated, **_summary(chosen, scored_cases), "cases": scored_cases}


def _summary(chosen: Options, cases: list[dict]) -> dict:
    if chosen.evidence:
        return {"evidence": evidence_summary(cases)}
    return {"outcomes": outcomes(cases)} if chosen.rivals else score(cases)


def _trials(
    selected: list[Case], answering: Callable[[Case], dict | None], finished: "FinishedCases | None"
) -> Iterator[dict | None]:
    """Search and score every case, or take it from an earlier run."""
    for case in selected:
        entry = finished.entries.get(case.key) if finished else None
        if entry is None:
            entry = answering(case)
            if finished and entry is not None:
                finished.add(case, entry)
        yield entry


class FinishedCases:
    """Finished cases of a run, as JSON lines after a line that identifies the code and the network.

    entries: key of a case → entry, from an earlier run of the same code on the same network.
    """

    def __init__(self, path: str | Path, experiment: BenchmarkExperiment, name: str, nature: dict):
        self.path = Path(path)
        code = provenance.code_digest("coronaryuq.bench.discrepancy.benchmark")
        head = {"made_by": provenance.digest([name, experiment.network, nature, code])}
        first, *rest = self._read() or [head]
        lines = rest if first == head else []
        self.entries = {tuple(line["key"]): line["entry"] for line in lines}
        write_text(self.path, "".join(json.dumps(line) + "\n" for line in [head, *lines]))

    def _read(self) -> list[dict]:
        """Read the file's lines; none if there is no file, `InputError` for another kind of file."""
        if not self.path.exists():
            return []
        try:
            # The part after the last line break was incomplete when the run was killed.
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


def _predicted(chosen: Options) -> dict:
    """Return how well predictions are before and after adoption."""
    if not chosen.network or chosen.solver == "3d":
        raise InputError("bench discrepancy", "--loop", None, "needs --network, a tuned closed loop, and --solver 0d")
    wanted, nature = chosen.effects or PREDICTED, chosen.drawn()
    for name in wanted:
        if name not in PREDICTED:
            raise InputError("bench discrepancy", "--effects", name, f"with --loop: {', '.join(PREDICTED)}")
    experiment = _loop(chosen.network)
    hiding, stated = loop_experiment(experiment.network), nature.stated()
    seeds = range(chosen.offset, chosen.offset + chosen.seeds)
    cases = [Case((name,), PREDICTION, "nominal", seed) for seed in seeds for name in wanted]
    finished = FinishedCases(chosen.resume, experiment, PREDICTION, stated) if chosen.resume else None

    def answering(case: Case) -> dict:
        return prediction(hiding, nature, case.label, case.seed, chosen.threads)

    found = []
    for entry in _trials(cases, answering, finished):
        if entry is not None:
            found.append(entry)
            print(json.dumps(entry), file=sys.stderr, flush=True)
    return {"quick": chosen.quick, "nature": stated, "loop": loop_summary(found)}


def _loop(path: str) -> BenchmarkExperiment:
    network = read_network(path)
    anatomy = Anatomy(network)
    if not anatomy.closed_loop or not anatomy.beds:
        raise InputError(path, None, None, "not a closed loop with coronary beds; tune one with coronaryuq tune")
    return closed_loop(network)
