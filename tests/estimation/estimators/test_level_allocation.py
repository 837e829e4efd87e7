"""Counts of three levels by cost, and what a coarse level gained."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.estimation.estimators.level_allocation import Costs, allocation, worth
from coronaryuq.estimation.results import Parts
from support.estimates import estimator, row

positive = st.floats(1e-4, 1e2)


@settings(max_examples=60, deadline=None)
@given(positive, positive, positive, st.floats(1e-3, 0.9), st.floats(1e-6, 1e-2))
def test_no_counts_on_a_grid_beat_the_closed_form(fine, coarse, cheap, cost, cost_0d):
    parts, costs = Parts(fine, coarse, cheap), Costs(cost, cost_0d)
    best = allocation(parts, costs)

    def product(r, m):
        return (fine + coarse / r + cheap / m) * (1 + r * cost + m * cost_0d)

    r = best.coarse * np.geomspace(0.2, 5, 41)[:, None]
    m = best.cheap * np.geomspace(0.2, 5, 41)[None]
    assert product(best.coarse, best.cheap) == pytest.approx(best.product)
    assert np.where(r >= 1, product(r, m), np.inf).min() >= best.product * (1 - 1e-9)


def test_worth_compares_variance_times_cost_without_and_with_the_level():
    claims = {"MC": 2.0, "crossfit-GP": 1.0, "multilevel": 0.5}
    estimators = {name: estimator(std=std, n_3d=10) for name, std in claims.items()}
    levels = row(levels=Parts(1.0, 4.0, 1.0), estimators=estimators, n_propagation=1000)
    got = worth(levels, 40, Costs(0.1, 1e-9))
    assert got.without == "crossfit-GP" and got.std_ratio == 0.5
    assert got.gain == pytest.approx(4 * 10 / 14) and got.optimal_runs_per_fine == pytest.approx(np.sqrt(40))
    assert worth(replace(levels, levels=None), 40, Costs(0.1, 1e-9)) is None
