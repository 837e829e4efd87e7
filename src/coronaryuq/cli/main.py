"""The console command `coronaryuq`."""

import argparse
import importlib
import io
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict

import shtab

from coronaryuq import __version__
from coronaryuq.cli.examples import EXAMPLES
from coronaryuq.core.command_line import Parser
from coronaryuq.core.errors import InputError, os_error_line
from coronaryuq.core.private_folders import complete_environment

BENCHMARKS = {
    "zerod": ("zerod", "speed of the 0D solver, compared with svZeroDSolver if it is installed"),
    "conformance": ("conformance", "agreement of the 0D solver with svZeroDSolver, case by case"),
    "trees": ("large_trees", "speed, set-up and memory of the 0D solver on trees with many outlets"),
    "perfusion": ("perfusion", "cost of noisy perfusion realisations on a large left ventricle"),
    "dream": ("dream", "posterior sampling of the bundled patient, compared with emcee"),
    "flow3d": ("flow3d.benchmark", "cost, verification and mesh convergence of the 3D solver"),
    "table": ("estimation.table", "the paper's table of estimates from published runs"),
    "scale": ("estimation.scale", "cost of the paper's table, without networks, for many propagation samples"),
    "coverage": ("estimation.coverage", "coverage of the confidence intervals over repeated trials"),
    "models": ("estimation.models", "error of the estimators beside that of linear combinations of several 0D outputs"),
    "discrepancy": ("discrepancy.benchmark", "how often the search finds hidden effects"),
    "endtoend": ("endtoend.benchmark", "whole campaigns on synthetic patients, scored against their true FFR"),
    "campaign": ("campaign", "a campaign's planning time, overhead and number of files"),
}
"""Benchmark → module within `coronaryuq.bench`, with a function `run` and, if it has options, `add_arguments`."""
COMMANDS = {
    "init": ("cli.init", "start a case of your own from a project, a surface, centrelines or a network"),
    "run": ("cli.run", "run a campaign in the current folder"),
    "status": ("cli.status", "show how far a campaign is, the time left, and its results"),
    "compare": ("cli.compare", "compare FFR of two campaigns"),
    "crate": ("cli.crate", "pack a campaign with its workflow, inputs and jobs as an RO-Crate"),
    "solve": ("zerod.command", "solve one 0D network, in svZeroDSolver's formats"),
    "tune": ("calibration.command", "tune a closed loop to a table of clinical targets"),
    "fit": ("posterior.command", "fit the resistances of coronary beds to a table of flows"),
    "discrepancy": ("cli.discrepancy", "find physical effects that a model is missing"),
    "serve": ("serve.command", "serve the models of a campaign to UM-Bridge clients"),
}
"""Command → module with its `add_arguments` and `main`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    arguments
        Command line without the program's name; that of the process by default.

    Returns
    -------
    int
        Exit code: 2 for wrong input, which is reported on one line of standard error.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a locale may lack ° or ±, which must not stop a command
            stream.reconfigure(errors="replace")
    if not os.path.isabs(os.environ.get("HOME", "/")):  # libraries would make folders in the current one
        complete_environment()
    words = list(sys.argv[1:] if arguments is None else arguments)
    words, rest = _split(words)
    parser = _parser(words)
    options, behind = parser.parse_known_args(words, argparse.Namespace(rest=rest))
    if words[:1] == ["run"] and not any(word.startswith("-") for word in behind):
        options.targets = [*options.targets, *behind]  # argparse takes the first group of positional arguments only
    elif behind:
        parser.error(f"unrecognized arguments: {' '.join(behind)}")
    try:
        _check_current_folder()
        return options.run(options)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return InputError.EXIT_CODE
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # standard output was closed by its reader
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a result cannot be written
        line = os_error_line(error)
        if error.filename is None and line is None:
            raise
        print(f"error: {line or f'{error.filename2 or error.filename}: {error.strerror}'}", file=sys.stderr)
        return InputError.EXIT_CODE


def _check_current_folder() -> None:
    """Raise InputError if the current folder is gone: relative paths mean nothing then, and libraries stop."""
    try:
        os.getcwd()
    except FileNotFoundError:
        raise InputError("current folder", None, None, "was deleted; change to another one (cd)") from None


def _split(words: list[str]) -> tuple[list[str], list[str]]:
    """Separate the arguments that `run` passes to Snakemake, after `--`, from its own options."""
    if words[:1] != ["run"] or "--" not in words:
        return words, []
    end = words.index("--")
    return words[:end], words[end + 1 :]


def _parser(arguments: Sequence[str], whole: bool = False) -> argparse.ArgumentParser:
    """Build the parser.

    It has the options of the chosen command only, because importing all their packages takes seconds, or if `whole`,
    those of all commands.
    """
    parser = Parser(
        prog="coronaryuq",
        description="Coronary haemodynamics of one patient, with calibrated error bars. Campaigns are run by Snakemake "
        "(see README.md); these commands check input and results, and run single steps without a campaign.",
    )
    parser.add_argument("--version", action="version", version=f"coronaryuq {__version__}")
    parser.show_examples(EXAMPLES[""])
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def add_command(name, help, run):
        command = commands.add_parser(name, help=help, description=f"{help[0].upper()}{help[1:]}.")
        command.set_defaults(run=run)
        return command

    demo = add_command("demo", "run every stage once on the bundled patient: three minutes to a report", _demo)
    demo.add_argument("--cores", default="all", help="cores of this machine to use (default: all)")
    check = add_command("check", "check a case or a configuration, and all files that it refers to", _check)
    check.add_argument("file", metavar="FILE", help="path of a case.yaml, or of a campaign's configuration")
    check.add_argument("--picture", metavar="FILE", help="picture of the vessels (default: case.check.png by the case)")
    explain = add_command("explain", "show how a result was computed, and the command to reproduce it", _explain)
    explain.add_argument("result", metavar="RESULT", help="a result file of a campaign, under results/NAME")
    verify = add_command("verify", "list results that have changed since their jobs wrote them", _verify)
    verify.add_argument("results", metavar="FOLDER", help="results folder of a campaign, results/NAME")
    verify.add_argument("--remove", action="store_true", help="also delete them, so that the next run regenerates them")
    doctor = add_command("doctor", "check this machine: libraries, MPI, 3D rendering, disk, solvers, SLURM", _doctor)
    doctor.add_argument("--environment", action="store_true", help="check the Python environment only")
    for command in (check, explain, verify, doctor):
        command.add_argument("--json", action="store_true", help="print one JSON object (docs/reference/formats.md)")
    completion = add_command("completion", "print a completion script for your shell", _completion)
    completion.add_argument(
        "shell", choices=shtab.SUPPORTED_SHELLS, help='for bash: eval "$(coronaryuq completion bash)"'
    )
    bench = add_command("bench", "run a benchmark and print one JSON object", _bench)
    names = bench.add_subparsers(required=True, metavar="BENCHMARK")
    for name, (module_name, help) in BENCHMARKS.items():
        benchmark = names.add_parser(name, help=help, description=f"{help[0].upper()}{help[1:]}.")
        if whole or (arguments[:1] == ["bench"] and name in arguments):
            module = importlib.import_module(f"coronaryuq.bench.{module_name}")
            benchmark.set_defaults(benchmark=name, function=module.run)
            getattr(module, "add_arguments", lambda parser: None)(benchmark)
        benchmark.add_argument("--quick", action="store_true", help="smaller problem, within 50 s on two cores")
        benchmark.add_argument("--json", action="store_true", help="print the JSON on one line")
        benchmark.show_examples(EXAMPLES[f"bench {name}"])
    for name, (module_name, help) in COMMANDS.items():
        command = commands.add_parser(name, help=help)
        if whole or arguments[:1] == [name]:
            module = importlib.import_module(f"coronaryuq.{module_name}")
            module.add_arguments(command)
            command.set_defaults(run=module.main)
    for name, command in commands.choices.items():
        command.show_examples(EXAMPLES[name])
    chosen = commands.choices.get(next(iter(arguments), ""))
    parser.chosen = names.choices.get(next(iter(arguments[1:]), "")) if chosen is bench else chosen
    return parser


def _demo(options: argparse.Namespace) -> int:
    from coronaryuq.cli.run import demo

    return demo(options.cores)


def _completion(options: argparse.Namespace) -> int:
    print(shtab.complete(_parser([], whole=True), options.shell))
    return 0


def _check(options: argparse.Namespace) -> int:
    from coronaryuq.cli.check import check, draw_check

    found = check(options.file)
    drawn = draw_check(found, options.picture) if options.picture or not options.json else []
    if options.json:
        _print_json(found.as_json())
        return 0 if found.error is None else InputError.EXIT_CODE
    for line in found.lines + drawn:
        print(line, flush=True)
    if found.error is not None:
        raise found.error
    return 0


def _explain(options: argparse.Namespace) -> int:
    from coronaryuq.campaign.explain import explain

    origin = explain(options.result)
    if options.json:
        _print_json(origin.as_json())
    else:
        print(origin, flush=True)
    return 0 if origin.unchanged else 1


def _verify(options: argparse.Namespace) -> int:
    from coronaryuq.campaign.explain import remove_changed, verify

    found = remove_changed(options.results) if options.remove else verify(options.results)
    if options.json:
        _print_json(found.as_json() | {"removed": options.remove})
    else:
        for path in found.changed:
            print(f"{path}: changed since its job wrote it{'; removed' if options.remove else ''}", file=sys.stderr)
        print(found)
    return 1 if found.changed and not options.remove else 0


def _print_json(value: dict) -> None:
    print(json.dumps(value, indent=1, ensure_ascii=False), flush=True)


def _bench(options: argparse.Namespace) -> int:
    others = ("run", "rest", "benchmark", "function", "json")
    values = {name: value for name, value in vars(options).items() if name not in others and value is not None}
    result = {"benchmark": options.benchmark, "quick": options.quick, **options.function(**values)}
    print(json.dumps(result, indent=None if options.json else 1, default=lambda value: value.tolist()))
    return 0


def _doctor(options: argparse.Namespace) -> int:
    from coronaryuq.cli.doctor import examine

    findings = examine(environment_only=options.environment)
    if options.json:
        found = list(findings)
        sound = all(finding.sound for finding in found)
        _print_json({"sound": sound, "checks": [asdict(finding) for finding in found]})
        return 0 if sound else 1
    sound = True
    for finding in findings:
        print(finding, flush=True)
        sound &= finding.sound
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
