"""Sobol indices against known values, over repeated trials."""

import numpy as np
import pytest

from coronaryuq.bench.estimation.problems import ROW, Trial, as_design
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import sensitivity
from coronaryuq.estimation.estimators.folds import assign
from coronaryuq.estimation.estimators.per_row import predict
from coronaryuq.estimation.surrogates.control_variates import Seen
from support.linear_trials import VARIANCE, check, coverage, linear_trials

pytestmark = pytest.mark.slow


@pytest.mark.long
@pytest.mark.parametrize(("name", "truth"), [("a", 1 / VARIANCE), ("b", 0.25 / VARIANCE)])
def test_sobol_indices_of_an_additive_model_hold_their_claims(name, truth):
    check([sensitivity.sobol(d, y, p)[name] for d, y, p in linear_trials()], truth)


def test_small_effects_that_the_predictions_miss_are_counted():
    """A linear control variate sees nothing of θ_2's parabola, and hardly anything of θ_1's small slope."""
    parabola, slope, found = 0.14 * np.sqrt(2.0), 0.16, []
    total = 1 + slope**2 + parabola**2 + 0.09
    for trial in range(100):
        rng = generator(5, "small effects", trial)
        x, more = rng.normal(size=(80, 3)), rng.normal(size=(1000, 3))
        noise = 0.3 * rng.normal(size=80)
        y = x[:, 0] + slope * x[:, 1] + parabola * (x[:, 2] ** 2 - 1) / np.sqrt(2.0) + noise
        drawn = Trial(Seen(x, x[:, 0], x[:, :1]), y, Seen(more, more[:, 0], more[:, :1]))
        design = as_design(drawn, assign(80, 5, 5, "small effects", trial))
        found.append(sensitivity.sobol(design, y, predict(design, ROW, simple=True)))
    for name, truth in (("theta_1", slope**2 / total), ("theta_2", parabola**2 / total)):
        values = np.array([of[name].value for of in found])
        assert coverage([of[name] for of in found], truth) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / len(found))
        assert abs(values.mean() - truth) < 4 * values.std() / np.sqrt(len(found))
