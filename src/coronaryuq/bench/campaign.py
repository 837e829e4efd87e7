"""Benchmark `campaign`: planning time, overhead and number of files of a Snakemake campaign."""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from coronaryuq import config
from coronaryuq.core import shipped

QUICK_TARGET = "perfusion/targets.json"
"""Last result of a quick run: the patient, the case, the noise statistics."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--config", metavar="FILE", help="configuration of the campaign (default: config/smoke.yaml)")


def run(quick: bool, config: str | None = None) -> dict:
    """Plan a whole campaign (default `smoke`) and run it (quick: up to the perfusion targets) in a temporary folder.

    `snakemake_overhead_fraction` is the fraction of the wall time without a running job, by the start and end times
    that Snakemake records.
    """
    configuration = shipped.configuration(config or "smoke")
    name = _name(configuration)
    with tempfile.TemporaryDirectory(prefix="campaign-") as folder:
        target = ["--", f"results/{name}/{QUICK_TARGET}"] if quick else []
        planned = snakemake(configuration, folder, "--dry-run")
        done = snakemake(configuration, folder, *target)
        intervals = _intervals(Path(folder))
        files = sum(len(names) for _, _, names in os.walk(Path(folder, "results")))
    return {
        "config": configuration.name,
        "jobs": _jobs(planned.output),
        "jobs_run": _jobs_run(done.output),
        "dry_run_s": round(planned.wall_s, 2),
        "wall_s": round(done.wall_s, 2),
        "cpu_s": round(done.cpu_s, 2),
        "snakemake_overhead_fraction": round(1 - _covered(intervals) / done.wall_s, 4),
        "files": files,
    }


def _name(configuration: Path) -> str:
    return config.load(configuration).name


@dataclass(frozen=True)
class Finished:
    """A run of Snakemake: what it printed, and its times."""

    output: str
    wall_s: float
    cpu_s: float


def snakemake(configuration: Path, folder: str, *arguments: str) -> Finished:
    """Run Snakemake on a configuration in a folder; `RuntimeError` with its last lines if it fails."""
    command = [
        sys.executable, "-m", "snakemake", "--snakefile", str(shipped.snakefile()), "--directory", folder,
        "--configfile", str(configuration.resolve()), *arguments,
    ]  # fmt: skip
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    lines = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8") as process:
        for line in process.stdout or ():
            lines.append(line)
            if "--dry-run" not in arguments:
                sys.stderr.write(line)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode:
        raise RuntimeError(f"snakemake ended with code {process.returncode}: {''.join(lines[-20:])}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Finished("".join(lines), time.perf_counter() - started, cpu)


def _jobs(output: str) -> int:
    return int(re.findall(r"^total\s+(\d+)", output, re.MULTILINE)[0])


def _jobs_run(output: str) -> int:
    return int(re.findall(r"^(\d+) of \d+ steps", output, re.MULTILINE)[-1])


def _intervals(folder: Path) -> list[tuple[float, float]]:
    """Return start and end of each job from Snakemake's records (one per output file, with different ends)."""
    intervals = set()
    for path in (folder / ".snakemake" / "metadata").rglob("*"):
        if path.is_file():
            record = json.loads(unquote(path.read_text(encoding="utf-8")))
            if record.get("starttime") and record.get("endtime"):
                intervals.add((record["starttime"], record["endtime"]))
    return sorted(intervals)


def _covered(intervals: list[tuple[float, float]]) -> float:
    """Return the length of the union of intervals, s."""
    total, reached = 0.0, float("-inf")
    for start, end in intervals:
        total += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return total
