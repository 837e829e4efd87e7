"""The p-value of held-out data under a fit to the others: its level, and what it detects."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.cross_validation import predictive_p
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from support.series_problem import series_problem, waveform

SERIES, POINTS, PARAMETERS = 4, 15, 3
ROWS = SERIES * POINTS
HELD_OUT = np.repeat([False, False, True, True], POINTS)
FOLDS = [(~HELD_OUT, HELD_OUT)]
PHASE = np.arange(POINTS) / POINTS
PROBLEM = series_problem([waveform(PHASE, 1.0) for _ in range(SERIES)])


def p_value(random, missing=0.0, folds=FOLDS):
    """Of a linear model with its parameters from the prior; missing: a wave in one held-out series, noise sd."""
    jacobian = random.standard_normal((ROWS, PARAMETERS))
    y = jacobian @ random.standard_normal(PARAMETERS) + random.standard_normal(ROWS)
    y[2 * POINTS : 3 * POINTS] += missing * np.sin(2 * np.pi * PHASE)
    return predictive_p(PROBLEM, Linear(np.zeros(PARAMETERS), y, jacobian), folds)


@pytest.mark.long
def test_correct_predictions_are_doubted_no_more_often_than_the_level():
    """In 3000 trials the p-value falls below 0.05 in no more than that share, four standard errors allowed."""
    trials, level, random = 3000, 0.05, generator(11, "test", "foretold")
    share = np.mean([p_value(random) < level for _ in range(trials)])
    error = np.sqrt(level * (1.0 - level) / trials)
    # Three tests of the same residuals share the level, so that the share may be well below it.
    assert 0.3 * level < share < level + 4.0 * error


@pytest.mark.slow
def test_several_folds_keep_the_level():
    """Either half kept out in turn: twice as many tests, the same level."""
    trials, level, random = 1000, 0.05, generator(12, "test", "foretold")
    both = [(~HELD_OUT, HELD_OUT), (HELD_OUT, ~HELD_OUT)]
    share = np.mean([p_value(random, folds=both) < level for _ in range(trials)])
    assert share < level + 4.0 * np.sqrt(level * (1.0 - level) / trials)


def test_a_missing_wave_in_the_held_out_data_is_detected():
    """A sine of 2.5 noise sd over the 15 points of one series of two: 6.8 sd in all, of which a fit takes up little."""
    random = generator(13, "test", "foretold")
    assert np.mean([p_value(random, missing=2.5) < 0.001 for _ in range(200)]) > 0.9
