"""Errors of two flow probes by the same flow in opposite directions are blood on another path; others are not."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.flow_conservation import redistribution
from coronaryuq.zerod.effects.library import effect
from support.hypotheses import assume
from support.series_problem import series_problem, waveform

PLACES = {"AORTA:left_main": 2.1, "J0:lad_proximal": 1.4, "lcx:BC_lcx": 0.7, "lad_proximal:J1": 1.4}
GAIN = effect("flow_gain")
SPREAD = GAIN.parameters[0].spread
PRIOR, EFFECTS = -5.0, 20
ACCURACY = 0.02


def odds(gains: dict[str, float]) -> float:
    """Of probes read to an accuracy of 2 % each, with these gains."""
    hypothesis = assume(*((GAIN, place) for place in gains))
    read = np.repeat([flow * (1.0 + gains.get(place, 0.0)) for place, flow in PLACES.items()], 10)
    time = np.arange(10) / 10
    problem = series_problem([replace(waveform(time, 1.0, location=place), value=np.full(10, 1.0)) for place in PLACES])
    problem.y = read
    z = np.array(list(gains.values())) / SPREAD
    fit = Fit(z, np.zeros(len(read)), np.eye(len(read))[:, : len(z)] * SPREAD / ACCURACY)
    return redistribution(problem, fit, hypothesis, [PRIOR] * len(hypothesis), EFFECTS)


def test_gains_that_cancel_are_a_redistribution():
    assert odds({"J0:lad_proximal": 0.2, "lcx:BC_lcx": -0.4}) > 0.0


@pytest.mark.parametrize(
    "gains",
    [
        {"J0:lad_proximal": 0.3, "lcx:BC_lcx": 0.4},
        {"J0:lad_proximal": 0.3, "lcx:BC_lcx": -0.1},
        {"lcx:BC_lcx": -0.4},
        {"AORTA:left_main": 0.2, "J0:lad_proximal": -0.3},
        {"J0:lad_proximal": 0.2, "lad_proximal:J1": -0.2},
        {"lad_proximal:J1": -0.2, "J0:lad_proximal": 0.2},
    ],
    ids=["same sign", "other size", "one", "one behind the other", "ends of one vessel", "those the other way"],
)
def test_other_gains_are_errors_of_probes(gains):
    assert odds(gains) < 0.0


def test_the_odds_are_those_of_savage_and_dickey():
    """Density of the change of flow at zero, posterior over prior, times the prior of one cause over that of two."""
    flows, free = np.array([1.4, 0.7]), 1.0 / np.sqrt(1.0 + (SPREAD / ACCURACY) ** 2)
    before = SPREAD * np.linalg.norm(flows)
    assert odds({"J0:lad_proximal": 0.2, "lcx:BC_lcx": -0.4}) == pytest.approx(
        np.log(before / (before * free)) + np.log(RULE.prior_named / EFFECTS) - 2 * PRIOR
    )
