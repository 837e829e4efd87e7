"""`coronaryuq run` and `coronaryuq demo`: run a campaign without a checkout, by Snakemake."""

import argparse
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from coronaryuq import config
from coronaryuq.campaign.explain import FOLDER, remove_changed
from coronaryuq.campaign.progress import Progress, kept
from coronaryuq.cli.snakemake_run import Command, PlanFailed, follow, plan, refused
from coronaryuq.cli.status import result_lines, state
from coronaryuq.core import shipped
from coronaryuq.core.errors import InputError, nearest
from coronaryuq.core.launcher import check_programs
from coronaryuq.core.private_folders import complete_environment

DEMO = "smoke"
"""Configuration of the demonstration: every stage once, on the bundled patient."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `coronaryuq run`."""
    parser.description = "Run a campaign in the current folder; results are written to results/NAME."
    parser.add_argument(
        "config",
        nargs="?",
        default="laptop",
        metavar="CONFIG",
        help=f"a configuration, or the name of one that comes with the package: {', '.join(shipped.configurations())}"
        " (default: laptop)",
    )
    parser.add_argument("targets", nargs="*", metavar="TARGET", help="target or file to make (default: the report)")
    parser.add_argument("--cores", default="all", help="cores of this machine to use (default: all)")
    parser.add_argument("--profile", metavar="NAME", help="Snakemake profile: default, slurm, or a folder of your own")
    parser.add_argument("--dry-run", "-n", action="store_true", help="show what would run, without running it")
    parser.add_argument("--verbose", "-v", action="store_true", help="show all that Snakemake and its jobs print")


def main(options: argparse.Namespace) -> int:
    """Run a campaign and print its results and where its report is.

    After `--`, words before the first option of Snakemake's are targets, as behind a `--` of Snakemake's own.
    """
    first = next((k for k, word in enumerate(options.rest) if word.startswith("-")), len(options.rest))
    return run(
        shipped.configuration(options.config),
        [*options.targets, *options.rest[:first]],
        cores=options.cores,
        profile=options.profile,
        dry_run=options.dry_run,
        verbose=options.verbose,
        more=options.rest[first:],
    )


def demo(cores: str) -> int:
    """Run every stage once on the bundled patient, in results/smoke of the current folder."""
    print(
        "Every stage once on the bundled patient, with few samples: three minutes on two cores, four the first time.\n"
        "Its intervals are wide; `coronaryuq run laptop` takes 20 to 40 minutes, uses more samples, and takes the"
        " errors of lumen, cuff and echocardiogram into account.",
        file=sys.stderr,
    )
    return run(shipped.configuration(DEMO), [], cores=cores)


def run(
    configuration: Path,
    targets: Sequence[str],
    *,
    cores: str = "all",
    profile: str | None = None,
    dry_run: bool = False,
    verbose: bool = False,
    more: Sequence[str] = (),
) -> int:
    """Run a campaign in the current folder; return Snakemake's exit code.

    It tells the Snakemake command, the progress, errors, and at the end the results; if `verbose`, all that Snakemake
    and its jobs print. Results that have changed since their jobs wrote them are deleted first, to be made again.
    """
    _check_targets(targets)
    # Snakemake's plugin for SLURM looks for programs by `which` while it is imported.
    check_programs("bash", *["which"] * (find_spec("snakemake_executor_plugin_slurm") is not None))
    complete_environment()
    campaign = config.load(configuration)
    results = Path("results", campaign.name)
    if not dry_run and (results / FOLDER).is_dir():
        for path in remove_changed(results).changed:
            print(f"{path}: changed since its job wrote it; removed", file=sys.stderr)
    command = Command(configuration, targets, cores, profile, more)
    if dry_run or verbose:
        code = subprocess.run(command.words(*["--dry-run"] * dry_run), check=False).returncode
        if dry_run and not code and campaign.case != "bundled":
            check = shlex.join(["coronaryuq", "check", str(configuration)])
            print(f"A plan only: the case's tables and vessels were not read. {check} reads them.", file=sys.stderr)
        return code
    print(f"Runs: {command}", file=sys.stderr)
    try:
        progress = Progress(results, plan(command), command.slots)
    except PlanFailed as error:
        return refused(error)
    if progress.before and progress.steps:
        print("\n".join(state(results, progress)[: 1 + len(kept(results))]), file=sys.stderr)
    code = follow(command, progress)
    if code:
        there, every = progress.counts
        print(
            "\n".join([f"{there} of {every} steps are there; start it again to go on", *kept(results)]), file=sys.stderr
        )
    elif not targets:
        print("\n".join(result_lines(results)))
    return code


def _check_targets(targets: Sequence[str]) -> None:
    """Raise `InputError` for a target that is neither a rule of the workflow nor the path of a file."""
    rules = shipped.snakefile().parent.rglob("*.smk")
    text = "\n".join(path.read_text(encoding="utf-8") for path in (shipped.snakefile(), *sorted(rules)))
    known = re.findall(r"^(?:rule|checkpoint) (\w+):", text, re.MULTILINE)
    for target in targets:
        if target not in known and not re.search(r"[/.]", target):
            raise InputError("command line", "TARGET", target, f"unknown; {nearest(target, known)}see README.md")
