"""Total cost of the jobs of a campaign, by rule."""

from collections.abc import Sequence
from pathlib import Path

from coronaryuq.core.io.atomic import read_json

SUMMED = ("wall_s", "cpu_s")


def costs(files: Sequence[str | Path]) -> list[dict]:
    """Return one row per rule and one for all: name, jobs, wall and CPU time (s), largest memory (MB), as text.

    Parameters
    ----------
    files
        One JSON file per job: `job`, whose first word is the rule, `wall_s`, `cpu_s`, `memory_mb`.
    """
    jobs = [read_json(path, ("job", *SUMMED, "memory_mb")) for path in files]
    by_rule: dict[str, list[dict]] = {}
    for job in jobs:
        by_rule.setdefault(job["job"].split()[0], []).append(job)
    return [_line(name, part) for name, part in by_rule.items()] + [_line("all", jobs)]


def _line(name: str, jobs: list[dict]) -> dict:
    wall, cpu = (sum(job[key] for job in jobs) for key in SUMMED)
    memory = max((job["memory_mb"] for job in jobs), default=0.0)
    return {"name": name, "jobs": len(jobs), "wall": f"{wall:.0f}", "cpu": f"{cpu:.0f}", "memory": f"{memory:.0f}"}
