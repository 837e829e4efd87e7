"""The stage from files to files, with an analytic 0D model between its two phases."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation import stage, training
from coronaryuq.estimation.results import read_estimates
from coronaryuq.estimation.settings import Settings

SETTINGS = Settings(steps=(60, 40), curve_nodes=17)


def zero_d(samples: pd.DataFrame) -> pd.DataFrame:
    """The 0D model of the fixture `folder`."""
    return pd.DataFrame({
        "sample": samples["sample"], "mean_flow:lca1:BC_lca1": 1 / samples["BC_lca1"],
        "ffr_lad": 1 - 0.2 / samples["R_cor_scaling"],
    })  # fmt: skip


def campaign(folder, seed=3, settings=SETTINGS):
    training.write_networks(folder, settings, seed, folder / "networks.npz", folder / "resampled.csv")
    zero_d(pd.read_csv(folder / "resampled.csv")).to_parquet(folder / "k0.parquet")
    stage.estimate(
        folder, folder / "networks.npz", [folder / "k0.parquet"], settings, seed,
        folder / "estimates.json", folder / "table.csv",
    )  # fmt: skip
    return read_estimates(folder / "estimates.json")


@pytest.mark.slow
def test_two_phases_give_every_estimator_and_the_intervals_hold_the_truth(folder):
    (row,) = campaign(folder).rows
    assert list(row.estimators) == ["MC", "MFMC", "MFMC-AE", "crossfit-GP"]
    truth = (np.cos(0.5) - np.cos(2)) / 1.5
    assert all(estimate.chebyshev_99.holds(truth) for estimate in row.estimators.values())
    # 200 propagation samples for 40 runs leave √0.2 = 0.45 of it.
    assert row.estimators["crossfit-GP"].std < 0.55 * row.estimators["MC"].std
    table = pd.read_csv(folder / "table.csv")
    assert list(table["estimator"]) == ["MC", "MFMC", "MFMC-AE", "crossfit-GP"]
    assert len(pd.read_csv(folder / "resampled.csv")) == 17 * (10 + 1)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(folder):
    first = [campaign(folder), (folder / "networks.npz").read_bytes(), (folder / "table.csv").read_bytes()]
    again = [campaign(folder), (folder / "networks.npz").read_bytes(), (folder / "table.csv").read_bytes()]
    assert first == again
    assert campaign(folder, seed=4).rows != first[0].rows


@pytest.mark.slow
def test_any_number_of_threads_gives_the_same_networks(folder):
    import torch

    before = torch.get_num_threads()
    try:
        written = []
        for threads in (1, 2):
            torch.set_num_threads(threads)
            training.write_networks(folder, SETTINGS, 3, folder / "networks.npz", folder / "resampled.csv")
            written.append((folder / "networks.npz").read_bytes())
    finally:
        torch.set_num_threads(before)
    assert written[0] == written[1]


@pytest.mark.slow
def test_without_the_autoencoder_there_is_nothing_to_resample(folder):
    (row,) = campaign(folder, settings=Settings(autoencoder=False)).rows
    assert list(row.estimators) == ["MC", "MFMC", "crossfit-GP"]
    assert len(pd.read_csv(folder / "resampled.csv")) == 0


def test_too_few_3d_runs_are_refused(folder):
    with pytest.raises(InputError, match="min_3d is 41"):
        training.write_networks(folder, Settings(min_3d=41), 3, folder / "networks.npz", folder / "resampled.csv")
    assert not (folder / "networks.npz").exists()


def test_a_row_that_is_not_there_is_reported(folder):
    with pytest.raises(InputError, match="no such row; the file has 1"):
        training.write_networks(folder, Settings(rows=["7"]), 3, folder / "networks.npz", folder / "resampled.csv")


@pytest.mark.slow
def test_a_row_without_networks_has_every_other_estimator(folder):
    rows = pd.concat([pd.read_csv(folder / "rows.csv").assign(row=name, networks=name) for name in ("yes", "no")])
    rows.to_csv(folder / "rows.csv", index=False)
    trained, other = campaign(folder).rows
    assert list(trained.estimators) == ["MC", "MFMC", "MFMC-AE", "crossfit-GP"]
    assert list(other.estimators) == ["MC", "MFMC", "crossfit-GP"]
    assert set(pd.read_csv(folder / "resampled.csv")["sample"].str.partition(".")[0]) == {"yes"}


def test_no_row_with_networks_trains_none(folder):
    pd.read_csv(folder / "rows.csv").assign(networks="no").to_csv(folder / "rows.csv", index=False)
    assert list(campaign(folder).rows[0].estimators) == ["MC", "MFMC", "crossfit-GP"]


def test_an_error_is_assumed_where_that_of_the_mesh_was_not_measured(folder):
    outputs = pd.read_csv(folder / "outputs_3d.csv")
    outputs["ffr_lad"] = 0.9 - 0.1 * outputs.pop("osi")
    outputs.to_csv(folder / "outputs_3d.csv", index=False)
    rows = pd.read_csv(folder / "rows.csv").assign(column_3d="ffr_lad")
    rows.to_csv(folder / "rows.csv", index=False)
    (bare,) = campaign(folder).rows
    write_json(folder / "mesh.json", {"settings": {"throat_resolution": 2.0}})

    def estimated(**numerical):
        stage.estimate(
            folder, folder / "networks.npz", [folder / "k0.parquet"], SETTINGS, 3,
            folder / "estimates.json", folder / "table.csv", **numerical,
        )  # fmt: skip
        return read_estimates(folder / "estimates.json").rows[0]

    assumed = estimated(assumed_on=folder / "mesh.json")
    name = bare.recommended
    wider, narrow = assumed.estimators[name], bare.estimators[name]
    assert wider.mean == narrow.mean and assumed.numerical_correction is None
    assert wider.variance["assumed"] == pytest.approx(((1 - wider.mean) / 12) ** 2)
    ends = [row.beyond_the_mean.predictive for row in (bare, assumed)]
    assert ends[1]["0.95"] - ends[1]["0.05"] > ends[0]["0.95"] - ends[0]["0.05"]
    found = {"source": "mesh", "correction": 0.0, "std": 0.001, "at": 0.8, "order": None, "method": "range"}
    errors = [found | {"n_samples": 4, "spread": 0.0}]
    write_json(folder / "study.json", {"quantities": {bare.column_3d: {"errors": errors}}})
    measured = estimated(assumed_on=folder / "mesh.json", mesh_study=folder / "study.json")
    assert "assumed" not in measured.estimators[name].variance and "mesh" in measured.estimators[name].variance
