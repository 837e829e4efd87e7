"""Paths of a campaign's results, logs and costs in Snakemake's form: relative, with forward slashes."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Paths:
    """Paths of the campaign `name`."""

    name: str

    def results(self, *parts: str) -> str:
        """Return the path of a result."""
        return Path("results", self.name, *parts).as_posix()

    def log(self, *parts: str) -> str:
        """Return the path of a job's log."""
        return self.results("logs", *parts)

    def cost(self, *parts: str) -> str:
        """Return the path of the file with a job's cost."""
        return self.results("costs", *parts)

    def discrepancy(self, case: str, *parts: str) -> str:
        """Return the path of a result of the search on one case."""
        return self.results("discrepancy", case, *parts)


def files_under(path: str | Path | None) -> list[str]:
    """Return a file, or all files of a folder, as inputs of a rule; the rule reports a missing path."""
    if path is None:
        return []
    path = Path(path)
    inside = sorted(p for p in path.rglob("*") if p.is_file() and not p.name.startswith("."))
    files = inside if path.is_dir() else [path] * path.exists()
    return [file.as_posix() for file in files]
