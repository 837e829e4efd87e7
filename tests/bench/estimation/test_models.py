"""Benchmark `models`: crossfit-GP beside linear combinations of several 0D outputs."""

import json
from pathlib import Path

import numpy as np
import pytest

from coronaryuq.bench.estimation import models
from coronaryuq.bench.estimation.models import cells_of
from coronaryuq.bench.estimation.pairs import PAIRS
from coronaryuq.bench.estimation.problems import from_pair
from coronaryuq.core.errors import InputError
from coronaryuq.estimation.estimators.formulas import correlation


@pytest.mark.slow
def test_all_methods_are_run_on_the_same_trials():
    cells = {
        cell["method"]: cell for cell in cells_of(from_pair(PAIRS["smooth"]), 50, 4, models._pyapprox() is not None)
    }
    assert {"MC", "MFMC", "crossfit-GP", "BLUE"} <= set(cells)
    assert cells["MC"]["over_mc"] == 1 and cells["crossfit-GP"]["over_mc"] < 0.5
    assert all(0.2 < cell["claimed_over_empirical"] < 5 for cell in cells.values())


def test_mlblue_is_least_squares_on_all_0d_outputs():
    """Its estimate is that of a linear control variate with coefficients from the whole pilot."""
    if models._pyapprox() is None:
        pytest.skip("needs PyApprox 2, which is not installed")
    trial = from_pair(PAIRS["smooth"]).draw(50, 0)
    mean, std = models._mlblue(trial, np.zeros(50, dtype=int))
    q, more = trial.seen.outputs, trial.more.outputs
    slope = np.linalg.lstsq(q - q.mean(axis=0), trial.y - trial.y.mean(), rcond=None)[0]
    both = np.vstack([q, more]).mean(axis=0)
    assert mean == pytest.approx(trial.y.mean() + slope @ (both - q.mean(axis=0)), rel=1e-6)
    assert std < trial.y.std() * np.sqrt((1 - 0.9 * correlation(trial.y, q @ slope) ** 2) / 50)


def test_rows_without_data_are_one_line():
    with pytest.raises(InputError, match="needs --data, the folder of published runs"):
        models.run(rows="rows.csv")


def test_the_page_has_the_recorded_numbers():
    root = Path(__file__).parents[3]
    cells = json.loads((root / "benchmarks" / "estimation-models.json").read_text())["cells"]
    page = (root / "docs" / "explanation" / "estimation.md").read_text(encoding="utf-8")
    table = page.partition("<!-- models -->")[2].partition("<!-- end of models -->")[0].strip().splitlines()
    methods = [name.strip() for name in table[0].split("|")[2:-1]]
    over_mc = {(cell["problem"], cell["method"]): f"{cell['over_mc']:.3g}" for cell in cells}
    problems = list(dict.fromkeys(cell["problem"] for cell in cells))
    assert table[2:] == [" | ".join([f"| {p}", *(over_mc[p, m] for m in methods)]) + " |" for p in problems]
