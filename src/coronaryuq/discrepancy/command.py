"""`coronaryuq discrepancy`: one search from files."""

import argparse
import json
import sys
from pathlib import Path
from typing import get_args

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.core import arguments, units
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.files import check_folder
from coronaryuq.discrepancy.data.conditions import drives_of, read_conditions
from coronaryuq.discrepancy.data.recordings import prepare
from coronaryuq.discrepancy.inference.read_problem import check_searchable, read_problem
from coronaryuq.discrepancy.result import write
from coronaryuq.discrepancy.selection.search import discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.table_model import search
from coronaryuq.zerod.network.read import note_negative_resistances, read_network

UNITS = get_args(Settings.model_fields["pressure_unit"].annotation)
NAMELESS = ("model", "network")
"""What parts of the search call the network, which they have from no file."""
SOURCES = ("pairs", "recordings", "model", "measurements", "conditions")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Find what a model is missing: locate, name, add, verify."
    parser.add_argument("--model", metavar="NETWORK.json", help="0D network, svZeroDSolver JSON")
    parser.add_argument("--measurements", metavar="M.csv", help="measurement table")
    parser.add_argument("--conditions", metavar="C.yaml", help="conditions of the measurements")
    parser.add_argument("--pairs", nargs=2, metavar=("SIMULATED.csv", "MEASURED.csv"), help="a table model instead")
    parser.add_argument(
        "--recordings",
        nargs=2,
        metavar=("FOLDER", "ANIMAL"),
        help="recorded flow of one artery under measured pressures instead, ANIMAL_CONDITION.csv",
    )
    parser.add_argument(
        "--held-out",
        nargs="+",
        metavar="CONDITION",
        help="recorded conditions that enter no fit (default: those whose names end in dob...)",
    )
    parser.add_argument(
        "--free-bed",
        action="store_true",
        help="of recordings: the bed's shape is unknown, and so is a stenosis in conditions named ...sten...",
    )
    parser.add_argument(
        "--pressure-unit",
        choices=UNITS,
        default="auto",
        help="pressure unit of the network (default auto: dyn/cm2 or mmHg, by its root pressure)",
    )
    parser.add_argument(
        "--noise",
        choices=("estimated", "said"),
        default="estimated",
        help="of waveforms: as they scatter, where that explains more, or as their sd say (default estimated)",
    )
    parser.add_argument("--out", metavar="DIR", required=True, help="folder for results")
    parser.add_argument("--seed", type=arguments.seed, default=1, help="seed of folds and intervals (default 1)")
    parser.add_argument("--threads", type=arguments.count, default=1, help="threads of the 0D engine (default 1)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a paragraph")


def main(args: argparse.Namespace) -> int:
    """Run the command, progress on standard error; returns the exit code.

    Raises `InputError` for bad input, before anything is written.
    """
    answer = _answer(args, check_folder(args.out))
    print(json.dumps(answer, default=float) if args.json else answer["paragraph"])
    return 0


def _answer(args: argparse.Namespace, out: Path) -> dict:
    _one_source(args)
    _spares_its_input(args, out)
    if args.pairs:
        return search.discover_pairs(*args.pairs, out=out, seed=args.seed)
    settings = Settings(threads=args.threads, pressure_unit=args.pressure_unit, noise=args.noise)
    if args.recordings:
        prepare(*args.recordings, out / "case", args.held_out, args.free_bed)
        case = [out / "case" / name for name in ("model.json", "measurements.csv", "conditions.yaml")]
        return from_files(*case, out, settings, args.seed)
    for name in ("model", "measurements", "conditions"):
        if not getattr(args, name):
            raise InputError("command line", f"--{name}", None, "missing; or give --pairs or --recordings")
    return from_files(args.model, args.measurements, args.conditions, out, settings, args.seed)


def _spares_its_input(args: argparse.Namespace, out: Path) -> None:
    """Raise `InputError` where results would go over what the search reads."""
    given = [args.model, args.measurements, args.conditions, *(args.pairs or ())]
    given = [Path(one) for one in given if one]
    given += drives_of(args.conditions) if args.conditions else []
    for one in given:
        beside = one.resolve().parent == (out / "drives").resolve()
        if beside or any(one.resolve() == (out / name).resolve() for name in write.WRITTEN):
            raise InputError("command line", "--out", str(out), f"would write over {one}; name another folder")


def _report(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _one_source(args: argparse.Namespace) -> None:
    """Raise `InputError` where two of the three kinds of input are given, of which one would not be looked at."""
    first, *others = [name for name in SOURCES if getattr(args, name)] or [""]
    if first in ("pairs", "recordings") and others:
        value = getattr(args, others[0])
        raise InputError("command line", f"--{others[0]}", value, f"not together with --{first}; leave one out")
    if args.pressure_unit != "auto" and first in ("pairs", "recordings"):
        raise InputError("command line", "--pressure-unit", args.pressure_unit, f"is of --model, not of --{first}")
    if args.noise != "estimated" and first == "pairs":
        raise InputError("command line", "--noise", args.noise, "is of waveforms, which --pairs has none of")
    if args.free_bed and first != "recordings":
        raise InputError("command line", "--free-bed", None, "is of --recordings; say it in the conditions file")
    if args.held_out and first != "recordings":
        raise InputError(
            "command line", "--held-out", args.held_out, "is of --recordings; say it in the conditions file"
        )


# Its matrices are small: threads of linear algebra would take more time from each other than they save, and round in
# another way for another number of them.
@threadpool_limits.wrap(limits=1)
def from_files(model, measurements, conditions, out: Path, settings: Settings, seed: int) -> dict:
    """Search one case given by files; writes the results into `out` and returns the summary."""
    network = read_network(model)
    note_negative_resistances(network, model)
    check_searchable(network, model)
    try:
        problem = read_problem(network, measurements, read_conditions(conditions), conditions, settings)
    except InputError as error:
        if error.file in NAMELESS:
            raise InputError(model, error.field, error.value, error.remedy) from None
        raise
    root = problem.forward.anatomy.pressure * problem.forward.pressure_factor / units.MMHG
    _report(f"pressure at the root of the model as it is: {root:.3g} mmHg")
    try:
        found = discover(problem, seed, report=_report)
    except FloatingPointError as error:
        residual = problem.whitened([(np.zeros(problem.count), [])])[0]
        failed = ", ".join(dict.fromkeys(problem.condition[~np.isfinite(residual)]))
        remedy = f"the model does not run under {failed or 'all conditions, recalibrated'}; see what changes there"
        raise InputError(conditions, failed or None, None, remedy) from error
    return write.write(found, out)
