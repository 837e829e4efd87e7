"""`coronaryuq status`: how far a campaign is, where it resumes, the time left, and its results."""

import argparse
import sys
from pathlib import Path

from filelock import FileLock, Timeout

from coronaryuq.campaign.answers import ESTIMATES, answers
from coronaryuq.campaign.explain import CAMPAIGN
from coronaryuq.campaign.progress import Progress, duration, kept
from coronaryuq.cli.snakemake_run import Command, PlanFailed, plan, refused
from coronaryuq.core.errors import InputError

REPORT = "report.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `coronaryuq status`."""
    parser.description = "Show how far a campaign is, where it resumes, the time left, and its results."
    parser.add_argument("results", metavar="FOLDER", help="results folder of a campaign, results/NAME")


def main(options: argparse.Namespace) -> int:
    """Print the state of a campaign; it may be running."""
    home = Path(options.results)
    if not (home / CAMPAIGN).is_file():
        raise InputError(home, None, None, f"no {CAMPAIGN} in it; name the results folder of a campaign")
    if holder := running(home):
        print(f"running: {holder}")
    folder = home.absolute().parents[1]
    command = Command(home.absolute() / CAMPAIGN, folder=folder)
    try:
        steps = plan(command)
    except PlanFailed as error:
        return refused(error)
    progress = Progress(folder / "results" / home.absolute().name, steps, command.slots, folder=folder)
    for line in state(home, progress):
        print(line)
    return 0


def state(home: Path, progress: Progress) -> list[str]:
    """Return the lines on a campaign that is not finished, and its results where they are there."""
    there, every = progress.counts
    lines = [f"{there} of {every} steps are there"]
    if progress.steps:
        cores = "one core" if progress.cores == 1 else f"{progress.cores} cores"
        lines[0] += f"; the rest takes about {duration(progress.left)} on {cores}"
    return [*lines, *kept(home), *result_lines(home)]


def result_lines(home: Path) -> list[str]:
    """Return the results of a campaign and the path of its report, as far as they are there."""
    lines = [str(answer) for answer in answers(home)] if (home / ESTIMATES).is_file() else []
    return lines + ([f"Report: {home / REPORT}"] if (home / REPORT).is_file() else [])


def running(home: Path) -> str:
    """Return which process runs a campaign in a folder; empty if none does."""
    path = home / ".lock"
    if not path.is_file():
        return ""
    try:
        with FileLock(path, timeout=0, fallback_to_soft=False, preserve_lock_file=True):
            return ""
    except Timeout:
        return path.read_text(encoding="utf-8").strip() or "a process"
    except (OSError, NotImplementedError) as error:
        print(f"{home}: this file system has no locks ({error})", file=sys.stderr)
        return ""
