"""Nuisance parameters against their prior: the level of the test, what it sees, and what it leaves out."""

from types import SimpleNamespace

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import locate

SERIES, POINTS = 3, 12
NUISANCES = [
    Nuisance("first", 0.3),
    Nuisance("second", 0.3),
    Nuisance("unseen", 0.3),
    Nuisance("ringing", 1.0, shape=0),
]


def located(random, z, gain=2.0):
    """Of a linear problem with these nuisance parameters; the third leaves no trace, the fourth is no parameter."""
    rows = SERIES * POINTS
    g = gain * random.standard_normal((rows, 4)) / np.sqrt(rows) * [1.0, 1.0, 1e-3, 1.0]
    y = g @ z + random.standard_normal(rows)
    found = np.linalg.solve(np.eye(4) + g.T @ g, g.T @ y)
    series = [
        SimpleNamespace(
            value=np.zeros(POINTS),
            time=np.arange(POINTS) / POINTS,
            period=1.0,
            quantity="flow",
            location=f"at {k}",
            statistic="waveform",
            condition="rest",
        )
        for k in range(SERIES)
    ]
    problem = SimpleNamespace(
        count=4,
        sd=np.ones(rows),
        train=np.ones(rows, bool),
        owner=np.repeat(np.arange(SERIES), POINTS),
        forward=SimpleNamespace(measured=series, nuisances=NUISANCES),
    )
    return locate(problem, Fit(found, y - g @ found, g))


def test_a_parameter_drawn_from_its_prior_conflicts_as_often_as_said():
    """In 3000 trials from the prior the p-value falls below 0.05 in no more than that share, four errors allowed."""
    trials, level, random = 3000, 0.05, generator(5, "test", "strain")
    often = sum(located(random, random.standard_normal(4)).strains[0].p < level for _ in range(trials))
    error = np.sqrt(level * (1.0 - level) / trials)
    # Two parameters with Bonferroni's share each: hardly less than the level.
    assert 0.8 * level - 4.0 * error < often / trials < level + 4.0 * error


def test_a_parameter_far_out_of_its_prior_is_named_though_it_fits():
    """Seven standard deviations, seen well: nothing is left in the residuals, so only the prior can tell."""
    found = located(generator(6, "test", "strain"), np.array([7.0, 0.0, 0.0, 0.0]), gain=6.0)
    assert found.strains[0].name == "first" and abs(found.strains[0].moved - 7.0) < 1.0
    assert found.alarm(0.01) and found.tests["worst nuisance parameter"] < 1e-8


def test_what_no_data_see_and_what_is_no_parameter_are_left_out():
    found = located(generator(7, "test", "strain"), np.array([0.0, 0.0, 0.0, 9.0]), gain=6.0)
    assert {one.name for one in found.strains} == {"first", "second"}
