"""What the search minimises."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from coronaryuq.calibration import parameters
from coronaryuq.calibration.search import Objective
from coronaryuq.calibration.targets import BY_NAME, measurement_covariance
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.core.seeds import generator

TARGETS = {"PaoMin": 70.0, "PaoMean": 90.0, "PaoMax": 120.0, "AbsQin": 70.0, "EDV": 110.0, "PraMean": 4.0}
ERRORS = RoutineErrors(pressure=5.0, pressure_correlation=0.6, stroke_volume=0.1)
AT_START = parameters.INITIAL[None]


def test_cost_grows_steeply_where_a_clinical_target_is_missed_by_more_than_the_limit():
    def at(misfit, name):
        measured = 100.0 + misfit * BY_NAME[name].size(100.0)
        return Objective({name: 100.0}, 0.0).cost({name: np.array([measured])}, AT_START)[0]

    assert at(2.0, "PaoMean") == pytest.approx(4.0)
    assert at(3.0, "PaoMean") == pytest.approx(39.0)
    assert at(3.0, "PpulMean") == pytest.approx(9.0)


def test_errors_of_the_cuff_are_correlated_and_unmeasured_values_have_the_populations_spread():
    targets = {name: TARGETS[name] for name in ("PaoMin", "PaoMean", "AbsQin", "PraMean")}
    covariance = measurement_covariance(targets, list(targets), ERRORS)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), [5.0, 5.0, 7.0, 1.2])
    assert covariance[0, 1] == pytest.approx(0.6 * 25.0) and covariance[0, 2] == 0.0


def test_with_errors_the_cost_is_that_of_the_posterior_density():
    draw = generator(1, "hearts")
    spread = 0.3 * (parameters.UPPER - parameters.LOWER)
    points = parameters.INITIAL + spread * draw.uniform(-0.5, 0.5, (5, len(spread)))
    measures = {name: value * draw.uniform(0.8, 1.2, 5) for name, value in TARGETS.items()}
    noise = measurement_covariance(TARGETS, list(TARGETS), ERRORS)
    data = multivariate_normal(list(TARGETS.values()), noise).logpdf(np.array(list(measures.values())).T)
    prior = norm(parameters.INITIAL, parameters.PRIOR_SD).logpdf(points).sum(axis=1)
    cost = Objective(TARGETS, 0.2, ERRORS).cost(measures, points)
    np.testing.assert_allclose(cost - cost[0], -2.0 * (data + prior - data[0] - prior[0]), rtol=1e-9)


def test_three_pressures_that_are_off_together_have_one_cuff_and_contradictory_volumes_are_no_wall():
    def at(objective, **off):
        return objective.cost({name: np.array([v + off.get(name, 0.0)]) for name, v in TARGETS.items()}, AT_START)[0]

    probable, closest = Objective(TARGETS, 0.2, ERRORS), Objective(TARGETS, 0.2)
    together = at(probable, PaoMin=5.0, PaoMean=5.0, PaoMax=5.0)
    assert together < at(probable, PaoMean=5.0) and together < 1.5
    assert at(probable, EDV=20.0) < 4.0 and at(closest, EDV=20.0) > 400.0


@pytest.mark.parametrize("errors", [None, ERRORS])
def test_a_measure_that_does_not_exist_is_a_large_misfit_and_scores_do_not_count_where_slopes_are_taken(errors):
    objective = Objective({"PaoMean": 90.0, "LGradOK": 3.0}, 0.2, errors)
    missing = {"PaoMean": np.array([np.nan]), "LGradOK": np.array([3.0])}
    assert objective.cost(missing, AT_START)[0] > 1e4
    scored = {"PaoMean": np.array([90.0]), "LGradOK": np.array([5.0])}
    assert objective.cost(scored, AT_START)[0] == pytest.approx(4.0)
    assert objective.smooth().cost(scored, AT_START)[0] == pytest.approx(0.0)
