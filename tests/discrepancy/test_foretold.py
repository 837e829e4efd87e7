"""Held-out measurements against what a fit to the others foretells: the level of the test, and what it sees."""

from types import SimpleNamespace

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.cross_validation import Linear, foretold

SERIES, POINTS, PARAMETERS = 4, 15, 3
ROWS = SERIES * POINTS
HELD_OUT = np.repeat([False, False, True, True], POINTS)
FOLDS = [(~HELD_OUT, HELD_OUT)]
PHASE = np.arange(POINTS) / POINTS
SERIES_OF = [SimpleNamespace(value=np.zeros(POINTS), time=PHASE, period=1.0) for _ in range(SERIES)]
PROBLEM = SimpleNamespace(
    sd=np.ones(ROWS),
    owner=np.repeat(np.arange(SERIES), POINTS),
    forward=SimpleNamespace(measured=SERIES_OF),
)


def p_value(random, missing=0.0, folds=FOLDS):
    """Of a linear model with its parameters from the prior; missing: a wave in one held-out series, noise sd."""
    jacobian = random.standard_normal((ROWS, PARAMETERS))
    y = jacobian @ random.standard_normal(PARAMETERS) + random.standard_normal(ROWS)
    y[2 * POINTS : 3 * POINTS] += missing * np.sin(2 * np.pi * PHASE)
    return foretold(PROBLEM, Linear(np.zeros(PARAMETERS), y, jacobian), folds)


def test_what_is_as_foretold_is_doubted_as_seldom_as_said():
    """In 3000 trials the p-value falls below 0.05 in no more than that share, four standard errors allowed."""
    trials, level, random = 3000, 0.05, generator(11, "test", "foretold")
    share = np.mean([p_value(random) < level for _ in range(trials)])
    error = np.sqrt(level * (1.0 - level) / trials)
    # Three tests of the same residuals share the level, so that the share may be well below it.
    assert 0.3 * level < share < level + 4.0 * error


def test_each_fold_counts():
    """Either half kept out in turn: twice as many tests, the same level."""
    trials, level, random = 1000, 0.05, generator(12, "test", "foretold")
    both = [(~HELD_OUT, HELD_OUT), (HELD_OUT, ~HELD_OUT)]
    share = np.mean([p_value(random, folds=both) < level for _ in range(trials)])
    assert share < level + 4.0 * np.sqrt(level * (1.0 - level) / trials)


def test_a_wave_that_no_fit_had_seen_is_seen():
    """A sine of 2.5 noise sd over the 15 points of one series of two: 6.8 sd in all, of which a fit takes up little."""
    random = generator(13, "test", "foretold")
    assert np.mean([p_value(random, missing=2.5) < 0.001 for _ in range(200)]) > 0.9
