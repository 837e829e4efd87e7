"""Gather the runs of a campaign in the format of the published runs."""

from collections.abc import Sequence
from pathlib import Path

from coronaryuq.estimation.results import Counts, read_round
from coronaryuq.estimation.runs.gather import RunFiles, gather
from coronaryuq.estimation.settings import Settings
from coronaryuq.posterior.settings import Settings as PosteriorSettings


def limits_of(posterior: PosteriorSettings) -> dict[str, tuple[float, float]]:
    """Return the bounds of θ; `r` applies to every bed."""
    return {"r": posterior.prior, "R_cor_scaling": posterior.scaling}


def gather_runs(
    settings: Settings, posterior: PosteriorSettings, counts: dict[str, int], runs_per_fine: int, out_dir: Path,
    allocation: str | None = None, **files: str | Sequence[str],
) -> None:  # fmt: skip
    """Gather the first `counts` runs, or as many as the last round of a growing campaign decided.

    files: named as in `RunFiles`.
    """
    chosen = read_round(allocation).counts if allocation else Counts.first(counts)
    gather(RunFiles.of(files, runs_per_fine), limits_of(posterior), settings.min_3d, out_dir, chosen)
