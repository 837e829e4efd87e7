"""The console command `coronaryuq`: check a case, explain a result, run a benchmark, look at a machine."""

import argparse
import importlib
import json
import os
import shutil
import sys
from collections.abc import Sequence
from contextlib import nullcontext

from coronaryuq import __version__
from coronaryuq.core.command_line import non_negative_int, positive_int
from coronaryuq.core.errors import InputError, os_error_line

BENCHMARKS = {
    "zerod": "zerod",
    "perfusion": "perfusion",
    "dream": "dream",
    "flow3d": "flow3d.benchmark",
    "table": "estimation.table",
    "coverage": "estimation.coverage",
    "discrepancy": "discrepancy.benchmark",
    "campaign": "campaign",
}
"""Module of each benchmark, within `coronaryuq.bench`."""
OPTIONS = {
    "data": ("flow3d", "table", "coverage"),
    "rows": ("table", "coverage"),
    "network": ("zerod", "discrepancy"),
    "seeds": ("discrepancy",),
    "offset": ("discrepancy",),
    "strengths": ("discrepancy",),
    "noises": ("discrepancy",),
    "effects": ("discrepancy",),
    "solver": ("discrepancy",),
    "threads": ("discrepancy",),
    "resume": ("discrepancy",),
    "config": ("campaign",),
}
"""Which benchmarks take an option of `coronaryuq bench`: here, because to ask their modules is to import them."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code. Wrong input is one line on standard error and exit code 2."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    try:
        return chosen.run(chosen)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return InputError.EXIT_CODE
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # whoever read standard output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a result cannot be written
        line = os_error_line(error)
        if error.filename is None and line is None:
            raise
        print(f"error: {line or f'{error.filename2 or error.filename}: {error.strerror}'}", file=sys.stderr)
        return InputError.EXIT_CODE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="coronaryuq", description=__doc__)
    parser.add_argument("--version", action="version", version=f"coronaryuq {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    check = commands.add_parser(
        "check", help="read a case file and all that it names; say what it holds, or its first mistake"
    )
    check.add_argument("case", metavar="CASE", help="path of a case.yaml")
    check.set_defaults(run=_check)

    explain = commands.add_parser("explain", help="where a result comes from, and the command that makes it again")
    explain.add_argument("result", metavar="RESULT", help="a file of a campaign, under results/NAME")
    explain.set_defaults(run=_explain)

    verify = commands.add_parser("verify", help="which results are no longer what their jobs wrote")
    verify.add_argument("results", metavar="FOLDER", help="results folder of a campaign, results/NAME")
    verify.add_argument("--remove", action="store_true", help="remove them, so that the campaign makes them again")
    verify.set_defaults(run=_verify)

    bench = commands.add_parser("bench", help="run a benchmark; its result is one JSON object on standard output")
    bench.add_argument("name", choices=BENCHMARKS, metavar="NAME", help=", ".join(BENCHMARKS))
    bench.add_argument("--quick", action="store_true", help="a smaller size, within 50 s on two cores")
    bench.add_argument("--json", action="store_true", help="one line of JSON (default: indented)")
    sizes, noises = ("weak", "medium", "strong"), ("half", "nominal", "double", "understated", "lasting")
    for name, told, how in (
        ("data", "published runs; flow3d: a folder per mesh of one patient", {"metavar": "FOLDER"}),
        ("rows", "rows of the table: row, column_3d, column_0d", {"metavar": "FILE"}),
        ("network", "svZeroDSolver JSON", {"metavar": "FILE"}),
        ("seeds", "repetitions of every cell", {"metavar": "N", "type": positive_int}),
        ("offset", "first of the seeds", {"metavar": "SEED", "type": non_negative_int}),
        ("strengths", "of hidden effects; default: medium", {"nargs": "+", "choices": sizes}),
        ("noises", "of measurements; default: nominal", {"nargs": "+", "choices": noises}),
        ("effects", "cells wanted, as they are labelled; default: all", {"nargs": "+", "metavar": "CELL"}),
        ("solver", "that the hidden cases' data come from; default: 0d", {"choices": ("0d", "3d")}),
        ("threads", "of each search; default: 1", {"metavar": "N", "type": positive_int}),
        ("resume", "keeps finished cases, of which a run that was killed goes on", {"metavar": "FILE"}),
        ("config", "configuration", {"metavar": "FILE"}),
    ):
        bench.add_argument(f"--{name}", help=f"{told} ({', '.join(OPTIONS[name])})", **how)
    bench.set_defaults(run=_bench)

    doctor = commands.add_parser("doctor", help="check this machine: libraries, MPI, pictures, space, solvers")
    doctor.add_argument("--environment", action="store_true", help="the Python environment only")
    doctor.set_defaults(run=_doctor)

    for name, package, told in (
        ("solve", "zerod", "march one 0D network: svZeroDSolver's input and output"),
        ("tune", "calibration", "tune a closed loop to a table of clinical targets"),
        ("fit", "posterior", "find the resistances at which a network shares its flow as a table asks"),
        ("discrepancy", "discrepancy", "find what a model of a case is missing"),
    ):
        command = importlib.import_module(f"coronaryuq.{package}.command")
        chosen = commands.add_parser(name, help=told)
        command.add_arguments(chosen)
        chosen.set_defaults(run=command.main)
    return parser


def _check(chosen: argparse.Namespace) -> int:
    from coronaryuq.case.check import check_case

    findings, summary = check_case(chosen.case)
    for line in summary:
        print(line)
    for line in findings:
        print(f"error: {line}", file=sys.stderr)
    return InputError.EXIT_CODE if findings else 0


def _explain(chosen: argparse.Namespace) -> int:
    from coronaryuq.cli.explain import explain

    text, sound = explain(chosen.result)
    print(text, flush=True)
    return 0 if sound else 1


def _verify(chosen: argparse.Namespace) -> int:
    from coronaryuq.cli.explain import altered
    from coronaryuq.core.io.lock import lock_results

    found = altered(chosen.results)
    with lock_results(chosen.results) if chosen.remove else nullcontext():
        for path in found:
            if chosen.remove:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            print(f"{path}: not what its job wrote{'; removed' if chosen.remove else ''}", file=sys.stderr)
    return 1 if found and not chosen.remove else 0


def _bench(chosen: argparse.Namespace) -> int:
    given = {name: getattr(chosen, name) for name in OPTIONS if getattr(chosen, name) is not None}
    for name, value in given.items():
        if chosen.name not in OPTIONS[name]:
            *others, last = OPTIONS[name]
            owners = f"{', '.join(others)} and {last}" if others else last
            raise InputError(f"bench {chosen.name}", f"--{name}", value, f"not an option of it, but of {owners}")
    module = importlib.import_module(f"coronaryuq.bench.{BENCHMARKS[chosen.name]}")
    result = {"benchmark": chosen.name, "quick": chosen.quick, **module.run(quick=chosen.quick, **given)}
    print(json.dumps(result, indent=None if chosen.json else 1, default=lambda value: value.tolist()))
    return 0


def _doctor(chosen: argparse.Namespace) -> int:
    from coronaryuq.cli.doctor import examine

    sound = True
    for finding in examine(environment_only=chosen.environment):
        print(finding)
        sound &= finding.sound
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
