"""Unlisted responses: a device that adds to its readings a signal, its own or another, in a way that is not listed.

The delay and the low-pass of one device have together nearly the response of an echo in its line, of a filter with two
poles or of a dispersive line, because any short response is to second order in frequency a delay and a smoothing. A
capacitive coupling adds the slope of a pressure to a flow, and crosstalk that grows with frequency adds a part of it; a
compliance and a delay together have nearly the same response. So what the effects found explain, one or all of them,
may equally be one such response, which has no more causes than one effect.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.nuisance import without_noise
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.zerod.effects.base import Effect, Series
from coronaryuq.zerod.effects.linear_response import amplitudes, picked_up, read_late
from coronaryuq.zerod.effects.measuring_chain import Chain

TIME_SCALES = (0.01, 0.02, 0.05, 0.1, 0.2)
"""Time scales of the lags, s, equally likely: from the filter of a flow probe to a fifth of a beat."""

Channel = tuple[str, str]
"""Quantity and location of waveforms."""
Signal = dict[str, np.ndarray]
"""Condition → complex amplitudes of a waveform's harmonics."""


class Response(NamedTuple):
    """What a device would add to its readings.

    device: what it reads; signal: what it responds to, empty if that is the same; rows: of its readings (n,); shapes:
    what a response adds to them, with standard normal weights, whitened (n, k); log_prior: log of its prior.
    """

    device: str
    signal: str
    rows: np.ndarray
    shapes: np.ndarray
    log_prior: float


class _Read(NamedTuple):
    """Readings of a channel under one condition: rows (n,), and times over the period (n,); period: s."""

    channel: Channel
    condition: str
    rows: np.ndarray
    phase: np.ndarray
    period: float


def shares_of_responses(possible: Sequence[Effect]) -> np.ndarray:
    """Return the prior probabilities that something else is a response to its own or another signal, or a source: (3,).

    The library is the evidence for that: of causes outside it as many are taken to be of these kinds as of those in it,
    errors of `Chain`, readings of other places, and effects that act as a source of flow at a node.
    """
    kinds = [(isinstance(one, Chain), one.reads_elsewhere, one.acts_as_source) for one in possible]
    return np.mean(kinds, axis=0) if kinds else np.zeros(3)


def unlisted_responses(
    problem: Problem, model: Linear, hypothesis: Hypothesis, log_priors: Sequence[float], possible: Sequence[Effect],
    sources: Sequence[Response] = (),
) -> dict[tuple[str, str], float]:  # fmt: skip
    """Return the log weights of unlisted responses and sources, in place of one or more of the effects found, if any.

    The model about the effects found is linear in the weights of a response, whose prior is normal; so its evidence has
    a closed form. All of one kind are compared under the problem's own noise, and the likeliest is weighed under all
    noises and with the model's own error, which hardly change the comparison.

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
    sources
        Unknown sources of flow at nodes.

    Returns
    -------
    dict
        What the device reads, and the signal to which it responds, empty if that is the same, or "" and the node of a
        source → log prior plus log evidence of all data.
    """
    effects = list(hypothesis)
    left = [Hypothesis(kept) for size in range(max(len(effects), 1)) for kept in combinations(effects, size)]
    weights = defaultdict[tuple[str, str], float](lambda: -np.inf)
    columns = [hypothesis.columns_of(model.z, kept) for kept in left]
    rows = [(model.z[own], kept) for own, kept in zip(columns, left, strict=True)]
    residuals = list(problem.whitened(rows))
    for kept, own, residual in zip(left, columns, residuals, strict=True):
        noise = model.z[own] - without_noise(problem.forward.nuisances, model.z[own])
        clean = residual + model.jacobian[:, own] @ noise
        if not np.isfinite(clean).all():
            continue
        without = Linear(model.z[own], residual, model.jacobian[:, own])
        prior = log_prior_of_errors(problem, kept, [log_priors[effects.index(one)] for one in kept], possible)
        for kind in filter(None, (list(possible_responses(problem, clean, possible)), sources)):
            gains = gains_of(without, kind)
            likeliest = int(np.argmax(gains))
            best = kind[likeliest]
            shapes = np.zeros((len(residual), best.shapes.shape[1]))
            shapes[best.rows] = best.shapes
            extended = without.extended(shapes)
            evidence = problem.all_data.evidence(extended.at_zero, extended.jacobian).right - gains[likeliest]
            for response, gain in zip(kind, gains, strict=True):
                pair = response.device, response.signal
                weights[pair] = np.logaddexp(weights[pair], prior + response.log_prior + evidence + gain)
    return dict(weights)


def gains_of(model: Linear, responses: Sequence[Response]) -> np.ndarray:
    """Return by how much each response raises the log evidence of a linear model under the problem's own noise: (n,).

    Parameters
    ----------
    model
        Without a response; parameters and noise are standard normal a priori.
    responses
        Responses.

    Returns
    -------
    ndarray
        Log Bayes factors, nats.
    """
    factor = np.linalg.cholesky(np.eye(len(model.z)) + model.jacobian.T @ model.jacobian)
    explained = np.linalg.solve(factor, model.jacobian.T)
    score = model.at_zero - explained.T @ (explained @ model.at_zero)
    gains = []
    for response in responses:
        within, along = explained[:, response.rows] @ response.shapes, response.shapes.T @ score[response.rows]
        precision = np.eye(len(along)) + response.shapes.T @ response.shapes - within.T @ within
        gains.append(0.5 * (along @ np.linalg.solve(precision, along) - np.linalg.slogdet(precision)[1]))
    return np.array(gains)


def possible_responses(problem: Problem, residual: np.ndarray, possible: Sequence[Effect]) -> Iterator[Response]:
    """Yield each response of each device, for each time scale.

    A device that reads one or more channels may read a part of its own signal late, without an error of the mean. A
    device of one channel may also pick up a signal that is known wherever it reads, in part at once and in part late:
    another one, or its own, whose pulsation it reads by a factor then or, with a lead, early. Signals are the waveforms
    that are measured, without their noise: as the model predicts them; and those that drive the model. Another signal
    is in units of its own standard deviation, and what a device adds of it in units of that of its readings, both under
    the device's first condition.

    residual: of the model without the effects that are replaced and without the noise it has found, whitened (n,).
    """
    own, other, _ = shares_of_responses(possible)
    channels, signals = _waveforms(problem, residual)
    devices = devices_of(problem)
    for device, covered in devices.items() if own else ():
        heard = [one for channel in channels if channel in covered for one in channels[channel]]
        prior = float(np.log(RULE.prior_outside * own / len(devices) / len(TIME_SCALES)))
        rows = np.concatenate([one.rows for one in heard])
        waves = [(signals[_name(one.channel)][one.condition], one) for one in heard]
        for scale in TIME_SCALES:
            late = [read_late(wave, one.phase, one.period, scale) for wave, one in waves]
            yield Response(device, "", rows, np.concatenate(late) / problem.sd[rows, None], prior)
    pairs = [
        (channel, signal)
        for channel, heard in channels.items()
        for signal, known in signals.items()
        if all(one.condition in known for one in heard) and np.linalg.norm(known[heard[0].condition]) > 0.0
    ]
    for channel, signal in pairs if other else ():
        heard, known, device = channels[channel], signals[signal], _name(channel)
        prior = float(np.log(RULE.prior_outside * other / len(pairs) / len(TIME_SCALES)))
        rows, first = np.concatenate([one.rows for one in heard]), heard[0].condition
        unit = np.linalg.norm(signals[device][first]) / np.linalg.norm(known[first]) / problem.sd[rows, None]
        for scale in TIME_SCALES:
            added = [picked_up(known[one.condition], one.phase, one.period, scale) for one in heard]
            yield Response(device, "" if signal == device else signal, rows, np.concatenate(added) * unit, prior)


def _waveforms(problem: Problem, residual: np.ndarray) -> tuple[dict[Channel, list[_Read]], dict[str, Signal]]:
    """Return the readings of each channel, and the signals by their names."""
    predicted = problem.y - residual * problem.sd
    channels, signals = defaultdict[Channel, list[_Read]](list), defaultdict[str, Signal](dict)
    periods = {}
    for series, rows in zip(problem.forward.measured, problem.forward.rows, strict=True):
        if series.time is not None:
            channel, phase = (series.quantity, series.location), series.time / series.period
            channels[channel].append(_Read(channel, series.condition, np.r_[rows], phase, series.period))
            signals[_name(channel)][series.condition] = amplitudes(phase, predicted[rows], series.period)
            periods[series.condition] = series.period
    for name in periods:
        for block, (time, value) in problem.forward.conditions[name].drive.items():
            phase = time[:-1] / (time[-1] - time[0])
            signals[f"drive {block}"][name] = amplitudes(phase, value[:-1], periods[name])
    return channels, signals


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
    total, effects = float(sum(log_priors)), list(hypothesis)
    chain = [placed for placed in effects if isinstance(placed.effect, Chain)]
    devices, (own, *_) = devices_of(problem), shares_of_responses(possible)
    for covered in devices.values() if len(chain) > 1 else ():
        errors = [placed for placed in chain if _covered(problem, placed) == covered]
        if len(errors) > 1:
            listed = sum(_acts_on(problem, effect, covered) for effect in possible)
            total -= sum(log_priors[effects.index(placed)] for placed in errors)
            total += np.log(RULE.prior_outside * own / len(devices)) - np.log(max(comb(listed, len(errors)), 1))
    return total


def devices_of(problem: Problem) -> dict[str, set[Channel]]:
    """Return what each device reads → its channels: each alone, and all of one quantity if there are several."""
    channels = _channels(problem)
    devices = {_name(channel): {channel} for channel in channels}
    every = {f"every {quantity}": {one for one in channels if one[0] == quantity} for quantity, _ in channels}
    return devices | {name: covered for name, covered in every.items() if len(covered) > 1}


def _channels(problem: Problem) -> dict[Channel, Series]:
    """Return the channels with waveforms, each with one of its series."""
    return {(one.quantity, one.location): one for one in problem.forward.measured if one.statistic == "waveform"}


def _name(channel: Channel) -> str:
    return "{} at {}".format(*channel)


def _acts_on(problem: Problem, effect: Effect, covered: set[Channel]) -> bool:
    """Whether an effect of `Chain` is possible on a device."""
    places = effect.places(problem.forward.anatomy, problem.forward.measured) if isinstance(effect, Chain) else []
    return any(_covered(problem, PlacedEffect(effect, place)) == covered for place in places)


def _covered(problem: Problem, placed: PlacedEffect) -> set[Channel]:
    """Return the channels on which an effect of `Chain` acts."""
    effect, place = placed
    return {key for key, one in _channels(problem).items() if isinstance(effect, Chain) and effect.covers(place, one)}
