"""The command `coronaryuq discrepancy`: search for missing effects in one case given by files."""

import argparse
import json
import sys
from pathlib import Path
from typing import get_args

from coronaryuq.core.command_line import non_negative_int, positive_int
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import check_folder
from coronaryuq.discrepancy.data.conditions import drive_paths
from coronaryuq.discrepancy.data.recordings import prepare_case
from coronaryuq.discrepancy.result import write
from coronaryuq.discrepancy.result.summary_text import write_paragraph
from coronaryuq.discrepancy.search_case import search_case
from coronaryuq.discrepancy.search_recordings import in_words, search_recordings
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.table_model.search import discover_pairs
from coronaryuq.report.search_page import write_search_page

UNITS = get_args(Settings.model_fields["pressure_unit"].annotation)
SOURCES = ("pairs", "recordings", "model", "measurements", "conditions")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `coronaryuq discrepancy` to `parser`."""
    parser.description = (
        "Find physical effects that a model is missing: locate the misfit, then name, add and check effects."
    )
    parser.add_argument("--model", metavar="NETWORK.json", help="0D network, svZeroDSolver JSON")
    parser.add_argument("--measurements", metavar="M.csv", help="table of measurements")
    parser.add_argument("--conditions", metavar="C.yaml", help="conditions under which they were measured")
    parser.add_argument(
        "--pairs", nargs=2, metavar=("SIMULATED.csv", "MEASURED.csv"), help="search a table model instead of a network"
    )
    parser.add_argument(
        "--recordings",
        nargs="+",
        metavar=("FOLDER", "ANIMAL"),
        help="search recordings FOLDER/ANIMAL_CONDITION.csv: flow in one artery driven by measured pressures; of "
        "several animals: recordings that one device made, searched together for its errors",
    )
    parser.add_argument(
        "--held-out",
        nargs="+",
        metavar="CONDITION",
        help="with --recordings: conditions held out of every fit (default: those whose names end in dob...)",
    )
    parser.add_argument(
        "--free-bed",
        action="store_true",
        help="with --recordings: calibrate the shape of the bed, and a stenosis in conditions named ...sten...",
    )
    parser.add_argument(
        "--pressure-unit",
        choices=UNITS,
        default="auto",
        help="pressure unit of the network (default: auto: dyn/cm2 or mmHg, from the simulated root pressure)",
    )
    parser.add_argument(
        "--noise",
        choices=("estimated", "stated"),
        default="estimated",
        help="noise of waveforms: as in the measurement table (stated), or by their scatter (estimated, default)",
    )
    parser.add_argument("--out", metavar="DIR", required=True, help="output folder")
    parser.add_argument(
        "--seed", type=non_negative_int, default=1, help="seed of cross-validation folds and intervals (default: 1)"
    )
    parser.add_argument("--threads", type=positive_int, default=1, help="threads of the 0D solver (default: 1)")
    parser.add_argument(
        "--page", action="store_true", help="also draw figures, and write them with the answer to DIR/report.html"
    )
    parser.add_argument(
        "--json", action="store_true", help="print the result as one JSON object instead of a paragraph"
    )


def main(args: argparse.Namespace) -> int:
    """Run the command with progress on standard error; return the exit code.

    Raises
    ------
    InputError
        For invalid input, before anything is written.
    """
    out = check_folder(args.out)
    result = _run(args, out)
    print(json.dumps(result, default=float) if args.json else result["paragraph"])
    if args.page:
        page = write_search_page(out, *_of_page(args, out, result))
        print(f"wrote {page}", file=sys.stderr)
    else:
        print(f"wrote the tables of the answer to {out}; --page draws them on a page", file=sys.stderr)
    return 0


def _of_page(args: argparse.Namespace, out: Path, result: dict) -> tuple[dict[str, Path], str]:
    """Return the searches of a page, with their folders, and what holds for all of them."""
    animals = (args.recordings or [])[1:]
    if len(animals) > 1:
        return {animal: out / animal for animal in animals}, " ".join(map(in_words, result["devices"]))
    if animals or args.pairs:
        return {animals[0] if animals else "pairs": out}, ""
    return {f"{Path(args.measurements).name} against {Path(args.model).name}": out}, ""


def _run(args: argparse.Namespace, out: Path) -> dict:
    _check_options(args)
    _check_overwriting(args, out)
    if args.pairs:
        return discover_pairs(*args.pairs, out_dir=out, seed=args.seed)
    settings = Settings(threads=args.threads, pressure_unit=args.pressure_unit, noise=args.noise)
    if args.recordings:
        folder, *animals = args.recordings
        if not animals:
            raise InputError("command line", "--recordings", folder, "give the folder and at least one animal")
        if len(animals) > 1:
            return search_recordings(folder, animals, out, settings, args.seed, args.held_out, args.free_bed)
        case = prepare_case(folder, animals[0], out / "case", args.held_out, args.free_bed)
    else:
        for name in ("model", "measurements", "conditions"):
            if not getattr(args, name):
                raise InputError("command line", f"--{name}", None, "missing; or give --pairs or --recordings")
        case = args.model, args.measurements, args.conditions
    answer = search_case(*case, out, settings, args.seed)
    return answer | {"paragraph": write_paragraph(out / "discrepancy.json", out / "paragraph.txt")}


def _check_overwriting(args: argparse.Namespace, out: Path) -> None:
    """Raise `InputError` if a result file would overwrite an input file."""
    inputs = [Path(path) for path in (args.model, args.measurements, args.conditions, *(args.pairs or ())) if path]
    inputs += drive_paths(args.conditions) if args.conditions else []
    for path in inputs:
        is_drive = path.resolve().parent == (out / "drives").resolve()
        if is_drive or any(path.resolve() == (out / name).resolve() for name in (*write.WRITTEN, *write.OF_PAGE)):
            raise InputError("command line", "--out", str(out), f"would overwrite {path}; choose another folder")


def _check_options(args: argparse.Namespace) -> None:
    """Raise `InputError` for combinations of options in which one would be ignored."""

    def reject(option, value, remedy):
        raise InputError("command line", option, value, remedy)

    source, *others = [name for name in SOURCES if getattr(args, name)] or [""]
    if source in ("pairs", "recordings") and others:
        reject(f"--{others[0]}", getattr(args, others[0]), f"cannot be combined with --{source}; remove one")
    if args.pressure_unit != "auto" and source in ("pairs", "recordings"):
        reject("--pressure-unit", args.pressure_unit, f"applies to --model only, not to --{source}")
    if args.noise != "estimated" and source == "pairs":
        reject("--noise", args.noise, "only applies to waveforms; --pairs has none")
    if args.free_bed and source != "recordings":
        reject("--free-bed", None, "applies to --recordings only; use `free` in the conditions file instead")
    if args.held_out and source != "recordings":
        remedy = "applies to --recordings only; use `held_out` in the conditions file instead"
        reject("--held-out", args.held_out, remedy)
