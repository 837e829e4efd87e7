"""Unlisted response: one linear response of a device, of unknown shape, in place of the listed errors found on it.

The delay and the low-pass of one device have together nearly the response of an echo in its line, of a filter with two
poles or of a dispersive line, because any short response is to second order in frequency a delay and a smoothing. If
the response of a chain is not that of a single listed error, two listed ones are taken to be as likely as one unlisted
response: both are faults of the same chain.
"""

from collections.abc import Sequence
from math import comb

import numpy as np
from scipy.special import logsumexp

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.measuring_chain import Chain
from coronaryuq.zerod.effects.unlisted_response import UnlistedResponse

TIME_SCALES = (0.01, 0.02, 0.05, 0.1, 0.2)
"""Time scales of the lags, s, equally likely: from the filter of a flow probe to a fifth of a beat."""
QUANTITIES = ("pressure", "flow")


def share_of_responses(possible: Sequence[Effect]) -> float:
    """Return the prior probability that something else is a linear response of one device.

    The library is the evidence for that: of causes outside it as many are taken to be of this kind as of those in it.
    """
    return sum(isinstance(effect, Chain) for effect in possible) / max(len(possible), 1)


def unlisted_responses(
    problem: Problem, model: Linear, hypothesis: Hypothesis, log_priors: Sequence[float], possible: Sequence[Effect]
) -> dict[str, float]:
    """Return the log weight of an unlisted response of each device, in place of the effects of `Chain` found there.

    The model about the effects found is linear in the weights of the response's shapes, whose prior is normal, so that
    its evidence has a closed form; it is averaged over the time scales of the response. All devices are equally likely.

    Parameters
    ----------
    problem, hypothesis
        The model with the effects found.
    model
        That model linearised at its fit, for all data.
    log_priors
        Log prior of each effect of the hypothesis.
    possible
        Effects of the library that are possible here.

    Returns
    -------
    dict
        What the device reads → log prior plus log evidence of all data; only devices with such effects.
    """
    weights = {}
    for device in devices_of(problem) if _any(hypothesis) else ():
        replaced = replaced_by(problem, device, hypothesis)
        if replaced:
            kept = Hypothesis(tuple(placed for placed in hypothesis if placed not in replaced))
            own = [log_priors[hypothesis.effects.index(placed)] for placed in kept]
            prior = log_prior_of_errors(problem, kept, own, possible) + _log_prior(problem, possible)
            weights[_reads(device)] = prior + _evidence(problem, model, hypothesis, device, kept)
    return weights


def log_prior_of_errors(
    problem: Problem, hypothesis: Hypothesis, log_priors: Sequence[float], possible: Sequence[Effect]
) -> float:
    """Return the log prior of a set of effects, of which several may be errors of one chain.

    Effects are independent, but for several of `Chain` on one device: all pairs of them are together as likely as an
    unlisted response of the device, and so are all triples.

    Parameters
    ----------
    problem, hypothesis, log_priors, possible
        As in `unlisted_responses`.

    Returns
    -------
    float
        Log prior.
    """
    total = float(sum(log_priors))
    for device in devices_of(problem) if _any(hypothesis) else ():
        waveforms = _waveforms(problem, device)
        errors = [placed for placed in hypothesis if _waveforms(problem, placed) == waveforms]
        if len(errors) > 1:
            listed = sum(_acts_on(problem, effect, device) for effect in possible)
            total -= sum(log_priors[hypothesis.effects.index(placed)] for placed in errors)
            total += _log_prior(problem, possible) - np.log(max(comb(listed, len(errors)), 1))
    return total


def _any(hypothesis: Hypothesis) -> bool:
    return any(isinstance(placed.effect, Chain) for placed in hypothesis)


def _log_prior(problem: Problem, possible: Sequence[Effect]) -> float:
    """Return the log prior of an unlisted response of one device."""
    return float(np.log(RULE.prior_outside * share_of_responses(possible) / len(devices_of(problem))))


def _acts_on(problem: Problem, effect: Effect, device: PlacedEffect) -> bool:
    """Whether an effect of `Chain` is possible on a device."""
    forward = problem.forward
    here = device.place in effect.places(forward.anatomy, forward.measured)
    return here and _waveforms(problem, PlacedEffect(effect, device.place)) == _waveforms(problem, device)


def devices_of(problem: Problem) -> list[PlacedEffect]:
    """Return each device that reads waveforms, as an unlisted response at its place."""
    forward = problem.forward
    responses = (UnlistedResponse(quantity, TIME_SCALES[0]) for quantity in QUANTITIES)
    return [
        PlacedEffect(response, place)
        for response in responses
        for place in response.places(forward.anatomy, forward.measured)
    ]


def replaced_by(problem: Problem, device: PlacedEffect, hypothesis: Hypothesis) -> list[PlacedEffect]:
    """Return the effects of `Chain` that act on waveforms of this device only."""
    own = _waveforms(problem, device)
    return [placed for placed in hypothesis if isinstance(placed.effect, Chain) and _waveforms(problem, placed) <= own]


def _reads(device: PlacedEffect) -> str:
    (quantity,) = device.effect.quantities  # type: ignore[attr-defined]
    return device.place if device.place.startswith("every") else f"{quantity} at {device.place}"


def _waveforms(problem: Problem, placed: PlacedEffect) -> set[tuple[str, str]]:
    effect = placed.effect
    return {
        (series.quantity, series.location)
        for series in problem.forward.measured
        if series.statistic == "waveform" and isinstance(effect, Chain) and effect.covers(placed.place, series)
    }


def _evidence(problem: Problem, model: Linear, hypothesis: Hypothesis, device: PlacedEffect, kept: Hypothesis) -> float:
    """Return the log evidence of all data of a right model with this device's response, averaged over time scales.

    kept: effects of the hypothesis that the response does not replace.
    """
    columns = hypothesis.columns_of(model.z, kept)
    z, slopes = model.z[columns], model.jacobian[:, columns]
    (quantity,) = device.effect.quantities  # type: ignore[attr-defined]
    responses = [PlacedEffect(UnlistedResponse(quantity, scale), device.place) for scale in TIME_SCALES]
    units = np.eye(len(device.effect.parameters))
    rows = [(np.concatenate([z, unit]), kept.with_(response)) for response in responses for unit in units]
    residual, *moved = problem.whitened([(z, kept), *rows])
    shapes = (residual - np.array(moved)).reshape(len(responses), len(units), -1)
    without = Linear(z, residual, slopes)
    each = [without.extended(own.T) for own in shapes]
    found = [problem.all_data.evidence(one.at_zero, one.jacobian).right for one in each]
    return float(logsumexp(found)) - np.log(len(found))
