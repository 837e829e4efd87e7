"""The stage from files to files, with an analytic 0D model between its two phases."""

import json

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.estimation import stage
from coronaryuq.estimation.settings import Settings

SETTINGS = Settings(steps=(60, 40), curve_nodes=17)


def zero_d(samples: pd.DataFrame) -> pd.DataFrame:
    """The 0D model of the fixture `folder`."""
    return pd.DataFrame({
        "sample": samples["sample"], "mean_flow:lca1:BC_lca1": 1 / samples["BC_lca1"],
        "ffr_lad": 1 - 0.2 / samples["R_cor_scaling"],
    })  # fmt: skip


def campaign(folder, seed=3, settings=SETTINGS):
    stage.train(folder, settings, seed, folder / "networks.npz", folder / "resampled.csv")
    zero_d(pd.read_csv(folder / "resampled.csv")).to_parquet(folder / "k0.parquet")
    stage.estimate(
        folder, folder / "networks.npz", [folder / "k0.parquet"], settings, seed,
        folder / "estimates.json", folder / "table.csv",
    )  # fmt: skip
    return json.loads((folder / "estimates.json").read_text())


def test_two_phases_give_every_estimator_and_the_intervals_hold_the_truth(folder):
    held = campaign(folder)
    (row,) = held["rows"]
    assert list(row["estimators"]) == ["MC", "MFMC", "MFMC-AE", "best"]
    truth = (np.cos(0.5) - np.cos(2)) / 1.5
    for value in row["estimators"].values():
        assert value["chebyshev_99"]["low"] < truth < value["chebyshev_99"]["high"]
    # 200 propagation samples for 40 runs leave √0.2 = 0.45 of it.
    assert row["estimators"]["best"]["std"] < 0.55 * row["estimators"]["MC"]["std"]
    table = pd.read_csv(folder / "table.csv")
    assert list(table["estimator"]) == ["MC", "MFMC", "MFMC-AE", "best"]
    assert len(pd.read_csv(folder / "resampled.csv")) == 17 * (10 + 1)


def test_same_seed_same_bytes_another_seed_other_bytes(folder):
    first = [campaign(folder), (folder / "networks.npz").read_bytes(), (folder / "table.csv").read_bytes()]
    again = [campaign(folder), (folder / "networks.npz").read_bytes(), (folder / "table.csv").read_bytes()]
    assert first == again
    assert campaign(folder, seed=4)["rows"] != first[0]["rows"]


def test_any_number_of_threads_gives_the_same_networks(folder):
    import torch

    before = torch.get_num_threads()
    try:
        written = []
        for threads in (1, 2):
            torch.set_num_threads(threads)
            stage.train(folder, SETTINGS, 3, folder / "networks.npz", folder / "resampled.csv")
            written.append((folder / "networks.npz").read_bytes())
    finally:
        torch.set_num_threads(before)
    assert written[0] == written[1]


def test_without_the_autoencoder_there_is_nothing_to_resample(folder):
    held = campaign(folder, settings=Settings(autoencoder=False))
    assert list(held["rows"][0]["estimators"]) == ["MC", "MFMC", "best"]
    assert len(pd.read_csv(folder / "resampled.csv")) == 0


def test_too_few_3d_runs_stop_with_one_line(folder):
    with pytest.raises(InputError, match="min_3d is 41"):
        stage.train(folder, Settings(min_3d=41), 3, folder / "networks.npz", folder / "resampled.csv")
    assert not (folder / "networks.npz").exists()


def test_a_row_that_is_not_there_is_named(folder):
    with pytest.raises(InputError, match="no such row; the file has 1"):
        stage.train(folder, Settings(rows=["7"]), 3, folder / "networks.npz", folder / "resampled.csv")
