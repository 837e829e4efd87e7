"""Gather the runs of a campaign in the format of the published runs."""

from collections.abc import Sequence
from pathlib import Path

from coronaryuq.case.case_json import read_case
from coronaryuq.estimation.results import Counts, read_round
from coronaryuq.estimation.runs.gather import RunFiles, gather
from coronaryuq.estimation.settings import Settings
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.zerod.network.beds import SCALING


def limits_of(posterior: PosteriorSettings, case: str | Path) -> dict[str, tuple[float, float]]:
    """Return the bounds of θ, `r` those of every bed; none of a case with errors, whose prior has none."""
    if read_case(case).errors is not None:
        return {}
    return {"r": posterior.prior, SCALING: posterior.scaling}


def gather_runs(
    settings: Settings, posterior: PosteriorSettings, counts: dict[str, int], runs_per_fine: int, out_dir: Path,
    allocation: str | None = None, **paths: str | Sequence[str],
) -> None:  # fmt: skip
    """Gather the first `counts` runs, or as many as the last round of a growing campaign decided.

    paths: named as in `RunFiles`.
    """
    chosen = read_round(allocation).counts if allocation else Counts.first(counts)
    files = RunFiles.of(paths, runs_per_fine)
    gather(files, limits_of(posterior, files.case), settings.min_3d, out_dir, chosen)
