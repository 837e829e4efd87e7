"""Closed-form variances and allocations."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.formulas import (
    additional_budget,
    chebyshev,
    control_coefficient,
    correlation,
    mfmc_variance,
    monte_carlo_variance,
    optimal_allocation,
    optimal_variance,
)


def test_variance_is_exact_for_a_pair_of_monomials():
    """Q_3D = U², Q_0D = U: var 4/45, rho² 15/16; N = 10 and 40 give 4/45/10 (1 − 45/64) = 19/7200."""
    rho = np.sqrt(15 / 16)
    assert mfmc_variance(4 / 45, rho, 10, 40) == pytest.approx(19 / 7200, rel=1e-14)


def mfmc_mean(y, q, q_more, alpha):
    """The paper's Q_MFMC: mean(y) + alpha (mean of q over all N_0D samples − mean of q over the pilot)."""
    everywhere = (q.sum() + q_more.sum()) / (len(q) + len(q_more))
    return y.mean() + alpha * (everywhere - q.mean())


def test_the_claimed_variance_is_the_empirical_one():
    """20,000 estimates of E[U²] with the optimal alpha = 1; tolerance is five standard errors."""
    trials, n, m = 20_000, 10, 30
    u, more = (generator(1, "mfmc", name).random((trials, size)) for name, size in (("pilot", n), ("more", m)))
    means = np.array([mfmc_mean(a**2, a, b, 1.0) for a, b in zip(u, more, strict=True)])
    assert means.var() == pytest.approx(19 / 7200, rel=5 * np.sqrt(2 / trials))
    assert means.mean() == pytest.approx(1 / 3, abs=5 * np.sqrt(19 / 7200 / trials))


def test_coefficient_and_correlation_of_an_exact_line_are_exact():
    q = generator(1, "line").normal(size=50)
    assert control_coefficient(3 - 2 * q, q) == pytest.approx(-2)
    assert correlation(3 - 2 * q, q) == pytest.approx(-1)


def test_constant_low_fidelity_gives_plain_monte_carlo():
    y, q = np.arange(5.0), np.ones(5)
    assert control_coefficient(y, q) == 0 and correlation(y, q) == 0
    assert mfmc_variance(y.var(ddof=1), 0.0, 5, 14) == monte_carlo_variance(y)


@pytest.mark.parametrize("rho", [0.3, 0.9, 0.9999])
def test_allocation_spends_the_budget_and_nothing_beats_it(rho):
    w, budget = 1e-5, 100.0
    n, m = optimal_allocation(budget, w, rho)
    assert n + w * m == pytest.approx(budget)
    best = optimal_variance(2.0, budget, w, rho)
    assert best == pytest.approx(2.0 / budget * (np.sqrt(1 - rho**2) + np.sqrt(w) * rho) ** 2)
    for share in np.linspace(0.01, 1, 200) * budget:
        if (budget - share) / w >= share:
            assert mfmc_variance(2.0, rho, share, (budget - share) / w) >= best * (1 - 1e-12)


@pytest.mark.parametrize("wanted", [0.9, 0.5, 0.1, 1e-3])
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.99])
def test_additional_budget_reaches_the_target_variance_at_least_cost(rho, wanted):
    n, m, w = 50, 500, 1e-3
    start = mfmc_variance(1.0, rho, n, m)
    cost, more_3d, more_0d = additional_budget(1.0, rho, n, m, w, wanted * start)
    assert mfmc_variance(1.0, rho, n + more_3d, m + more_0d) == pytest.approx(wanted * start)
    assert more_3d >= 0 and more_0d >= 0
    for extra in np.linspace(0, 2 * (more_3d + 1), 101):
        left = wanted * start - (1 - rho**2) / (n + extra)
        if left > 0:
            enough = max(rho**2 / left, m) if rho else m
            if mfmc_variance(1.0, rho, n + extra, enough) <= wanted * start * (1 + 1e-12):
                assert extra + w * (enough - m) >= cost * (1 - 1e-9)


def test_chebyshev_is_ten_standard_deviations_at_99_percent():
    interval = chebyshev(1.0, 0.04, 0.99)
    assert (interval.low, interval.high) == pytest.approx((-1.0, 3.0))
