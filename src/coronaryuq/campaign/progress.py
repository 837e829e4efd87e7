"""Progress of a campaign by work: the steps that are there, those that remain, and the time that they take."""

import re
import time
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from coronaryuq.campaign.explain import FOLDER
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json

SECONDS = {
    "calibration": 8.0, "case": 1.0, "estimation": 25.0, "estimation_train": 10.0, "flow3d_batch": 110.0, "mesh": 20.0,
    "losses_runs": 60.0, "mesh_study": 60.0, "posterior_chains": 90.0, "perfusion_chunk": 4.0, "zerod_chunk": 3.0,
    "zerod_resampled": 4.0, "pressure_map": 8.0, "figure": 5.0, "discrepancy_search": 120.0,
}  # fmt: skip
"""Seconds of one step of a rule, until one of it has finished in this campaign; from the laptop campaign."""
OTHERWISE = 3.0
_HEAD = re.compile(r"^(?:local)?(?:rule|checkpoint) (\w+):$")
_DETAIL = re.compile(r"^    (output|wildcards): (.*)$")


@dataclass(frozen=True)
class Step:
    """One job that has to run: its rule, its name with wildcards, as its note has it, and the files that it writes."""

    rule: str
    name: str
    outputs: tuple[str, ...]


def planned(dry_run: str) -> list[Step]:
    """Return the steps in the output of `snakemake --dry-run`; those that only name targets write nothing."""
    steps, rule, details = [], "", dict[str, str]()

    def close() -> None:
        if rule and "output" in details:
            wildcards = [part.partition("=")[2] for part in details.get("wildcards", "").split(", ") if part]
            steps.append(Step(rule, " ".join([rule, *wildcards]), tuple(details["output"].split(", "))))

    for line in dry_run.splitlines():
        if head := _HEAD.match(line):
            close()
            rule, details = head[1], {}
        elif detail := _DETAIL.match(line):
            details[detail[1]] = detail[2]
    close()
    return steps


@dataclass
class Progress:
    """Work of a campaign that is running.

    Attributes
    ----------
    home
        Results folder.
    steps
        What has to run.
    cores
        Steps that may run at a time.
    started
        Time since the epoch, s.
    folder
        To which the paths of the steps' files are relative.
    """

    home: Path
    steps: list[Step]
    cores: int = 1
    started: float = field(default_factory=time.time)
    folder: Path = Path()

    def __post_init__(self) -> None:
        self.before = _finished_before(self.home, self.steps)
        self.done: set[str] = set()
        self._seconds: dict[str, list[float]] = {}

    def look(self) -> None:
        """Find the steps that have finished since the start."""
        for step in self.steps:
            if step.name not in self.done and all(_written(self.folder / path, self.started) for path in step.outputs):
                self.done.add(step.name)
                seconds = _measured(self.home, step.name)
                self._seconds.setdefault(step.rule, []).extend([seconds] if seconds is not None else [])

    def recount(self) -> None:
        """Forget steps whose files are no longer there."""
        self.done.clear()
        self.look()

    @property
    def counts(self) -> tuple[int, int]:
        """Steps that are there, and all steps."""
        return self.before + len(self.done), self.before + len(self.steps)

    @property
    def fraction(self) -> float:
        """Finished part of the work of this run, 0 to 1."""
        done = sum(self._of(step) for step in self.steps if step.name in self.done)
        whole = sum(map(self._of, self.steps))
        return done / whole if whole else 1.0

    @property
    def left(self) -> float:
        """Seconds until the end, by the work that was done per second so far."""
        done = sum(self._of(step) for step in self.steps if step.name in self.done)
        remaining = sum(self._of(step) for step in self.steps if step.name not in self.done)
        elapsed = time.time() - self.started
        rate = done / elapsed if done > 0 and elapsed > 0 else float(self.cores)
        return remaining / min(rate, float(self.cores))

    def line(self) -> str:
        """Return the progress in words."""
        there, every = self.counts
        return f"{there} of {every} steps, {100 * self.fraction:.0f} % of the work, about {duration(self.left)} left"

    def _of(self, step: Step) -> float:
        """Return the seconds of a step: the mean of its rule here, or else a usual value."""
        here = self._seconds.get(step.rule)
        return sum(here) / len(here) if here else SECONDS.get(step.rule, OTHERWISE)


def duration(seconds: float) -> str:
    """Return a duration in words, with the digits that an estimate deserves."""
    if seconds < 90:
        return f"{max(5, 5 * round(seconds / 5))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {5 * round((minutes % 60) / 5)} min"


def kept(home: Path) -> list[str]:
    """Return where unfinished 3D runs and chains go on when the campaign is started again."""
    lines = []
    for path in sorted(home.rglob("checkpoints/*.npz")):
        cycle = _cycle(path)
        if cycle is not None:
            what = path.relative_to(home).parts[0].replace("flow3d", "3D")
            lines.append(f"{what} {path.stem.partition('_')[0]} {_number(path.stem)} goes on after cycle {cycle}")
    unfinished = [path.parent for path in home.glob("posterior/length_*/chains") if any(path.iterdir())]
    lines += [f"posterior chains ({path.name}) go on" for path in unfinished if not (path / "chains.npz").is_file()]
    return lines


def _number(stem: str) -> str:
    return next(iter(re.findall(r"\d+", stem)), "")


def _cycle(path: Path) -> int | None:
    import numpy as np

    try:
        with np.load(path) as saved:
            return int(saved["cycle"]) if "cycle" in saved.files else None
    except (OSError, ValueError, zipfile.BadZipFile):
        return None


def _finished_before(home: Path, steps: Iterable[Step]) -> int:
    """Return the number of jobs that left a note and need not run again."""
    again = {_note(step.name) for step in steps}
    return sum(path.name not in again for path in (home / FOLDER).glob("*.json"))


def _note(name: str) -> str:
    return f"{re.sub('[ /]', '-', name)}.json"


def _written(path: Path, since: float) -> bool:
    try:
        return path.lstat().st_mtime >= since - 1.0
    except OSError:
        return False


def _measured(home: Path, name: str) -> float | None:
    """Return the seconds that a step took, from its note."""
    try:
        note = read_json(home / FOLDER / _note(name), ("resources",))
    except InputError:
        return None
    return note["resources"].get("wall_s")
