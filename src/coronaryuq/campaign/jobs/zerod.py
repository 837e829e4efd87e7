"""Run the 0D model in portions: of an input set, or of the inputs required by the trained networks."""

import tempfile
from pathlib import Path

from coronaryuq.core.io.tables import read_csv
from coronaryuq.posterior.samples import Lengths
from coronaryuq.posterior.settings import Settings as PosteriorSettings
from coronaryuq.posterior.stage import draw_samples
from coronaryuq.zerod import pressure_map
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.stage import run_chunk


def chunk(
    network_json: str, case_json: str, draws_csv: str, settings: Settings, posterior: PosteriorSettings, seed: int,
    name: str, portion: tuple[int, int], lengths: Lengths, runs_parquet: str,
) -> None:  # fmt: skip
    """Draw the samples of one portion (first, count) of an input set and run them."""
    first, count = portion
    with tempfile.TemporaryDirectory() as folder:
        samples = Path(folder, "samples.csv")
        draw_samples(draws_csv, posterior, seed, name, first + count, samples, lengths)
        run_chunk(network_json, case_json, samples, first, count, settings, runs_parquet)


def pressures(
    network_json: str, case_json: str, tree_vtp: str, draws_csv: str, posterior: PosteriorSettings, seed: int,
    lengths: Lengths, out_csv: str, predicted_csv: str,
) -> None:  # fmt: skip
    """Write quantiles of pressure, flow and FFR in the tree over the first samples of the propagation set."""
    with tempfile.TemporaryDirectory() as folder:
        samples = Path(folder, "samples.csv")
        draw_samples(draws_csv, posterior, seed, "propagation", pressure_map.STATES, samples, lengths)
        pressure_map.write_map(network_json, case_json, tree_vtp, samples, out_csv, predicted_csv)


def resampled(
    network_json: str, case_json: str, samples_csv: str, settings: Settings, share: int, shares: int, runs_parquet: str,
) -> None:  # fmt: skip
    """Run one of several equal parts of a table of inputs whose length is known only after training."""
    total = len(read_csv(samples_csv))
    first, last = total * share // shares, total * (share + 1) // shares
    run_chunk(network_json, case_json, samples_csv, first, last - first, settings, runs_parquet)
