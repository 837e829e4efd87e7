"""An unlisted response of one device is told from the listed errors of that device by all data."""

from dataclasses import dataclass, replace
from unittest import mock

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

from coronaryuq.adoption.choice import ADOPTED_FROM
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.cross_validation import evidence_of_all, linearise
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES, RIGHT
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.answer import NAMES, UNLISTED, answer
from coronaryuq.discrepancy.selection.unlisted_response import (
    Response,
    devices_of,
    log_prior_of_errors,
    possible_responses,
    shares_of_responses,
    unlisted_responses,
)
from coronaryuq.zerod.effects.library import LIBRARY, effect
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
    return answer(
        problem, evidence_of_all(problem, base, PLAIN), fit, hypothesis, [LISTED] * len(effects), LIBRARY, {}, {}
    )


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
    """By the covariance of all data: noise, nuisance, shapes of the response, and the model's own error.

    Of one effect found and one channel, so that the responses replace that effect, and all have one device.
    """
    problem, hypothesis = recorded(echo(0.06, 0.4)), assume(LOW_PASS)
    fit = problem.calibrate(hypothesis, np.zeros(2))
    model = linearise(problem, fit.z, hypothesis)
    weights = unlisted_responses(problem, model, hypothesis, [LISTED], LIBRARY)
    z, slopes = model.z[:1], model.jacobian[:, :1]
    features = gp_discrepancy.features(problem)
    (residual,) = problem.whitened([(z, PLAIN)])
    densities = []
    for response in possible_responses(problem, residual, LIBRARY):
        spread = np.eye(len(residual)) + slopes @ slopes.T
        spread[np.ix_(response.rows, response.rows)] += response.shapes @ response.shapes.T
        for amplitude, own in zip(AMPLITUDES, RIGHT, strict=True):
            normal = stats.multivariate_normal(np.zeros(len(residual)), spread + amplitude**2 * features @ features.T)
            densities.append(response.log_prior + own + normal.logpdf(residual + slopes @ z))
    # The evidence leaves out the factor of the noise, which all models share.
    constant = 0.5 * len(residual) * np.log(2.0 * np.pi)
    assert list(weights) == [(f"flow at {PLACE}", "")]
    # Responses are compared without the model's own error.
    assert weights[f"flow at {PLACE}", ""] == pytest.approx(logsumexp(densities) + constant, abs=0.5)


def test_sources_are_weighed_by_the_same_evidence_also_where_no_effect_was_found():
    """Of the normal distribution of the data, with the model's own error; of two sources without it."""
    problem = recorded(late(0.0))
    fit = problem.calibrate(PLAIN)
    model, rows = linearise(problem, fit.z, PLAIN), np.arange(2 * POINTS)
    shapes = [np.cos(k * np.linspace(0.0, 9.0, 2 * POINTS))[:, None] for k in (1, 2)]
    sources = [Response("", f"node {k}", rows, own, -3.0) for k, own in enumerate(shapes)]
    weights = unlisted_responses(problem, model, PLAIN, [], [effect("side_branch_leak")], sources)
    assert {signal for _, signal in weights} == {"node 0", "node 1"}
    features, slopes = gp_discrepancy.features(problem), model.jacobian
    for source in sources:
        spread = np.eye(len(rows)) + slopes @ slopes.T + source.shapes @ source.shapes.T
        by_amplitude = [spread + amplitude**2 * features @ features.T for amplitude in AMPLITUDES]
        normal = [stats.multivariate_normal(np.zeros(len(rows)), one).logpdf(model.at_zero) for one in by_amplitude]
        expected = source.log_prior + logsumexp(RIGHT + normal) + 0.5 * len(rows) * np.log(2.0 * np.pi)
        assert weights["", source.signal] == pytest.approx(expected, abs=0.5)


def test_the_priors_of_all_responses_add_up_to_their_share_of_something_else():
    problem = recorded(late(0.0))
    (residual,) = problem.whitened([(np.zeros(1), PLAIN)])
    total = sum(np.exp(one.log_prior) for one in possible_responses(problem, residual, LIBRARY))
    assert total == pytest.approx(RULE.prior_outside * shares_of_responses(LIBRARY)[:2].sum())


def test_a_device_reads_one_channel_or_all_of_a_quantity():
    problem = recorded(late(0.0))
    assert devices_of(problem) == {f"flow at {PLACE}": {("flow", PLACE)}}
    problem.forward.measured[1] = replace(problem.forward.measured[1], location="AORTA:lcx")
    both = {("flow", PLACE), ("flow", "AORTA:lcx")}
    assert devices_of(problem)["every flow"] == both and len(devices_of(problem)) == 3


def test_as_many_causes_outside_the_library_are_responses_of_devices_as_in_it():
    own, other, source = shares_of_responses(LIBRARY)
    assert own == pytest.approx(6 / len(LIBRARY)) and other > 0.0 and source > 0.0
    assert not shares_of_responses([effect("quadratic_stenosis")]).any()


def test_two_errors_of_one_chain_are_as_likely_as_one_unlisted_response():
    problem = recorded(late(0.0))
    response = np.log(RULE.prior_outside * shares_of_responses(LIBRARY)[0])
    pair, apart = assume(LOW_PASS, GAIN, DELAY), assume(LOW_PASS, GAIN)
    assert log_prior_of_errors(problem, pair, [-5.0, -4.0, -6.0], LIBRARY) == pytest.approx(response - 4.0)
    assert log_prior_of_errors(problem, apart, [-5.0, -4.0], LIBRARY) == -9.0, "a gain is no response in time"
    assert log_prior_of_errors(problem, PLAIN, [], LIBRARY) == 0.0


def test_signals_are_without_the_noise_that_a_fit_has_found():
    """The data are the same, and so are their responses, whichever part of them is taken for noise."""
    problem = recorded(low_pass(0.02))
    noise = 5.0 * np.sin(40.0 * np.pi * np.concatenate([PHASE, PHASE]))
    weight = Nuisance("lasting noise", 1.0, shape=0, noise=True)
    own = replace(problem.forward, nuisances=[*problem.forward.nuisances, weight], shapes=noise[None, :])
    problem, hypothesis = Problem(own, problem.settings, problem.train), assume(LOW_PASS)
    models = []
    for found in (0.0, 4.0):
        z = np.array([0.0, found, 0.0])
        (residual,) = problem.whitened([(z, hypothesis)]) - found * noise / problem.sd
        models.append(Linear(z, residual, np.column_stack([0.02 * WAVES, noise, WAVES]) / problem.sd[:, None]))
    gains = []
    for model in models:
        with mock.patch.object(problem, "whitened", lambda rows, model=model: [model.residual] * len(rows)):
            gains.append(unlisted_responses(problem, model, hypothesis, [LISTED], LIBRARY))
    assert gains[0] == pytest.approx(gains[1], rel=1e-6)
