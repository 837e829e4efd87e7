"""Decide after a round of a growing campaign whether to stop, and which runs and chains the next round has."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

from coronaryuq.campaign.jobs.runs import limits_of
from coronaryuq.estimation.analysis.allocation import allocate
from coronaryuq.estimation.results import Counts, read_round
from coronaryuq.estimation.runs.gather import RunFiles
from coronaryuq.estimation.settings import Settings
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.posterior.stage import draw_samples


def allocate_round(
    settings: Settings, posterior: PosteriorSettings, seed: int, number: int, counts: dict[str, int],
    runs_per_fine: int, portion: dict[str, int], draws_csv: str, round_json: str, before: str | None = None,
    **files: str | Sequence[str],
) -> None:  # fmt: skip
    """Decide after round `number`, which ran `counts` or the numbers requested by the decision `before` it.

    draws_csv: of the chains of this round. files: named as in `RunFiles`, without the propagation samples.
    """
    ran = read_round(before).next if before else Counts.first(counts)
    with tempfile.TemporaryDirectory() as folder:
        propagation = Path(folder, "propagation.csv")
        draw_samples(draws_csv, posterior, seed, "propagation", ran.n_0d, propagation, ran.lengths)
        inputs = RunFiles.of(files | {"propagation": propagation}, runs_per_fine)
        allocate(
            inputs, limits_of(posterior, inputs.case), settings, seed, number, ran, Counts.first(portion), round_json
        )
