"""The seam between the 3D stage and an external 3D code: prepare, command, collect; one job per sample."""

import os
import shlex
import signal
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from coronaryuq.core.records import Record


class RunFailed(RuntimeError):
    """A run that gave no result; the message is the one line that its record carries."""


@dataclass(frozen=True)
class Sample:
    """One row of the table of inputs: its name, and θ by column."""

    name: str
    theta: Mapping[str, float]


class Backend(Protocol):
    """An external 3D code. `solver`: name and version for the record."""

    solver: Mapping[str, str]

    def prepare(self, sample: Sample, folder: Path) -> Path:
        """Write a complete run directory for one sample and return it."""
        ...

    def command(self, run: Path, tasks: int) -> list[list[str]]:
        """Programs with their arguments, to be run in `run` one after the other; the solver itself under MPI."""
        ...

    def collect(self, run: Path, sample: Sample) -> Record:
        """Read what the code wrote. Raises RunFailed when it is missing, truncated or not finite."""
        ...


def run_sample(backend: Backend, sample: Sample, folder: Path, tasks: int, time_limit: float) -> Record:
    """Prepare, run and collect one sample. Whatever goes wrong with the run ends in the record, in one line."""
    begun, before = time.perf_counter(), os.times()
    try:
        run = backend.prepare(sample, folder)
        for line in backend.command(run, tasks):
            execute(line, run, time_limit - (time.perf_counter() - begun))
        record = backend.collect(run, sample)
    except RunFailed as error:
        record = Record.failed(sample.name, dict(sample.theta), str(error), solver=dict(backend.solver))
    after = os.times()
    record.cost |= {
        "cpu_s": (after.children_user - before.children_user) + (after.children_system - before.children_system),
        "wall_s": time.perf_counter() - begun,
    }
    return record


def execute(line: list[str], run: Path, limit: float) -> None:
    """Run one program in `run`, output to PROGRAM.log there. Raises RunFailed when it is missing, killed, late or
    fails.
    """
    program = Path(_program(line)).name
    log = run / f"{program}.log"
    with open(log, "wb") as output:
        try:
            process = subprocess.Popen(
                line, cwd=run, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
        except OSError as error:
            raise RunFailed(f"{line[0]} cannot be started ({error.strerror}); install it or set its path") from None
        try:
            code = process.wait(timeout=max(limit, 0.0))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            raise RunFailed(f"{program} ran out of time after {limit:.0f} s") from None
    if code < 0:
        raise RunFailed(f"{program} was killed ({signal.Signals(-code).name})")
    if code > 128 and code - 128 in {s.value for s in signal.Signals}:
        raise RunFailed(f"{program} was killed ({signal.Signals(code - 128).name})")
    if code:
        raise RunFailed(f"{program} failed with code {code}: {last_line(log)}")


def _program(line: list[str]) -> str:
    """The program behind an MPI launcher, or the first word."""
    return line[line.index("-n") + 2] if "-n" in line else line[0]


def launch(mpi: str, tasks: int, *program: str) -> list[str]:
    return [*shlex.split(mpi), "-n", str(tasks), *program]


def last_line(log: Path, limit: int = 200) -> str:
    """The last line of a log that says something about an error, else its last line."""
    lines = [line.strip() for line in log.read_text(errors="replace").splitlines()]
    lines = [line for line in lines if any(c.isalpha() for c in line)]
    telling = [line for line in lines if any(word in line.lower() for word in ("error", "not found", "cannot", "nan"))]
    return (telling or lines or ["it said nothing"])[-1][:limit]
