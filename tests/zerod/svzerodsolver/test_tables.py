"""svZeroDSolver's own cases are reproduced within its own tolerance, relative and absolute 1e-7."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.svzerodsolver.tables import simulate

CASES = [
    "closedLoopHeart_singleVessel",
    "closedLoopHeart_withCoronaries",
    "pulsatileFlow_CStenosis_steadyPressure",
    "pulsatileFlow_R_RCR",
    "pulsatileFlow_R_RCR_mean",
    "pulsatileFlow_R_coronary",
    "pulsatileFlow_R_coronary_cycle_error",
    "pulsatileFlow_R_coronary_varres",
    "steadyFlow_RC_R",
    "steadyFlow_RLC_R",
    "steadyFlow_RL_R",
    "steadyFlow_R_R",
    "steadyFlow_R_RCR",
    "steadyFlow_R_coronary",
    "steadyFlow_R_steadyPressure",
    "steadyFlow_bifurcationR_R1",
    "steadyFlow_blood_vessel_junction",
    "steadyFlow_stenosis_R",
]
TOLERANCE = 1e-7


@pytest.mark.parametrize("case", CASES)
def test_reference_results_are_reproduced(shared: Path, case: str):
    folder = shared / "data" / "svzerod-cases"
    reference = pd.read_json(folder / "results" / f"result_{case}.json")
    table = simulate(read_network(folder / f"{case}.json"))
    assert list(table["name"]) == list(reference["name"])
    for column in reference.columns.drop("name"):
        expected, actual = reference[column].to_numpy(float), table[column].to_numpy(float)
        assert np.array_equal(np.isnan(expected), np.isnan(actual))
        excess = np.abs(actual - expected) - TOLERANCE * (1.0 + np.abs(expected))
        assert np.nanmax(excess, initial=-1.0) <= 0.0, column


def test_every_reference_case_is_run(shared: Path):
    assert sorted(path.stem for path in (shared / "data" / "svzerod-cases").glob("*.json")) == sorted(CASES)
