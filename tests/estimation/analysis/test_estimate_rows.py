"""Every estimator of a small campaign, with a coarse 3D level beside the 3D runs."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.estimation.analysis.estimate_rows import analyse
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings

SETTINGS = Settings(autoencoder=False)


def analysed(folder):
    (row,) = analyse(read_runs(folder), read_rows(folder / "rows.csv"), SETTINGS, 3, beyond_mean=False)
    return row


@pytest.mark.slow
def test_a_coarse_mesh_gives_two_more_estimators(with_coarse):
    row = analysed(with_coarse)
    blue, mfmc = row.estimators["BLUE"], row.estimators["MFMC"]
    assert blue.std < mfmc.std and blue.rho_held_out > 0.99
    assert blue.variance["runs_3d"] < 0.5 * mfmc.variance["runs_3d"]
    assert blue.calibrated.holds((np.cos(0.5) - np.cos(2)) / 1.5)
    assert blue.warnings == [] and row.recommended in ("BLUE", "crossfit-GP", "multilevel")
    assert row.estimators["multilevel"].std < mfmc.std
    assert row.levels.fine < row.levels.cheap, "the coarse run explains most of the fine one"


@pytest.mark.slow
def test_blue_needs_every_coarse_run_and_the_multilevel_estimate_does_not(with_coarse):
    lines = pd.read_csv(with_coarse / "outputs_3d_coarse.csv")
    lines.drop(index=[3, 100]).to_csv(with_coarse / "outputs_3d_coarse.csv", index=False)
    row = analysed(with_coarse)
    assert "multilevel" in row.estimators and "BLUE" not in row.estimators
