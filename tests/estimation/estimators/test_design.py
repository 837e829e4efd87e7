"""0D outputs at the propagation samples: their own where each was run, emulated where none was."""

from functools import cache

import numpy as np
import pytest
from scipy.special import ndtri

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import per_row, tails
from coronaryuq.estimation.estimators.design import Design, make_design
from coronaryuq.estimation.runs.table import Row
from support.runs import runs_of

ROW = Row("1", "ffr_lad", "ffr_lad", "")
TRIALS, N, M, INPUTS, FOLDS = 20, 16, 200, 20, 5
LOSS, SPREAD, NOISE = 0.05, 0.8, 0.002


@cache
def trials() -> list[tuple[Design, np.ndarray]]:
    """FFR = 1 − 0.05 exp(0.8 z), z a standard normal sum of 20 inputs, too many for 16 runs to tell; 3D adds noise."""
    made = []
    for trial in range(TRIALS):
        rng = generator(5, "design", trial)
        x, more = rng.normal(size=(N, INPUTS)), rng.normal(size=(M, INPUTS))
        q, q_more = (1 - LOSS * np.exp(SPREAD * at.sum(axis=1) / np.sqrt(INPUTS)) for at in (x, more))
        y = q + NOISE * rng.normal(size=N)
        runs = runs_of(np.exp(x), {"ffr_lad": y}, {"ffr_lad": q}, np.exp(more), q_more={"ffr_lad": q_more})
        made.append((make_design(runs, [ROW], FOLDS, trial), y))
    return made


def test_what_was_run_is_not_emulated():
    for design, _ in trials():
        assert per_row.crossfit_gp(design, ROW, per_row.predict(design, ROW, simple=True), 0.95).n_0d == N + M
        for block in design.blocks:
            assert np.array_equal(block.outputs["ffr_lad"], design.runs.q_more["ffr_lad"].to_numpy()[block.index])
        assert np.array_equal(design.held_out["ffr_lad"], design.runs.q["ffr_lad"].to_numpy())
        assert design.emulator_error["ffr_lad"] == 0


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_quantiles_reach_the_tails_that_the_0d_runs_reach(share):
    truth = 1 - LOSS * np.exp(SPREAD * ndtri(1 - share))
    found = []
    for design, y in trials():
        predictions = per_row.predict(design, ROW, simple=True)
        found.append(tails.quantile(design, y, predictions, share).value)
    # A quantile of 216 independent values is off by sqrt(p (1 − p) / 216) over the density, whatever the model.
    density = np.exp(-(ndtri(share) ** 2) / 2) / np.sqrt(2 * np.pi) / (SPREAD * (1 - truth))
    error = np.sqrt(share * (1 - share) / (N + M)) / density
    assert np.std(found) < 2 * error
    assert abs(np.mean(found) - truth) < 4 * error / np.sqrt(TRIALS)
