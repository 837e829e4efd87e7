"""Intervals lie in the range that the quantity has."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.analysis.estimate_rows import analyse
from coronaryuq.estimation.analysis.physical_range import within_range
from coronaryuq.estimation.runs.table import Row
from coronaryuq.estimation.settings import Settings
from support.runs import runs_of


@pytest.fixture(scope="module")
def row():
    """A share of the wall that is zero in most runs."""
    random = generator(1, "range")
    theta, more = (np.exp(0.3 * random.normal(size=(n, 2))) for n in (24, 200))
    y = np.maximum(0.0, 1e-3 * random.normal(size=24) - 1e-3)
    runs = runs_of(theta, {"low_shear_area_lad": y}, {"q": np.log(theta[:, 0])}, more)
    (row,) = analyse(runs, [Row("area", "low_shear_area_lad", "q", "")], Settings(autoencoder=False), 1)
    return row


def test_no_interval_of_an_area_begins_below_zero(row):
    assert row.estimators["MC"].chebyshev_99.low < 0
    for name, report in within_range(row).estimators.items():
        before = row.estimators[name]
        assert report.mean == before.mean and report.std == before.std
        for kind in ("calibrated", "chebyshev_95", "chebyshev_99"):
            now, then = getattr(report, kind), getattr(before, kind)
            assert now.low == max(then.low, 0.0) and now.high == max(then.high, 0.0) and now.level == then.level


def test_other_quantities_keep_their_intervals(row):
    other = replace(row, column_3d="something")
    assert within_range(other) == other


def test_no_quantile_of_ffr_is_above_one():
    """Few runs, and predictions with room above the largest of them."""
    random = generator(2, "range")
    theta, more = (np.exp(0.3 * random.normal(size=(n, 2))) for n in (24, 200))
    y = np.minimum(1.0, 0.9 + 0.15 * random.normal(size=24))
    runs = runs_of(theta, {"ffr_lad": y}, {"q": np.log(theta[:, 0])}, more)
    (before,) = analyse(runs, [Row("ffr", "ffr_lad", "q", "")], Settings(autoencoder=False), 1)
    quantiles = before.beyond_the_mean.quantiles
    assert quantiles["0.975"].value > 1.0
    after = within_range(before).beyond_the_mean.quantiles
    assert all(value.value <= 1.0 and value.low <= value.value <= value.high <= 1.0 for value in after.values())
    assert after["0.50"] == quantiles["0.50"]
