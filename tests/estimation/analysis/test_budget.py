"""Budget curves and the plan for target intervals, from files to files."""

import numpy as np
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.typed import plain
from coronaryuq.estimation.analysis import budget
from coronaryuq.estimation.estimators.formulas import mfmc_variance
from coronaryuq.estimation.results import Interval
from coronaryuq.estimation.settings import Settings
from support.estimates import estimator, row


def report(rho=0.99, n=100, m=900):
    spread = 4.0
    best = estimator(
        rho_held_out=rho, n_3d=n, std=mfmc_variance(spread, rho, n, n + m) ** 0.5, calibrated=Interval(-0.1, 0.1, 0.95),
        variance={"runs_3d": spread * (1 - rho**2) / n, "propagation": spread * rho**2 / (n + m), "chain": 0.0},
    )  # fmt: skip
    estimators = {"MC": estimator(n_3d=n), "MFMC": estimator(), "crossfit-GP": best}
    return row(row="1", variance_3d=spread, n_propagation=m, recommended="crossfit-GP", estimators=estimators)


def test_budget_curves_begin_at_today_and_are_monotone():
    (curves,) = budget.curves([report()], 1e-3)
    for curve in curves.estimators.values():
        assert curve.additional_cost[0] == pytest.approx(0, abs=1e-9)
        assert np.all(np.diff(curve.additional_cost) >= 0) and np.all(np.diff(curve.optimal_variance) < 0)
    assert curves.estimators["crossfit-GP"].additional_cost[-1] < curves.estimators["MC"].additional_cost[-1]


def test_a_plan_that_is_carried_out_meets_the_target_width():
    (one,) = budget.plan([report()], {"1": 0.05}, 1e-3)
    n, m = 100 + one.more_3d, 1000 + one.more_0d
    assert mfmc_variance(4.0, 0.99, n, m) <= mfmc_variance(4.0, 0.99, 100, 1000) * 0.25 * (1 + 1e-9)
    assert one.cost_of_half > one.cost > 0


def test_a_width_that_is_met_costs_nothing():
    (one,) = budget.plan([report()], {"1": 0.2}, 1e-3)
    assert one.more_3d == one.more_0d == 0


def test_a_target_for_an_unknown_row_is_an_error(tmp_path):
    write_json(tmp_path / "e.json", {"rows": plain([report()]), "settings": {}})
    with pytest.raises(InputError, match="no such row"):
        budget.write_budget(tmp_path / "e.json", Settings(target_half_width={"9": 1.0}), tmp_path / "b.json")
