"""Gaussian process against scikit-learn, finite differences and its own leave-one-out."""

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, DotProduct, Matern, WhiteKernel

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.surrogates import gaussian_process as gp
from coronaryuq.estimation.surrogates import matern


def problem(n=40, d=3):
    rng = generator(2, "gaussian process", n, d)
    x = rng.normal(size=(n, d))
    return x, np.sin(2 * x[:, 0]) + 0.5 * x[:, 1] + 0.05 * rng.normal(size=n)


def variances(model):
    """Signal, linear and noise variances, jitter included."""
    d = model.x.shape[1]
    signal, linear, noise = np.exp(2 * model.parameters[d : d + 3])
    return signal, linear, noise + gp.JITTER * (1 + signal)


@pytest.mark.parametrize("directions", [0, 2])
def test_gradient(directions):
    x, y = problem()
    at = generator(2, "at").normal(size=6 + 3 * directions) * 0.3
    _, gradient = gp.negative_log_posterior(at, x, y, matern.Memory.of(len(x)))
    for j in range(len(at)):
        step = np.zeros(len(at))
        step[j] = 1e-6
        up, down = (gp.negative_log_posterior(at + s * step, x, y, matern.Memory.of(len(x)))[0] for s in (1, -1))
        assert (up - down) / 2e-6 == pytest.approx(gradient[j], rel=1e-5, abs=1e-5)


def test_predictions_equal_those_of_scikit_learn_at_the_same_parameters():
    x, y = problem()
    model = gp.fit(x, y)
    lengths, (signal, linear, noise) = np.exp(model.parameters[:3]), variances(model)
    # A linear kernel with one length scale per input is a dot product of scaled inputs.
    same = (
        ConstantKernel(signal) * Matern(1.0, nu=2.5)
        + ConstantKernel(linear) * DotProduct(sigma_0=1e-9, sigma_0_bounds="fixed")
        + WhiteKernel(noise)
    )
    theirs = GaussianProcessRegressor(same, optimizer=None, alpha=0.0).fit(model.x / lengths, (y - y.mean()) / y.std())
    at = generator(2, "new").normal(size=(25, 3))
    wanted = y.mean() + y.std() * theirs.predict((at - model.shift) / model.scale / lengths)
    np.testing.assert_allclose(model.predict(at), wanted, rtol=1e-6, atol=1e-8)


def test_leave_one_out_is_what_leaving_one_out_gives():
    x, y = problem(20)
    model = gp.fit(x, y, directions=1)
    k = gp.training_covariance(model.parameters, model.x)
    b = (y - model.mean) / model.spread
    for i in range(20):
        rest = np.arange(20) != i
        wanted = b[i] - k[i, rest] @ np.linalg.solve(k[np.ix_(rest, rest)], b[rest])
        assert model.leave_one_out[i] == pytest.approx(model.spread * wanted, rel=1e-6)


def test_useless_inputs_are_ignored_and_a_constant_one_changes_nothing():
    x, y = problem(60)
    crowd = np.column_stack([x, generator(2, "crowd").normal(size=(60, 10)), np.ones(60)])
    fresh = problem(300)[0]
    truth = np.sin(2 * fresh[:, 0]) + 0.5 * fresh[:, 1]
    wide = np.column_stack([fresh, generator(2, "crowd 2").normal(size=(300, 10)), np.ones(300)])
    assert np.std(gp.fit(crowd, y).predict(wide) - truth) < 0.15 * np.std(truth)


def test_a_direction_finds_a_function_of_a_sum_that_single_length_scales_miss():
    rng = generator(2, "sum")
    x, new = rng.normal(size=(150, 8)), rng.normal(size=(300, 8))
    f = lambda v: np.tanh(3 * v.sum(axis=1) / 8**0.5)  # noqa: E731
    missed = [np.std(gp.fit(x, f(x), directions).predict(new) - f(new)) for directions in (0, 1)]
    assert missed[1] < 0.5 * missed[0]


def test_an_exact_parabola_without_noise_is_not_shifted_by_rounding():
    """So smooth a function makes the kernel matrix nearly singular; an offset per fold would spoil claims."""
    for trial in range(5):
        x = generator(2, "parabola", trial).uniform(0.5, 2, (45, 2))
        seen = np.column_stack([np.log(x), x.sum(axis=1)])
        f = (x.sum(axis=1) - 2.5) ** 2
        assert np.max(np.abs(gp.fit(seen, f).predict(seen) - f)) < 0.01


def test_same_bits_again():
    x, y = problem()
    assert (gp.fit(x, y).predict(x) == gp.fit(x, y).predict(x)).all()
