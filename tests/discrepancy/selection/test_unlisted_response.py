"""An unlisted response of one device is told from the listed errors of that device by all data."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from coronaryuq.adoption.choice import ADOPTED_FROM
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.cross_validation import evidence_of_all, linearise
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES, RIGHT
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.answer import NAMES, UNLISTED, answer
from coronaryuq.discrepancy.selection.unlisted_response import (
    TIME_SCALES,
    devices_of,
    log_prior_of_errors,
    replaced_by,
    share_of_responses,
    unlisted_responses,
)
from coronaryuq.zerod.effects.library import LIBRARY, effect
from coronaryuq.zerod.effects.unlisted_response import UnlistedResponse
from support.hypotheses import assume, placed
from support.linear_problem import ANATOMY, LinearForward, linear_problem

PLACE, POINTS = "AORTA:lad", 100
CONDITIONS = np.repeat(["rest", "hyperaemia"], POINTS)
PHASE = np.arange(POINTS) / POINTS
WAVE = 60.0 + 40.0 * np.exp(6.0 * (np.cos(2.0 * np.pi * (PHASE - 0.4)) - 1.0))
WAVES = np.concatenate([WAVE, 1.5 * np.roll(WAVE, 10)])
LOW_PASS, DELAY, GAIN = (placed(name, PLACE) for name in ("flow_low_pass", "flow_delay", "flow_gain"))
LISTED = np.log(RULE.prior_named / len(LIBRARY))


@dataclass
class Recorded(LinearForward):
    """Two known waveforms, scaled by one nuisance parameter, as the instruments of each hypothesis read them."""

    def _predicted(self, z, hypothesis):
        blocks = []
        for series, wave in zip(self.measured, np.split(WAVES * (1.0 + 0.02 * z[0]), 2), strict=True):
            read = wave[None, :]
            for (one, place), sizes in zip(hypothesis, hypothesis.physical_sizes(z), strict=True):
                arrays = {name: np.array([size]) for name, size in sizes.items()}
                if one.name == "flow_delay":
                    late = (PHASE - arrays["delay"][0]) % 1.0
                    read = np.interp(late, PHASE, read[0], period=1.0)[None, :]
                elif one.name == "flow_gain":
                    read = read * (1.0 + arrays["gain"][0])
                else:
                    read = one.read(place, arrays, series, read, None, ANATOMY)
            blocks.append(read[0])
        return np.concatenate(blocks)


def recorded(transfer, seed=0):
    """Return a problem with the two waveforms through a response, H at f (k,) in Hz, and noise of one unit."""
    spectra = [np.fft.rfft(wave) * transfer(np.arange(POINTS // 2 + 1)) for wave in np.split(WAVES, 2)]
    y = np.concatenate([np.fft.irfft(spectrum, POINTS) for spectrum in spectra])
    y = y + generator(seed, "test", "unlisted").standard_normal(len(y))
    problem = linear_problem(np.zeros((len(y), 1)), {}, y, CONDITIONS, kind=Problem)
    forward = problem.forward
    own = Recorded(forward.simulation, forward.measured, forward.nuisances, 1.0, design=np.zeros((len(y), 1)))
    return Problem(own, problem.settings, problem.train)


def weighed(problem, *effects):
    hypothesis = assume(*effects)
    start = np.zeros(1 + len(effects))
    base, fit = problem.calibrate(PLAIN), problem.calibrate(hypothesis, start)
    return answer(problem, evidence_of_all(problem, base, PLAIN), fit, hypothesis, [LISTED] * len(effects), LIBRARY, {})


def low_pass(tau):
    return lambda f: 1.0 / (1.0 + 2j * np.pi * f * tau)


def late(delay):
    return lambda f: np.exp(-2j * np.pi * f * delay)


def echo(delay, share):
    return lambda f: (1.0 + share * np.exp(-2j * np.pi * f * delay)) / (1.0 + share)


@pytest.mark.parametrize(
    ("response", "found"),
    [
        (echo(0.06, 0.4), [LOW_PASS, DELAY]),
        (echo(0.1, 0.3), [LOW_PASS, DELAY]),
        (lambda f: 0.6 + 0.4 * low_pass(0.06)(f), [LOW_PASS, DELAY]),
        (lambda f: np.exp(-0.25 * (1.0 + 1.0j) * np.sqrt(f / 10.0)), [LOW_PASS, DELAY]),
    ],
    ids=["echo", "late echo", "a part through a low-pass", "dispersive line"],
)
def test_two_errors_that_imitate_one_unlisted_response_are_not_believed(response, found):
    """The early echo differs least from two errors, and is named at 0.6; campaigns adopt names from 0.8 on."""
    weight = weighed(recorded(response), *found)
    assert weight.probabilities[NAMES] < ADOPTED_FROM and weight.leading_form == UNLISTED
    assert weight.device == f"flow at {PLACE}"


@pytest.mark.parametrize(
    ("response", "found"),
    [
        (late(0.03), [DELAY]),
        (low_pass(0.03), [LOW_PASS]),
        (lambda f: low_pass(0.03)(f) * late(0.03)(f), [LOW_PASS, DELAY]),
        (lambda f: 1.1 * low_pass(0.03)(f), [LOW_PASS, GAIN]),
    ],
    ids=["delay", "low-pass", "low-pass and delay", "low-pass and gain"],
)
def test_true_errors_of_one_device_are_named(response, found):
    assert weighed(recorded(response), *found).given == NAMES


def test_the_evidence_is_that_of_the_normal_distribution_of_the_data():
    """By the covariance of all data: noise, nuisance, shapes of the response, and the model's own error."""
    problem, hypothesis = recorded(echo(0.06, 0.4)), assume(LOW_PASS, DELAY, GAIN)
    fit = problem.calibrate(hypothesis, np.zeros(4))
    model, priors = linearise(problem, fit.z, hypothesis), [LISTED - 1.0, LISTED - 2.0, LISTED]
    (weight,) = unlisted_responses(problem, model, hypothesis, priors, LIBRARY).values()
    kept = hypothesis.without(LOW_PASS).without(DELAY)
    z, slopes = np.delete(model.z, [1, 2]), np.delete(model.jacobian, [1, 2], axis=1)
    features = gp_discrepancy.features(problem)
    (residual,) = problem.whitened([(z, kept)])
    densities = []
    for scale in TIME_SCALES:
        device = placed(UnlistedResponse("flow", scale), PLACE)
        units = np.eye(len(device.effect.parameters))
        moved = problem.whitened([(np.append(z, unit), kept.with_(device)) for unit in units])
        shapes = residual - moved
        for amplitude, own in zip(AMPLITUDES, RIGHT, strict=True):
            spread = np.eye(len(residual)) + slopes @ slopes.T + shapes.T @ shapes
            spread += amplitude**2 * features @ features.T
            normal = stats.multivariate_normal(np.zeros(len(residual)), spread)
            densities.append(own + normal.logpdf(residual + slopes @ z) - np.log(len(TIME_SCALES)))
    prior = LISTED + np.log(RULE.prior_outside * share_of_responses(LIBRARY) / len(devices_of(problem)))
    # The evidence leaves out the factor of the noise, which all models share.
    constant = 0.5 * len(residual) * np.log(2.0 * np.pi)
    assert weight == pytest.approx(prior + logsumexp(densities) + constant, abs=1e-5)


def test_a_response_replaces_the_errors_of_its_own_device_only():
    problem, (device,) = recorded(late(0.0)), devices_of(recorded(late(0.0)))
    elsewhere, every = placed("flow_delay", "AORTA:lcx"), placed("flow_low_pass", "every flow")
    hypothesis = assume(LOW_PASS, GAIN, DELAY, placed("quadratic_stenosis", "lad"))
    assert replaced_by(problem, device, hypothesis) == [LOW_PASS, DELAY]
    assert unlisted_responses(problem, None, assume(GAIN), [0.0], LIBRARY) == {}
    assert every in replaced_by(problem, device, assume(every)), "the only flow"
    assert elsewhere.effect is effect("flow_delay")


def test_as_many_causes_outside_the_library_are_responses_of_devices_as_in_it():
    assert share_of_responses(LIBRARY) == pytest.approx(6 / len(LIBRARY))
    assert share_of_responses([effect("quadratic_stenosis")]) == 0.0


def test_two_errors_of_one_chain_are_as_likely_as_one_unlisted_response():
    problem = recorded(late(0.0))
    response = np.log(RULE.prior_outside * share_of_responses(LIBRARY))
    pair, apart = assume(LOW_PASS, GAIN, DELAY), assume(LOW_PASS, GAIN)
    assert log_prior_of_errors(problem, pair, [-5.0, -4.0, -6.0], LIBRARY) == pytest.approx(response - 4.0)
    assert log_prior_of_errors(problem, apart, [-5.0, -4.0], LIBRARY) == -9.0, "a gain is no response in time"
    assert log_prior_of_errors(problem, PLAIN, [], LIBRARY) == 0.0
