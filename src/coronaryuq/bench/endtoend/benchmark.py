"""Benchmark `endtoend`: whole campaigns on synthetic patients, scored against their truth."""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast, get_args

from coronaryuq import config
from coronaryuq.bench.endtoend import patients
from coronaryuq.bench.endtoend.campaign import Said, run_campaign
from coronaryuq.bench.endtoend.data import BED_NOISE, write_measured
from coronaryuq.bench.endtoend.patients import Drawn, draw
from coronaryuq.bench.endtoend.score import summary
from coronaryuq.bench.endtoend.truth import LEVELS, Truth, find_truth
from coronaryuq.case.settings import Uncertainty
from coronaryuq.core import provenance, shipped
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text

SETTINGS: tuple[Uncertainty, ...] = get_args(Uncertainty)
SIMPLE = 8
"""Index of a patient with one stenosis, whose truth takes half a minute."""
STATED = {
    "left_dominant": patients.LEFT_DOMINANT, "numbers": patients.NUMBERS, "places": patients.PLACES,
    "length": patients.LENGTH, "reduction": patients.REDUCTION, "uniform": patients.UNIFORM,
    "microvascular": patients.MICROVASCULAR, "heart_spread": patients.HEART_SPREAD, "bed_noise": BED_NOISE,
}  # fmt: skip
"""Distributions of the patients."""


@dataclass(frozen=True)
class Options:
    """Options of the benchmark, as on the command line."""

    quick: bool = False
    patients: int = 8
    first: int = 0
    seed: int = 1
    setting: str = "both"
    noise: float = 1.0
    truth: str = "default"
    truth_only: bool = False
    config: str | None = None
    cores: int = 2
    resume: str | None = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--patients", type=int, default=8, metavar="N", help="number of patients (default: 8)")
    parser.add_argument("--first", type=int, default=0, metavar="K", help="index of the first patient (default: 0)")
    parser.add_argument("--seed", type=int, default=1, help="seed of all patients (default: 1)")
    parser.add_argument(
        "--setting", choices=[*SETTINGS, "both"], default="both", help="`uncertainty` of the campaigns (default: both)"
    )
    parser.add_argument(
        "--noise", type=float, default=1.0, metavar="F",
        help="factor on the errors of all data and assumptions; 0: the data are the truth (default: 1)",
    )  # fmt: skip
    parser.add_argument(
        "--truth",
        choices=list(LEVELS),
        default="default",
        help="mesh and time steps of the 3D truth (default: default)",
    )
    parser.add_argument("--truth-only", action="store_true", help="run no campaign: the truth, and FFR by 0D beside it")
    parser.add_argument("--config", metavar="FILE", help="configuration of the campaigns (default: config/smoke.yaml)")
    parser.add_argument("--cores", type=int, default=2, help="cores of a campaign (default: 2)")
    parser.add_argument(
        "--resume", metavar="FILE", help="JSON lines, one a patient and setting: read what is there, append the rest"
    )


def run(**values: Any) -> dict:
    """Make patients, run their campaigns, and score what these say.

    `setting` and the scores beside it are those of `full`, unless only `paper` is asked for; with `both`, `paper` has
    the same scores on the same patients. `lines`: every patient. `truth_beside_0d`: differences of FFR.
    """
    options = Options(**values)
    if options.noise < 0.0:
        raise InputError("bench endtoend", "--noise", options.noise, "give 0 or a positive factor")
    if options.patients < 1:
        raise InputError("bench endtoend", "--patients", options.patients, "give 1 or more")
    configuration = shipped.configuration(options.config or "smoke")
    settings: Sequence[str] = SETTINGS if options.setting == "both" else (options.setting,)
    if options.quick:
        # A campaign takes minutes; the truth of one patient, with 0D beside it, fits the time.
        options = replace(options, truth_only=True, first=SIMPLE, patients=1)
    if options.truth_only:
        settings = ("truth",)
    head = {
        "seed": options.seed, "noise": options.noise, "truth": options.truth,
        "stated": provenance.digest([STATED, config.load(configuration).model_dump(mode="json")]),
    }  # fmt: skip
    lines = Lines(options.resume, head)
    wanted = range(options.first, options.first + options.patients)
    for index in wanted:
        missing = [setting for setting in settings if (index, setting) not in lines.found]
        for line in _lines(index, missing, options, configuration):
            lines.add(line)
            print(json.dumps(line), file=sys.stderr, flush=True)
    chosen = {setting: [lines.found[index, setting] for index in wanted] for setting in settings}
    first = settings[-1] if "full" not in settings else "full"
    result = {"setting": first, **{name: value for name, value in head.items() if name != "stated"}, **STATED}
    result |= summary(chosen[first])
    if len(settings) > 1:
        result["paper"] = summary(chosen["paper"])
    return result | {"levels": beside_0d(chosen[first]), "lines": [line for own in chosen.values() for line in own]}


class Lines:
    """Finished patients as JSON lines, one per patient and setting, after a line that states how they were made.

    found: (index, setting) → line.

    Raises
    ------
    InputError
        If the file holds something else, or patients of other distributions, settings, seed, noise or truth.
    """

    def __init__(self, path: str | Path | None, head: dict):
        self.path, self.found = None if path is None else Path(path), {}
        if self.path is None:
            return
        lines = self._read() if self.path.exists() else []
        if lines and lines[0] != head:
            differing = next((name for name in head if lines[0].get(name) != head[name]), "head")
            remedy = f"{differing} differs from what is asked for; choose another file"
            raise InputError(self.path, differing, lines[0].get(differing), remedy)
        self.found = {(line["index"], line["setting"]): line for line in lines[1:]}
        # Also drops the part after the last line break, which was incomplete when the run was killed.
        write_text(self.path, "".join(json.dumps(line) + "\n" for line in [head, *self.found.values()]))

    def _read(self) -> list[dict]:
        assert self.path is not None
        try:
            lines = [json.loads(line) for line in self.path.read_text(encoding="utf-8").split("\n")[:-1]]
            if any("stated" not in line for line in lines[:1]):
                raise ValueError
            if any(not {"index", "setting", "vessels", "failed"} <= set(line) for line in lines[1:]):
                raise ValueError
        except (ValueError, TypeError):
            remedy = "no patients of this benchmark; choose another file, or remove it to start anew"
            raise InputError(self.path, None, None, remedy) from None
        return lines

    def add(self, line: dict) -> None:
        """Append a finished patient."""
        self.found[line["index"], line["setting"]] = line
        if self.path is not None:
            with open(self.path, "a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")


def _lines(index: int, settings: Sequence[str], options: Options, configuration: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of one patient for some settings."""
    if not settings:
        return
    drawn = draw(options.seed, index, options.noise)
    common = {"index": index, "drawn": drawn.stated(), "code": provenance.code_version()}
    silent = {"rhat_max": None, "ess_bulk_min": None, "converged": None, "cpu_s": 0.0}
    if not drawn.lesions:  # there is no FFR to predict
        yield from ({**common, "setting": one, "failed": None, "vessels": {}, **silent} for one in settings)
        return
    started = sum(os.times()[:4])
    try:
        truth = find_truth(drawn, LEVELS[options.truth])
    except (InputError, RuntimeError, ValueError) as error:
        failed = " ".join(f"truth: {error}".split())
        yield from ({**common, "setting": one, "failed": failed, "vessels": {}, **silent} for one in settings)
        return
    common["truth_cpu_s"] = round(sum(os.times()[:4]) - started, 1)
    levels = {name: {"ffr_0d": truth.ffr_0d[name], "ffr_trained": truth.ffr_trained[name]} for name in truth.ffr_0d}
    common |= {"truth": truth.quantities, "levels": levels}
    with tempfile.TemporaryDirectory(prefix="endtoend-") as scratch:
        write_measured(drawn, truth.patient, Path(scratch) / "case")
        for setting in settings:
            if setting == "truth":
                yield {**common, "setting": setting, "failed": None, "vessels": {}, **silent}
                continue
            folder = Path(scratch) / setting
            folder.mkdir()
            case = Path(scratch) / "case" / "case.yaml"
            try:
                found = run_campaign(
                    case,
                    list(truth.ffr_0d),
                    configuration,
                    cast(Uncertainty, setting),
                    drawn.seed + index,
                    options.noise,
                    options.cores,
                    folder,
                )
            except RuntimeError as error:
                failed = " ".join(f"campaign: {error}".split())[-600:]
                yield {**common, "setting": setting, "failed": failed, "vessels": {}, **silent}
                continue
            yield {**common, "setting": setting, "failed": None, **_scored(drawn, truth, found)}


def _scored(drawn: Drawn, truth: Truth, found: Said) -> dict[str, Any]:
    """Return what a campaign says of each vessel beside the truth."""
    vessels = {}
    for lesion in drawn.lesions:
        said = found.vessels.get(lesion.name.lower(), {})
        vessels[lesion.name] = {
            quantity: {"truth": truth.quantities[f"{quantity}_{lesion.name.lower()}"], **answer}
            for quantity, answer in said.items()
        }
    diagnosis = {"rhat_max": found.rhat_max, "ess_bulk_min": found.ess_bulk_min, "converged": found.converged}
    return {"vessels": vessels, **diagnosis, "cpu_s": round(found.cpu_s, 1)}


def beside_0d(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the root mean square and the largest difference of FFR by 0D from that of the 3D truth.

    `ffr_0d`: with the losses of its vessels' shape; `ffr_trained`: with those that the 3D runs taught.
    """
    found: dict[str, Any] = {}
    for level in ("ffr_0d", "ffr_trained"):
        off = [
            values[level] - line["truth"][f"ffr_{name.lower()}"]
            for line in lines
            for name, values in line.get("levels", {}).items()
        ]
        if off:
            rms = (sum(one**2 for one in off) / len(off)) ** 0.5
            found[level] = {"vessels": len(off), "rms": rms, "largest": max(off, key=abs)}
    return found
