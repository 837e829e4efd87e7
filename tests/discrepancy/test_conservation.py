"""Two probes off by the same flow in opposite directions are blood that goes elsewhere; any other two are probes."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.selection.flow_conservation import redistribution
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from support.hypotheses import assume

PLACES = {"AORTA:left_main": 2.1, "J0:lad_proximal": 1.4, "lcx:BC_lcx": 0.7, "lad_proximal:J1": 1.4}
GAIN = effect("flow_gain")
SPREAD = GAIN.parameters[0].spread
PRIOR, EFFECTS = -5.0, 20
ACCURACY = 0.02


def odds(gains: dict[str, float]) -> float:
    """Of probes read to an accuracy of 2 % each, with these gains."""
    acting = assume(*((GAIN, place) for place in gains))
    read = np.repeat([flow * (1.0 + gains.get(place, 0.0)) for place, flow in PLACES.items()], 10)
    series = [SimpleNamespace(quantity="flow", location=place) for place in PLACES]
    problem = SimpleNamespace(
        count=0,
        forward=SimpleNamespace(anatomy=Anatomy(left_coronary()), measured=series),
        owner=np.repeat(np.arange(len(PLACES)), 10),
        train=np.ones(len(read), bool),
        y=read,
        sd=np.ones(len(read)),
    )
    z = np.array(list(gains.values())) / SPREAD
    fit = Fit(z, np.zeros(len(read)), np.eye(len(read))[:, : len(z)] * SPREAD / ACCURACY)
    return redistribution(problem, fit, acting, [PRIOR] * len(acting), EFFECTS)


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
def test_other_gains_are_probes(gains):
    assert odds(gains) < 0.0


def test_the_odds_are_those_of_savage_and_dickey():
    """Density of the change of flow at nought, after over before, times the prior of one cause over that of two."""
    flows, free = np.array([1.4, 0.7]), 1.0 / np.sqrt(1.0 + (SPREAD / ACCURACY) ** 2)
    before = SPREAD * np.linalg.norm(flows)
    assert odds({"J0:lad_proximal": 0.2, "lcx:BC_lcx": -0.4}) == pytest.approx(
        np.log(before / (before * free)) + np.log(0.45 / EFFECTS) - 2 * PRIOR
    )
