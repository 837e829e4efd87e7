"""Every estimator of a small campaign, with a coarse 3D level beside the 3D runs."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from coronaryuq.estimation.analysis.estimate_rows import analyse
from coronaryuq.estimation.results import BeyondTheMean
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


@pytest.mark.long
def test_a_row_whose_0d_output_is_its_own_changes_no_other_row(with_coarse):
    """It is estimated with that output, coarse level and all."""
    alone = analysed(with_coarse)
    for name in ("outputs_0d.csv", "outputs_0d_propagation.csv", "outputs_0d_coarse.csv"):
        table = pd.read_csv(with_coarse / name)
        table.assign(pressure_drop_lad=1 / table["ffr_lad"] - 1).to_csv(with_coarse / name, index=False)
    for name in ("outputs_3d.csv", "outputs_3d_coarse.csv"):
        table = pd.read_csv(with_coarse / name)
        table.assign(pressure_drop_lad=table["osi"] ** 2).to_csv(with_coarse / name, index=False)
    rows = pd.read_csv(with_coarse / "rows.csv").astype({"row": str})
    drop = {"row": "drop", "column_3d": "pressure_drop_lad", "column_0d": "pressure_drop_lad", "shared": "no"}
    pd.concat([rows, pd.DataFrame([drop])]).to_csv(with_coarse / "rows.csv", index=False)
    runs, chosen = read_runs(with_coarse), read_rows(with_coarse / "rows.csv")
    first, second = analyse(runs, chosen, SETTINGS, 3, beyond_mean=False)
    assert first == alone and set(second.estimators) == set(first.estimators)
    every = analyse(runs, [replace(row, shared=True) for row in chosen], SETTINGS, 3, beyond_mean=False)
    assert every[0] != alone, "without the word the other row's control variates see it"


@pytest.mark.slow
def test_blue_needs_every_coarse_run_and_the_multilevel_estimate_does_not(with_coarse):
    lines = pd.read_csv(with_coarse / "outputs_3d_coarse.csv")
    lines.drop(index=[3, 100]).to_csv(with_coarse / "outputs_3d_coarse.csv", index=False)
    row = analysed(with_coarse)
    assert "multilevel" in row.estimators and "BLUE" not in row.estimators


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_quantity_that_is_the_same_in_all_runs_gets_one_sentence(folder, value):
    outputs = pd.read_csv(folder / "outputs_3d.csv").assign(osi=value)
    outputs.to_csv(folder / "outputs_3d.csv", index=False)
    (row,) = analyse(read_runs(folder), read_rows(folder / "rows.csv"), SETTINGS, 3)
    assert row.recommended == "MC" and row.beyond_the_mean == BeyondTheMean()
    found = np.array([(one.mean, one.std) for one in row.estimators.values()])
    np.testing.assert_allclose(found, [[value, 0.0]] * len(found), atol=1e-15)
    assert not any(one.warnings for one in row.estimators.values())
    (warning,) = row.warnings
    assert warning.startswith(f"does not vary: all 40 runs have the value {value:g},")


def test_what_the_file_says_of_a_quantity_is_its_first_warning(folder):
    pd.read_csv(folder / "rows.csv").assign(warning="extreme: it moves").to_csv(folder / "rows.csv", index=False)
    assert analysed(folder).warnings[0] == "extreme: it moves"
