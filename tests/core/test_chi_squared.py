"""Chi-squared statistics against the distribution itself and against draws."""

import numpy as np
import pytest
from scipy import stats

from coronaryuq.core.chi_squared import chi2_tail, mean_of_smaller
from coronaryuq.core.seeds import generator


def test_the_tail_of_a_quadratic_form_is_uniform():
    """For vectors that have the covariance, of full rank and of rank two: 500 draws, Kolmogorov and Smirnov."""
    for rank in (4, 2):
        random = generator(rank, "test", "chi2 tail")
        root = random.standard_normal((4, rank))
        found = [chi2_tail(root @ root.T, root @ random.standard_normal(rank)) for _ in range(500)]
        assert stats.kstest(found, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("fraction", [0.5, 0.9, 1.0])
def test_the_mean_of_the_smaller_squares_is_that_of_draws(fraction):
    squares = np.sort(generator(1, "test", "smaller squares").standard_normal(200_000) ** 2)
    smaller = squares[: int(fraction * squares.size)]
    assert mean_of_smaller(fraction) == pytest.approx(smaller.mean(), abs=5.0 * smaller.std() / np.sqrt(smaller.size))
