"""Run an external program: log, time limit, and one line on why it failed."""

import os
import shlex
import signal
import subprocess
from pathlib import Path


class RunFailed(RuntimeError):
    """A run without a result; the message is the one line that its record carries."""


def execute(line: list[str], run: Path, limit: float) -> None:
    """Run one program in the folder `run` with its output in PROGRAM.log; raise `RunFailed` unless it exits with 0.

    limit: wall time, s.
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
    """Return the program behind an MPI launcher, or the first word."""
    return line[line.index("-n") + 2] if "-n" in line else line[0]


def launch(mpi: str, tasks: int, *program: str) -> list[str]:
    """Return the command that starts a program under MPI."""
    return [*shlex.split(mpi), "-n", str(tasks), *program]


def last_line(log: Path, limit: int = 200) -> str:
    """Return the last line of a log that mentions an error, else its last line."""
    lines = [line.strip() for line in log.read_text(encoding="utf-8", errors="replace").splitlines()]
    lines = [line for line in lines if any(c.isalpha() for c in line)]
    telling = [line for line in lines if any(word in line.lower() for word in ("error", "not found", "cannot", "nan"))]
    return (telling or lines or ["(no output in its log)"])[-1][:limit]
