"""Snakemake as a child of the console command: its plan, its run with a line of progress, its errors alone."""

import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from coronaryuq.campaign.progress import Progress, Step, planned
from coronaryuq.core import shipped
from coronaryuq.core.errors import InputError

ERROR = re.compile(r"\berror\b|^Traceback|Error in|Exception", re.IGNORECASE)
"""Lines of Snakemake and of jobs that a reader has to see."""
WARNED = re.compile(r"^(?:note|warning): |: warning: ")
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a campaign: Ctrl-C, `kill`, and a terminal that is closed."""
PAUSE = 0.5
"""Seconds between two looks at the results."""
STEP = 0.1
"""Progress between two lines where there is no terminal."""


class PlanFailed(Exception):
    """The plan could not be made; it holds Snakemake's exit code and its errors."""

    def __init__(self, code: int, lines: list[str]):
        super().__init__("\n".join(lines))
        self.code, self.lines = code, lines


class Ended(Exception):
    """The user or the system asked for the end by a signal, whose number it holds."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number


@dataclass(frozen=True)
class Command:
    """A command line of Snakemake. folder: working directory, None for the present one."""

    configuration: Path
    targets: Sequence[str] = ()
    cores: str = "all"
    profile: str | None = None
    more: Sequence[str] = ()
    folder: Path | None = None

    def words(self, *options: str) -> list[str]:
        """Return the words, with further options; those of the user come last, after an option with one value."""
        words = [sys.executable, "-m", "snakemake", "--snakefile", str(shipped.snakefile()), *options]
        words += ["--configfile", str(self.configuration), "--cores", self.cores]
        words += ["--workflow-profile", self.profile] if self.profile else []
        return [*words, *self.more, "--", *self.targets]

    def __str__(self) -> str:
        return shlex.join(["snakemake", *self.words()[3:]]).removesuffix(" --")

    @property
    def slots(self) -> int:
        """Steps that may run at a time."""
        return int(self.cores) if self.cores.isdigit() else os.cpu_count() or 1


def plan(command: Command) -> list[Step]:
    """Return the steps that a command would run.

    Raises
    ------
    PlanFailed
        If Snakemake refuses.
    """
    words = command.words("--dry-run", "--quiet", "reason")
    done = subprocess.run(
        words, capture_output=True, encoding="utf-8", errors="replace", cwd=command.folder, check=False
    )
    if done.returncode:
        raise PlanFailed(done.returncode, errors_of((done.stderr + done.stdout).splitlines()))
    return planned(done.stdout + done.stderr)


def errors_of(lines: Sequence[str]) -> list[str]:
    """Return the lines from the first error on; all, if none is known as one."""
    first = next((k for k, line in enumerate(lines) if ERROR.search(line)), 0)
    return list(lines[first:])


def follow(command: Command, progress: Progress) -> int:
    """Run a command with a line of progress; return its exit code.

    What Snakemake and its jobs print goes to `logs/run.log` of the campaign; errors and warnings are shown at once.
    Interrupted or told to end, it interrupts Snakemake, which ends its jobs, waits for it, and returns 128 and the
    signal's number.
    """
    log = progress.home / "logs" / "run.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    process = _start(command)
    for number in ENDING:
        # One that is ignored, as by nohup, stays so.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _raise_ended)
    screen = _Screen()
    reader = threading.Thread(target=_read, args=(process, log, screen), daemon=True)
    reader.start()
    try:
        while process.poll() is None:
            with suppress(subprocess.TimeoutExpired):
                process.wait(PAUSE)
            progress.look()
            screen.progress(progress)
    except Ended as ended:
        for number in ENDING:
            signal.signal(number, signal.SIG_IGN)
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        process.wait()
        return 128 + ended.number
    finally:
        progress.recount()  # Snakemake removes the files of jobs that it ended
        screen.clear()
        reader.join(timeout=10)
    if process.returncode:
        print(f"Snakemake ended with code {process.returncode}; everything that it printed: {log}", file=sys.stderr)
    return process.returncode


def _start(command: Command) -> subprocess.Popen:
    """Start Snakemake in a process group of its own, in which interrupts are not ignored, whatever they are here."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.Popen(
            command.words("--quiet", "all"), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, encoding="utf-8", errors="replace", cwd=command.folder, process_group=0,
        )  # fmt: skip
    finally:
        signal.signal(signal.SIGINT, before)


def _raise_ended(number: int, frame: object) -> NoReturn:
    raise Ended(number)


def _read(process: subprocess.Popen, log: Path, screen: "_Screen") -> None:
    assert process.stdout
    with open(log, "w", encoding="utf-8") as copy:
        shown: set[str] = set()
        for line in process.stdout:
            copy.write(line)
            copy.flush()
            text = line.rstrip()
            if (ERROR.search(text) or WARNED.search(text)) and text not in shown:
                shown.add(text)
                screen.tell(text)


class _Screen:
    """Standard error: a line of progress that is written over on a terminal, and lines that stay."""

    def __init__(self) -> None:
        self.live = sys.stderr.isatty()
        self._told, self._lock = 0.0, threading.Lock()

    def progress(self, progress: Progress) -> None:
        with self._lock:
            if self.live:
                print(f"\r\033[K{progress.line()}", end="", file=sys.stderr, flush=True)
            elif progress.fraction >= self._told + STEP:
                self._told = progress.fraction
                print(progress.line(), file=sys.stderr, flush=True)

    def tell(self, line: str) -> None:
        with self._lock:
            print(f"\r\033[K{line}" if self.live else line, file=sys.stderr, flush=True)

    def clear(self) -> None:
        with self._lock:
            if self.live:
                print("\r\033[K", end="", file=sys.stderr, flush=True)


def refused(error: PlanFailed) -> int:
    """Print why there is no plan, and return the exit code."""
    for line in error.lines:
        print(line, file=sys.stderr)
    return InputError.EXIT_CODE if any(line.startswith("error: ") for line in error.lines) else error.code
