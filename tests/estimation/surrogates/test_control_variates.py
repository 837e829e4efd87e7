"""Control variates: influence of a training run in closed form, against refits, and the variance beside a rival."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.surrogates import gaussian_process as gp
from coronaryuq.estimation.surrogates.control_variates import METHODS, RUNS_PER_POWER, Seen, with_rival


def seen_of(x):
    return Seen(x, x[:, 0], x)


@pytest.mark.parametrize("method", ["constant", "linear 0D", "linear theta"])
def test_the_influence_of_a_run_is_the_difference_to_a_fit_without_it(method):
    rng = generator(4, "influence")
    x, new = rng.normal(size=(25, 4)), rng.normal(size=(7, 4))
    y = np.sin(x).sum(axis=1)
    fitted = METHODS[method](seen_of(x), y)
    for left in (0, 11):
        others = np.delete(np.arange(25), left)
        without = METHODS[method](seen_of(x[others]), y[others]).predict(seen_of(new))
        change = fitted.predict(seen_of(new)) - without
        np.testing.assert_allclose(fitted.influence(seen_of(new))[:, left], change, atol=1e-10)


def test_the_influence_on_a_process_is_that_on_a_linear_smoother():
    """With weights W(x) of the outputs, leaving run l out takes W(x)_l times its leave-one-out residual away."""
    rng = generator(4, "influence", "process")
    x, new = rng.normal(size=(25, 2)), rng.normal(size=(7, 2))
    y = np.sin(2 * x[:, 0]) + x[:, 1] ** 2
    model = gp.fit(x, y)
    a = (x - model.shift) / model.scale
    k = gp.training_covariance(model.parameters, a)
    others = np.delete(np.arange(25), 3)
    b = (y - model.mean) / model.spread
    alpha = np.linalg.solve(k[np.ix_(others, others)], b[others])
    without = replace(model, x=a[others], weights=alpha).predict(new)
    np.testing.assert_allclose(model.influence(new)[:, 3], model.predict(new) - without, atol=1e-6)


def test_the_influence_on_a_process_of_the_logarithm_is_that_on_its_exponential():
    """And so are its leave-one-out residuals: prediction and influence at a training run agree."""
    rng = generator(4, "influence", "logarithm")
    x, new = rng.normal(size=(25, 2)), rng.normal(size=(7, 2))
    y = np.exp(0.3 * x[:, 0] + 0.1 * x[:, 1] ** 2)
    model, fitted = gp.fit(np.column_stack([x, x]), np.log(y)), METHODS["GP of log y"](seen_of(x), y)
    both = np.column_stack([new, new])
    np.testing.assert_allclose(fitted.predict(seen_of(new)), np.exp(model.predict(both)), rtol=1e-12)
    without = np.exp(model.predict(both)[:, None] - model.influence(both))
    change = fitted.predict(seen_of(new))[:, None] - without
    np.testing.assert_allclose(fitted.influence(seen_of(new)), change, atol=1e-12)
    np.testing.assert_allclose(np.log(y - fitted.leave_one_out), np.log(y) - model.leave_one_out, atol=1e-12)


def test_a_rival_that_differs_adds_the_variance_of_a_mixture():
    rng = generator(4, "rival")
    x, far = seen_of(rng.uniform(0, 1, (20, 1))), seen_of(np.full((3, 1), 3.0))
    y = 1 + x.row_output
    line, curve = (METHODS[name](x, y + 0.01 * np.cos(9 * y)) for name in ("linear 0D", "GP of log y"))
    weights = np.array([line.missed, curve.missed]) ** (-20 / RUNS_PER_POWER)
    weights /= weights.sum()
    apart = line.predict(far) - curve.predict(far)
    for most in (2 * np.abs(apart).max(), 0.5 * np.abs(apart).min()):
        wanted = line.variance(far) + weights.prod() * np.minimum(np.abs(apart), most) ** 2
        np.testing.assert_allclose(with_rival(line, curve, most).variance(far), wanted)
    np.testing.assert_array_equal(with_rival(line, curve, 1.0).predict(far), line.predict(far))


@pytest.mark.parametrize("method", ["constant", "linear 0D", "linear theta", "GP(θ)", "GP with active direction"])
def test_the_covariance_of_errors_has_the_variance_less_that_of_noise_on_its_diagonal(method):
    rng = generator(4, "covariance")
    x, new = rng.normal(size=(40, 2)), rng.normal(size=(30, 2))
    y = np.sin(2 * x[:, 0]) + x[:, 1] ** 2 + 0.1 * rng.normal(size=40)
    fitted = METHODS[method](seen_of(x), y)
    covariance, variance = fitted.covariance(seen_of(new)), fitted.variance(seen_of(new))
    noise = variance - np.diag(covariance)
    assert noise.min() > 0 and np.ptp(noise) < 1e-8 * variance.max()
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-7 * variance.max())
    assert np.linalg.eigvalsh(covariance)[0] > -1e-7 * variance.max()


def test_the_covariance_of_a_process_of_the_logarithm_is_that_of_a_log_normal():
    rng = generator(4, "covariance", "logarithm")
    x, new = rng.normal(size=(40, 2)), rng.normal(size=(3, 2))
    y = np.exp(np.sin(2 * x[:, 0]) + 0.3 * rng.normal(size=40))
    fitted, model = METHODS["GP of log y"](seen_of(x), y), gp.fit(np.column_stack([x, x]), np.log(y))
    both = np.column_stack([new, new])
    drawn = np.exp(rng.multivariate_normal(model.predict(both), model.covariance(both), 200_000))
    scale = np.exp(np.diag(model.covariance(both)) / 2)  # of the mean of a log-normal over its median
    expected = fitted.covariance(seen_of(new))
    np.testing.assert_allclose(np.cov(drawn.T) / np.outer(scale, scale), expected, atol=0.02 * expected.max())
