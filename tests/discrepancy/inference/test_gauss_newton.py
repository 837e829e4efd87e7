"""Calibration, evidence and tests against exact Gaussian results and repeated trials."""

import numpy as np
import pytest
from scipy import stats

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.gauss_newton import Fit, Search, maximise


def linear_case(seed, rows=40, columns=5):
    random = generator(seed, "test", "linear")
    g = random.standard_normal((rows, columns))
    z = random.standard_normal(columns)
    return g, g @ z + random.standard_normal(rows)


def fit_of(g, y):
    z = np.linalg.solve(np.eye(g.shape[1]) + g.T @ g, g.T @ y)
    return Fit(z, y - g @ z, g)


def test_evidence_is_the_exact_gaussian_one():
    """For a linear model log Z is the density of y under N(0, I + GG'), constant left out."""
    g, y = linear_case(1)
    exact = stats.multivariate_normal(np.zeros(len(y)), np.eye(len(y)) + g @ g.T).logpdf(y)
    assert fit_of(g, y).evidence - 0.5 * len(y) * np.log(2 * np.pi) == pytest.approx(exact)


def test_gauss_newton_finds_the_linear_optimum_at_once():
    g, y = linear_case(2)
    search = Search(None, np.zeros(5), list(range(5)))
    maximise(lambda rows: np.array([y - g @ z for z, _ in rows]), [search], 4)
    assert search.fit.z == pytest.approx(fit_of(g, y).z, abs=1e-8)


def test_gauss_newton_solves_a_curved_problem():
    """y = exp(z) with tight noise: the optimum is log y up to the prior's pull."""
    search = Search(None, np.zeros(1), [0])
    maximise(lambda rows: np.array([(2.0 - np.exp(z)) / 1e-3 for z, _ in rows]), [search], 20, tolerance=1e-9)
    assert search.fit.z[0] == pytest.approx(np.log(2.0), abs=1e-5)


def test_what_is_linear_by_nature_is_not_held_back_where_the_rest_is():
    """A weight of 40 prior standard deviations beside a parameter of 7, three of which a step may go."""
    random = generator(9, "test", "linear part")
    shape, slope = random.standard_normal((2, 50))
    y = 40.0 * 3.0 * shape + 7.0 * slope

    g, y = np.column_stack([3.0 * shape, slope]) / 0.1, y / 0.1

    def found(**how):
        search = Search(None, np.zeros(2), **how)
        maximise(lambda rows: np.array([y - g @ z for z, _ in rows]), [search], 3)
        return search.z

    assert found(fresh=[1], exact=([0], g[:, :1])) == pytest.approx(fit_of(g, y).z, abs=1e-6)
    assert found(fresh=[0, 1])[0] < 10.0


def test_a_weight_that_starts_far_off_is_no_reason_to_move_anything_else():
    """Sensitivities of an earlier fit that hold no more: what the weight gains would pay for a wrong step."""
    random = generator(10, "test", "weight far off")
    shape, slope = random.standard_normal((2, 50)) / 0.1
    g, y = np.column_stack([shape, slope]), 40.0 * shape + 0.5 * slope
    best = fit_of(g, y).z
    stale = np.column_stack([shape, slope + 0.5 * shape])
    start = np.array([0.0, best[1]])
    search = Search(None, start, [1], stale, renewed=start, exact=([0], g[:, :1]))
    maximise(lambda rows: np.array([y - g @ z for z, _ in rows]), [search], 1)
    assert search.z == pytest.approx(best, abs=1e-6)


def test_sensitivities_that_were_recomputed_close_by_serve_another_fit():
    """Data that are put right elsewhere want no new ones, however far weights of shapes go; going far does."""
    g, y = linear_case(12)
    g[:, 0] *= 10.0
    exact, asked = ([0], g[:, :1]), []

    def residuals(other):
        def evaluate(rows):
            asked.append(len(rows))
            return np.array([y + other - g @ z for z, _ in rows])

        return evaluate

    def again(fit, other):
        asked.clear()
        known = {"jacobian": fit.jacobian, "renewed": fit.renewed}
        return maximise(residuals(other), [Search(None, fit.z, [1, 2, 3, 4], exact=exact, **known)], 12)[0].fit

    first = again(Fit(np.zeros(5), y, None), 0.0)
    assert 4 in asked and first.renewed is not None
    weight = again(first, 5.0 * g[:, 0])
    assert 4 not in asked and weight.z == pytest.approx(fit_of(g, y + 5.0 * g[:, 0]).z, abs=1e-6)
    again(first, 5.0 * g[:, 1])
    assert 4 in asked
    partly = maximise(residuals(0.0), [Search(None, np.zeros(5), [3, 4], np.zeros_like(g), exact=exact)], 2)[0]
    assert partly.fit.renewed is None


def test_what_runs_do_not_settle_to_is_not_learned_from_a_short_step():
    """Runs differ by noise; the last steps of a fit are shorter than finite differences: beside them it is large."""
    g, y = linear_case(14, rows=200)
    random, exact = generator(14, "test", "short steps"), fit_of(g, y)
    search = Search(None, exact.z + 1e-4, list(range(5)))
    maximise(lambda rows: np.array([y - g @ z + 1e-3 * random.standard_normal(200) for z, _ in rows]), [search], 6)
    assert search.fit.evidence == pytest.approx(exact.evidence, abs=0.1)
    assert search.jacobian == pytest.approx(g, abs=0.06)


def test_sensitivities_are_recomputed_where_a_step_was_as_long_as_they_are_valid():
    """Steps that may not go farther all gain what they promise, and would follow one direction for ever."""
    renewed = []

    def residuals(rows):
        if len(rows) == 2:
            renewed.append(rows[0][0] - [0.1, 0.0])
        return np.array([[50.0 * (40.0 - z[0]), 0.05 * (z[0] - 20.0) ** 2 + 10.0 * z[1]] for z, _ in rows])

    maximise(residuals, [Search(None, np.zeros(2), [0, 1])], 6)
    assert [z[0] for z in renewed[:4]] == pytest.approx([0.0, 3.0, 6.0, 9.0])


def test_a_failed_run_is_reported_not_raised():
    search, asked = Search(None, np.zeros(1), [0]), []

    def fails(rows):
        asked.append(len(rows))
        return np.full((len(rows), 3), np.nan)

    maximise(fails, [search], 3)
    assert search.failed and asked == [1]


def test_score_has_covariance_p():
    """Over repeated trials the score test's statistic is standard normal: level 5 % within its binomial error."""
    trials, rejected = 2000, 0
    random = generator(3, "test", "score")
    g = random.standard_normal((30, 4))
    direction = random.standard_normal(30)
    for _ in range(trials):
        fit = fit_of(g, g @ random.standard_normal(4) + random.standard_normal(30))
        z = direction @ fit.score / np.sqrt(direction @ fit.projection(direction))
        rejected += abs(z) > 1.959963984540054
    error = np.sqrt(0.05 * 0.95 / trials)
    assert rejected / trials == pytest.approx(0.05, abs=4 * error)


def test_objective_is_chi_squared_under_the_model():
    trials = 1000
    random = generator(4, "test", "chi2")
    g = random.standard_normal((30, 4))
    values = [fit_of(g, g @ random.standard_normal(4) + random.standard_normal(30)).objective for _ in range(trials)]
    assert stats.kstest(values, stats.chi2(30).cdf).pvalue > 1e-3


def test_sensitivities_are_renewed_only_where_a_step_gains_too_little():
    """A nearly linear problem takes one set of sensitivities and still ends at its optimum."""
    g, y = linear_case(8)
    asked = []

    def residuals(rows):
        asked.append(len(rows))
        return np.array([y - g @ z - 0.01 * z[0] ** 2 for z, _ in rows])

    search = maximise(residuals, [Search(None, np.zeros(5), list(range(5)))], 12)[0]
    assert asked.count(5) < len([n for n in asked if n == 3])
    slope = -np.gradient([np.sum(residuals([(search.z + h * np.eye(5)[0], None)])[0] ** 2) for h in (-0.01, 0, 0.01)])
    assert abs(slope[1] / 0.01 - 2.0 * search.z[0]) < 0.5


def test_differences_to_both_sides_find_the_optimum_where_residuals_are_large():
    """What a curved model cannot explain shifts the end of a fit by differences to one side, and its precision."""
    g, y = linear_case(15, rows=200)
    curved = generator(15, "test", "curvature").standard_normal(200)
    y = y - 3.0 * curved

    def fitted(central):
        def residuals(rows):
            return np.array([y - g @ z - curved * z[0] ** 2 for z, _ in rows])

        search = Search(None, np.array([1.0, 0.0, 0.0, 0.0, 0.0]), list(range(5)), central=central)
        return maximise(residuals, [search], 30, tolerance=1e-9, share=0.0)[0].fit

    def still_to_go(fit):
        """Gauss-Newton's next step with exact sensitivities, in posterior standard deviations."""
        exact = Fit(fit.z, fit.residual, g + 2.0 * fit.z[0] * np.outer(curved, np.eye(5)[0]))
        step = np.linalg.solve(exact.precision, exact.jacobian.T @ fit.residual - fit.z)
        return np.abs(step / np.sqrt(np.diag(exact.covariance))).max()

    assert still_to_go(fitted(central=True)) < 0.01 < 0.5 < still_to_go(fitted(central=False))
