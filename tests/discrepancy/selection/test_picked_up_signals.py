"""A signal that a device picks up is told from the effects that imitate it, by all data."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference.cross_validation import evidence_of_all, linearise
from coronaryuq.discrepancy.selection.answer import NAMES, OTHER, UNLISTED, answer
from coronaryuq.discrepancy.selection.unlisted_response import gains_of, possible_responses
from coronaryuq.zerod.effects.library import LIBRARY
from support.hypotheses import assume
from support.linear_problem import here, linear_problem

POINTS, PERIOD = 60, 0.8
PHASE = np.arange(POINTS) / POINTS
FREQUENCY = np.fft.rfftfreq(POINTS, PERIOD / POINTS)
PRESSURES = [90.0 + 20.0 * np.exp(6.0 * (np.cos(2.0 * np.pi * (PHASE - at)) - 1.0)) for at in (0.3, 0.4)]
FLOWS = [60.0 + 40.0 * np.exp(4.0 * (np.cos(2.0 * np.pi * (PHASE - at)) - 1.0)) for at in (0.6, 0.7)]
LISTED = np.log(RULE.prior_named / len(LIBRARY))
LATE, STORED = here("late"), here("stored")


def slope(wave, time=0.0):
    """The derivative of a wave, per s, through a low-pass."""
    response = 2j * np.pi * FREQUENCY / (1.0 + 2j * np.pi * FREQUENCY * time)
    return np.fft.irfft(np.fft.rfft(wave) * response, POINTS)


RESPONSES = {
    # Sizes of one: a flow 5 ms early, and a compliance by which 3 flow units pass at 100 pressure units per s.
    LATE: np.concatenate([np.zeros(2 * POINTS), *(0.005 * slope(flow) for flow in FLOWS)]),
    STORED: np.concatenate([np.zeros(2 * POINTS), *(0.03 * slope(pressure, 0.05) for pressure in PRESSURES)]),
}


def problem_of(added):
    """A problem of one pressure and one flow under two conditions, with `added` (2 * POINTS,) to the flow and noise."""
    truth = np.concatenate(PRESSURES + FLOWS)
    design = truth[:, None] * 0.05
    y = truth + np.r_[np.zeros(2 * POINTS), added] + generator(0, "test", "pickup").standard_normal(4 * POINTS)
    blocks = np.repeat(["rest", "hyperaemia", "rest flow", "hyperaemia flow"], POINTS)
    problem = linear_problem(design, RESPONSES, y, blocks)
    series = [
        replace(
            one,
            condition=one.condition.removesuffix(" flow"),
            quantity="pressure" if number < 2 else "flow",
            period=PERIOD,
            time=PHASE * PERIOD,
            value=values,
        )
        for number, (one, values) in enumerate(zip(problem.forward.measured, np.split(y, 4), strict=True))
    ]
    problem.forward.measured[:] = series
    absolute = replace(problem, train=problem.train)
    absolute.change[:] = truth
    return absolute


def weighed(problem, *effects):
    hypothesis = assume(*effects)
    base, fit = problem.calibrate(PLAIN), problem.calibrate(hypothesis)
    plain = evidence_of_all(problem, base, PLAIN)
    return answer(problem, plain, fit, hypothesis, [LISTED] * len(effects), LIBRARY, {}, {})


def test_effects_that_imitate_a_picked_up_slope_are_not_believed():
    """The slope of the pressure through a low-pass of 20 ms lies between a compliance and a delay."""
    picked_up = np.concatenate([0.015 * slope(pressure, 0.02) for pressure in PRESSURES])
    weight = weighed(problem_of(picked_up), LATE, STORED)
    assert weight.probabilities[NAMES] < 0.1 and weight.leading_form == UNLISTED
    assert (weight.device, weight.picked_up) == ("flow at AORTA:lad", ["pressure at AORTA:lad"])


@pytest.mark.parametrize("effects", [(LATE,), (STORED,), (LATE, STORED)], ids=["early", "compliance", "both"])
def test_effects_that_are_there_are_named(effects):
    added = 2.0 * sum(RESPONSES[one] for one in effects)[2 * POINTS :]
    weight = weighed(problem_of(added), *effects)
    assert weight.given == NAMES and weight.probabilities[NAMES] > 0.8


def responses_of(problem):
    (residual,) = problem.whitened([(problem.calibrate(PLAIN).z, PLAIN)])
    return list(possible_responses(problem, residual, LIBRARY))


def test_a_gain_is_the_ratio_of_the_densities_of_the_data():
    problem = problem_of(RESPONSES[STORED][2 * POINTS :])
    model = linearise(problem, problem.calibrate(PLAIN).z, PLAIN)
    responses = responses_of(problem)
    assert {(one.device, one.signal) for one in responses} == {
        ("flow at AORTA:lad", "pressure at AORTA:lad"),
        ("flow at AORTA:lad", ""),
        ("pressure at AORTA:lad", "flow at AORTA:lad"),
        ("pressure at AORTA:lad", ""),
    }
    spread = np.eye(4 * POINTS) + model.jacobian @ model.jacobian.T
    for gain, response in zip(gains_of(model, responses), responses, strict=True):
        shapes = np.zeros((4 * POINTS, response.shapes.shape[1]))
        shapes[response.rows] = response.shapes
        densities = [
            stats.multivariate_normal(np.zeros(4 * POINTS), covariance).logpdf(model.at_zero)
            for covariance in (spread + shapes @ shapes.T, spread)
        ]
        assert gain == pytest.approx(densities[0] - densities[1], abs=1e-6)


def test_a_signal_is_picked_up_only_if_it_is_known_wherever_the_device_reads():
    problem = problem_of(np.zeros(2 * POINTS))
    # The pressure at rest only: the flow has no other signal under all its conditions.
    problem.forward.measured[1] = replace(problem.forward.measured[1], location="elsewhere")
    responses = responses_of(problem)
    assert {one.signal for one in responses if one.device == "flow at AORTA:lad"} == {""}
    assert {one.signal for one in responses if one.device == "pressure at AORTA:lad"} == {"", "flow at AORTA:lad"}


def test_a_device_that_reads_its_pulsation_by_a_factor_picks_up_its_own_waveform():
    """Effects that explain it are a gain and an offset of opposite sign."""
    added = np.concatenate([0.2 * (flow - flow.mean()) for flow in FLOWS])
    weight = weighed(problem_of(added), LATE, STORED)
    assert weight.given == OTHER and (weight.device, weight.picked_up) == ("flow at AORTA:lad", [])
