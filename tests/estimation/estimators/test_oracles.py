"""Closed forms of MFMC and BLUE against those of other packages: MXMCPy and PyApprox."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import blue, formulas
from coronaryuq.estimation.models import allocate

# Variances and covariance of a 3D and a 0D output, cost of a 0D run in 3D runs, budget in 3D runs.
CASES = [(4.0, 1.0, 1.8, 0.01, 100.0), (2.5, 9.0, -4.0, 1e-3, 300.0), (1.0, 1.0, 0.5, 0.1, 50.0)]
MODELS = np.array([[4.0, 3.6, 1.8, 0.6], [3.6, 4.0, 1.7, 0.5], [1.8, 1.7, 1.0, 0.1], [0.6, 0.5, 0.1, 1.0]])
COUNTS = [((0, 1, 2, 3), 40), ((1, 2, 3), 160), ((2, 3), 1000), ((3,), 70)]


@pytest.fixture
def mxmc():
    return pytest.importorskip("mxmc", reason="needs MXMCPy, which is not installed")


@pytest.fixture
def pyapprox():
    pytest.importorskip("pyapprox.statest", reason="needs PyApprox 2, which is not installed")


def of_pyapprox(covariance):
    """PyApprox's statistic of a mean with a known covariance of the models."""
    from pyapprox.statest.statistics import MultiOutputMean
    from pyapprox.util.backends.numpy import NumpyBkd

    statistic = MultiOutputMean(1, NumpyBkd())
    statistic.set_pilot_quantities(np.array(covariance))
    return statistic


@pytest.mark.parametrize(("v", "v_0d", "c", "w", "budget"), CASES)
def test_mfmc_of_two_models_is_that_of_pyapprox(pyapprox, v, v_0d, c, w, budget):
    from pyapprox.statest.acv.allocation import AnalyticalAllocator
    from pyapprox.statest.acv.variants import MFMCEstimator

    estimator = MFMCEstimator(of_pyapprox([[v, c], [c, v_0d]]), np.array([1.0, w]))
    allocated = AnalyticalAllocator(estimator).allocate(budget)
    rho = c / np.sqrt(v * v_0d)
    n_3d, n_0d = formulas.optimal_allocation(budget, w, rho)
    np.testing.assert_allclose(allocated.continuous_npartition_samples, [n_3d, n_0d - n_3d], rtol=1e-12)
    assert np.exp(allocated.objective_value[0]) == pytest.approx(
        formulas.optimal_variance(v, budget, w, rho), rel=1e-12
    )
    for ratio in (0.5, 3.0, 40.0):
        theirs = estimator.covariance_at(budget, np.array([ratio])).item()
        n = budget / (1 + w * (1 + ratio))
        assert theirs == pytest.approx(formulas.mfmc_variance(v, rho, n, n * (1 + ratio)), rel=1e-12)


@pytest.mark.parametrize(("v", "v_0d", "c", "w", "budget"), CASES)
def test_mfmc_of_two_models_is_that_of_mxmcpy(mxmc, v, v_0d, c, w, budget):
    """MXMCPy rounds the numbers of runs down, and its estimate has α from the same covariance."""
    covariance = np.array([[v, c], [c, v_0d]])
    found = mxmc.optimizer.Optimizer(np.array([1.0, w]), covariance).optimize("mfmc", budget)
    rho = c / np.sqrt(v * v_0d)
    n_3d, n_0d = map(int, formulas.optimal_allocation(budget, w, rho))
    np.testing.assert_array_equal(found.allocation.get_number_of_samples_per_model(), [n_3d, n_0d])
    assert found.variance == pytest.approx(formulas.mfmc_variance(v, rho, n_3d, n_0d), rel=1e-12)

    rng = generator(2, "oracle")
    q = rng.normal(1.0, v_0d**0.5, n_0d)
    y = 3.0 + 1.3 * q[:n_3d] + rng.normal(size=n_3d)
    alpha = formulas.control_coefficient(y, q[:n_3d])
    sample = np.cov(y, q[:n_3d])
    theirs = mxmc.estimator.Estimator(found.allocation, sample).get_estimate([y, q])
    assert theirs == pytest.approx(y.mean() + alpha * (q.mean() - q[:n_3d].mean()), rel=1e-12)


def test_blue_of_four_models_is_that_of_pyapprox(pyapprox):
    from pyapprox.statest.groupacv.mlblue import MLBLUEEstimator

    subsets = [np.array(models) for models, _ in COUNTS]
    estimator = MLBLUEEstimator(of_pyapprox(MODELS), np.array([1.0, 0.1, 0.01, 0.01]), model_subsets=subsets)
    counts = np.array([float(n) for _, n in COUNTS])
    weights = blue.weights(COUNTS, MODELS)
    pairs = zip(COUNTS, weights, strict=True)
    variance = sum(w @ MODELS[np.ix_(m, m)] @ w / n for (m, n), w in pairs)
    assert estimator._covariance_from_npartition_samples(counts).item() == pytest.approx(variance, rel=1e-10)
    np.testing.assert_allclose(estimator._grouped_acv_beta(counts)[0], np.concatenate(weights), atol=1e-10)


@pytest.mark.slow
def test_no_allocation_of_pyapprox_has_less_variance(pyapprox):
    """Its trust-region optimum over all seven subsets of three models, not rounded."""
    from pyapprox.optimization.minimize.scipy.trust_constr import ScipyTrustConstrOptimizer
    from pyapprox.statest.groupacv import GroupACVAllocationOptimizer
    from pyapprox.statest.groupacv.mlblue import MLBLUEEstimator

    covariance, costs, budget = MODELS[:3, :3], np.array([1.0, 0.1, 0.001]), 100.0
    estimator = MLBLUEEstimator(of_pyapprox(covariance), costs)
    optimizer = ScipyTrustConstrOptimizer(gtol=1e-8, maxiter=1000)
    found = GroupACVAllocationOptimizer(estimator, optimizer=optimizer).optimize(budget, round_nsamples=False)
    theirs = estimator._covariance_from_npartition_samples(found.npartition_samples.ravel()).item()
    ours = allocate(covariance, costs, budget).variance
    assert theirs * (1 - 1e-4) <= ours <= theirs * (1 + 1e-4)
