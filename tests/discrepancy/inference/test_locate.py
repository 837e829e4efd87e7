"""Conflicts of nuisance parameters with their prior: the level of the test, what it detects and what it leaves out."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import locate
from support.series_problem import series_problem, waveform

SERIES, POINTS = 3, 12
NUISANCES = [
    Nuisance("first", 0.3),
    Nuisance("second", 0.3),
    Nuisance("unseen", 0.3),
    Nuisance("ringing", 1.0, shape=0),
]

TIME = np.arange(POINTS) / POINTS
PROBLEM = series_problem([waveform(TIME, 1.0, location=f"at {k}") for k in range(SERIES)], NUISANCES)


def located(random, z, gain=2.0):
    """Of a linear problem with these nuisance parameters; the third leaves no trace, the fourth is no parameter."""
    rows = SERIES * POINTS
    g = gain * random.standard_normal((rows, 4)) / np.sqrt(rows) * [1.0, 1.0, 1e-3, 1.0]
    y = g @ z + random.standard_normal(rows)
    found = np.linalg.solve(np.eye(4) + g.T @ g, g.T @ y)
    return locate(PROBLEM, Fit(found, y - g @ found, g))


@pytest.mark.long
def test_parameters_drawn_from_their_prior_conflict_at_the_stated_level():
    """In 3000 trials from the prior the p-value falls below 0.05 in no more than that share, four errors allowed."""
    trials, level, random = 3000, 0.05, generator(5, "test", "strain")
    often = sum(located(random, random.standard_normal(4)).conflicts[0].p < level for _ in range(trials))
    error = np.sqrt(level * (1.0 - level) / trials)
    # Two parameters with Bonferroni's share each: hardly less than the level.
    assert 0.8 * level - 4.0 * error < often / trials < level + 4.0 * error


def test_a_parameter_far_outside_its_prior_is_reported_although_it_fits():
    """Seven standard deviations, seen well: nothing is left in the residuals, so only the prior can tell."""
    found = located(generator(6, "test", "strain"), np.array([7.0, 0.0, 0.0, 0.0]), gain=6.0)
    assert found.conflicts[0].name == "first" and abs(found.conflicts[0].moved - 7.0) < 1.0
    assert found.alarm(0.01) and found.tests["worst nuisance parameter"] < 1e-8


def test_invisible_parameters_and_shape_weights_are_left_out():
    found = located(generator(7, "test", "strain"), np.array([0.0, 0.0, 0.0, 9.0]), gain=6.0)
    assert {conflict.name for conflict in found.conflicts} == {"first", "second"}
