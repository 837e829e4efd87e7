"""A fresh draw of many values, described by few draws."""

import numpy as np
import pytest
from scipy import stats

from coronaryuq.core.seeds import generator
from coronaryuq.core.shrinkage import fresh_draw

ROWS, DRAWS, FRESH = 300, 48, 60


def ringing(random, count):
    """Oscillations of unknown frequency, phase and decay after an event."""
    time = np.linspace(0.0, 1.0, ROWS)
    frequency, phase, decay, size = random.standard_normal((4, count, 1))
    waves = np.sin(2.0 * np.pi * (12.0 * np.exp(0.2 * frequency) * time + 0.3 * phase))
    return 6.0 * np.exp(0.1 * size) * waves * np.exp(-3.0 * np.exp(0.2 * decay) * time)


def correlated(random, count):
    """Few directions, and a little of every row by itself."""
    shapes = generator(7, "test", "shapes of draws").standard_normal((4, ROWS))
    return random.standard_normal((count, 4)) @ shapes + 0.1 * random.standard_normal((count, ROWS))


def many(random, count):
    """More directions than draws."""
    sizes = 5.0 / np.sqrt(np.arange(1, 121))
    shapes = generator(7, "test", "many shapes of draws").standard_normal((120, ROWS))
    return random.standard_normal((count, 120)) * sizes @ shapes


def independent(random, count):
    return random.standard_normal((count, ROWS))


def distribution(mean, shapes, sd):
    return stats.multivariate_normal(mean, np.diag(1.0 + sd**2) + shapes.T @ shapes)


@pytest.mark.parametrize(("law", "bias"), [(ringing, 0.05), (correlated, 0.05), (independent, 0.05), (many, 0.2)])
def test_a_fresh_draw_is_as_far_from_the_others_as_it_is_said_to_be(law, bias):
    """In each of ten trials: chi-square of fresh draws with noise, over the number of rows.

    Its mean over the trials is 1 within four standard errors and a bias, because one share serves all directions; by
    the sample covariance it is 38 for the last law. The fresh draws are no less likely than by the sample covariance or
    by its diagonal, by more than 1 nat.
    """
    random, squares, gained = generator(1, "test", "fresh draws", law.__name__), [], []
    for _ in range(10):
        draws, fresh = law(random, DRAWS), law(random, FRESH)
        read, apart = fresh + random.standard_normal(fresh.shape), draws - draws.mean(axis=0)
        found = distribution(*fresh_draw(draws))
        missing = read - found.mean
        squares.append(np.einsum("ni,ij,nj->n", missing, np.linalg.inv(found.cov), missing).mean() / ROWS)
        none, sample = np.zeros(ROWS), apart / np.sqrt(DRAWS - 1)
        others = (sample, none), (np.zeros((1, ROWS)), draws.std(axis=0))
        density = [distribution(draws.mean(axis=0), *other).logpdf(read).mean() for other in others]
        gained.append(found.logpdf(read).mean() - max(density))
    error = np.std(squares) / np.sqrt(len(squares))
    assert abs(np.mean(squares) - 1.0) < bias + 4.0 * error
    assert np.mean(gained) > -1.0


def test_the_variance_at_each_row_is_kept():
    draws = ringing(generator(2, "test", "variances"), DRAWS)
    _, shapes, sd = fresh_draw(draws)
    assert np.sum(shapes**2, axis=0) + sd**2 == pytest.approx(draws.var(axis=0, ddof=1) * (1.0 + 1.0 / DRAWS))
