"""Predict FFR by 0D from the draws of a posterior, before or after adoption."""

import tempfile
from pathlib import Path

from coronaryuq.adoption.stage import predict
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.posterior.stage import draw_samples
from coronaryuq.zerod.settings import Settings


def prediction(
    network_json: str, case_json: str, draws_csv: str, settings: Settings, posterior: PosteriorSettings, seed: int,
    number: int, out_csv: str,
) -> None:  # fmt: skip
    """Draw samples and run them; before and after they visit the same places of the chains, with the same scaling."""
    with tempfile.TemporaryDirectory() as folder:
        samples = Path(folder, "samples.csv")
        draw_samples(draws_csv, posterior, seed, "adoption", number, samples)
        predict(network_json, case_json, samples, settings, out_csv)
