"""Two-sided quantiles: Student's for normal samples, wider for skewed ones, coverage over repeated trials."""

import numpy as np
import pytest
from scipy.stats import binom
from scipy.stats import t as student

from coronaryuq.estimation.estimators.crossfit import CrossFit, Propagated, combine
from coronaryuq.estimation.estimators.quantile import Part, lost_coverage, two_sided


def test_without_skewness_the_quantile_is_students():
    assert two_sided(0.95, [Part(1.0, 12)], 0.0, 25) == pytest.approx(student.ppf(0.975, 12))
    assert two_sided(0.95, [Part(0.0, 12)], 0.0, 25) == pytest.approx(student.ppf(0.975, 24))
    assert two_sided(0.95, [Part(1.0, 10)], 1.0, 25) == pytest.approx(student.ppf(0.975, 40))


def test_the_quantile_makes_up_for_the_coverage_that_skewness_takes():
    plain, wide = (two_sided(0.95, [Part(1.0, 30)], 0.0, 31, skewed) for skewed in (0.0, 0.4))
    assert wide > plain
    assert 2 * student.cdf(wide, 30) - 1 - lost_coverage(0.4, wide) == pytest.approx(0.95, abs=1e-6)


@pytest.mark.parametrize(
    ("draw", "mean"), [(np.random.Generator.standard_normal, 0.0), (np.random.Generator.standard_exponential, 1.0)]
)
def test_intervals_cover_the_mean_of_normal_and_of_skewed_samples(draw, mean):
    """93 to 97 %, with the binomial scatter of 600 trials at one in a thousand."""
    trials, covered = 600, 0
    random = np.random.default_rng(2)
    for _ in range(trials):
        y = draw(random, 25)
        fit = CrossFit(y, np.zeros(25), [Propagated(np.zeros(1))], np.zeros(25, int))
        covered += combine("MC", fit, 25).interval.holds(mean)
    assert binom.ppf(0.001, trials, 0.93) <= covered <= binom.ppf(0.999, trials, 0.97)
