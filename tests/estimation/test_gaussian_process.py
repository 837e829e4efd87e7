"""Gaussian process against scikit-learn, finite differences and its own leave-one-out."""

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, DotProduct, Matern, WhiteKernel

from coronaryuq.estimation import gaussian_process as gp
from coronaryuq.seeds import generator


def problem(n=40, d=3):
    rng = generator(2, "gaussian process", n, d)
    x = rng.normal(size=(n, d))
    return x, np.sin(2 * x[:, 0]) + 0.5 * x[:, 1] + 0.05 * rng.normal(size=n)


@pytest.mark.parametrize("smooth", ["matern", "squared exponential"])
def test_gradient(smooth):
    x, y = problem()
    at = generator(2, "at").normal(size=6) * 0.3
    _, gradient = gp.negative_log_posterior(at, x, y, smooth)
    for j in range(6):
        step = np.zeros(6)
        step[j] = 1e-6
        up, down = (gp.negative_log_posterior(at + s * step, x, y, smooth)[0] for s in (1, -1))
        assert (up - down) / 2e-6 == pytest.approx(gradient[j], rel=1e-5, abs=1e-5)


@pytest.mark.parametrize(("smooth", "kernel"), [("matern", Matern), ("squared exponential", RBF)])
def test_predictions_equal_those_of_scikit_learn_at_the_same_parameters(smooth, kernel):
    x, y = problem()
    model = gp.fit(x, y, smooth)
    d = x.shape[1]
    lengths, (s, l, noise) = np.exp(model.log_parameters[:d]), np.exp(model.log_parameters[d:])
    shape = {"nu": 2.5} if kernel is Matern else {}
    # A linear kernel with one length scale per input is a dot product of scaled inputs.
    same = (
        ConstantKernel(s**2) * kernel(1.0, **shape)
        + ConstantKernel(l**2) * DotProduct(sigma_0=1e-9, sigma_0_bounds="fixed")
        + WhiteKernel(noise**2 + gp.JITTER)
    )
    theirs = GaussianProcessRegressor(same, optimizer=None, alpha=0.0).fit(model.x / lengths, (y - y.mean()) / y.std())
    at = generator(2, "new").normal(size=(25, d))
    wanted = y.mean() + y.std() * theirs.predict((at - model.shift) / model.scale / lengths)
    np.testing.assert_allclose(model.predict(at), wanted, rtol=1e-6, atol=1e-8)


def test_leave_one_out_is_what_leaving_one_out_gives():
    x, y = problem(20)
    model = gp.fit(x, y)
    k, _ = gp._kernel(model.log_parameters, model.x, model.x, "matern")
    k[np.diag_indices(20)] += np.exp(2 * model.log_parameters[-1]) + gp.JITTER
    b = (y - model.mean) / model.spread
    for i in range(20):
        rest = np.arange(20) != i
        wanted = b[i] - k[i, rest] @ np.linalg.solve(k[np.ix_(rest, rest)], b[rest])
        assert model.leave_one_out[i] == pytest.approx(model.spread * wanted, rel=1e-6)


def test_useless_inputs_are_ignored_and_a_constant_one_does_no_harm():
    x, y = problem(60)
    crowd = np.column_stack([x, generator(2, "crowd").normal(size=(60, 10)), np.ones(60)])
    fresh, truth = problem(300)[0], None
    truth = np.sin(2 * fresh[:, 0]) + 0.5 * fresh[:, 1]
    wide = np.column_stack([fresh, generator(2, "crowd 2").normal(size=(300, 10)), np.ones(300)])
    assert np.std(gp.fit(crowd, y).predict(wide) - truth) < 0.15 * np.std(truth)


def test_same_bits_again():
    x, y = problem()
    assert (gp.fit(x, y).predict(x) == gp.fit(x, y).predict(x)).all()
