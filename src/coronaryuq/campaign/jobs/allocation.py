"""Decide after a round of a growing campaign whether to stop, and how many runs the next round has."""

from collections.abc import Sequence

from coronaryuq.campaign.jobs.runs import limits_of
from coronaryuq.estimation.analysis.allocation import allocate
from coronaryuq.estimation.results import Counts, read_round
from coronaryuq.estimation.runs.gather import RunFiles
from coronaryuq.estimation.settings import Settings
from coronaryuq.posterior.settings import Settings as PosteriorSettings


def allocate_round(
    settings: Settings, posterior: PosteriorSettings, seed: int, number: int, counts: dict[str, int],
    runs_per_fine: int, portion: dict[str, int], round_json: str, before: str | None = None,
    **files: str | Sequence[str],
) -> None:  # fmt: skip
    """Decide after round `number`, which ran `counts` or the numbers requested by the decision `before` it.

    files: named as in `RunFiles`.
    """
    ran = read_round(before).next if before else Counts(**counts)
    inputs = RunFiles.of(files, runs_per_fine)
    allocate(inputs, limits_of(posterior), settings, seed, number, ran, Counts(**portion), round_json)
