"""Unlisted pickup: a device that adds a waveform to its readings, through a linear response of unknown shape.

A capacitive coupling adds the slope of a pressure to a flow, and crosstalk that grows with frequency adds a part of it;
a compliance and a delay together have nearly the same response. So what the effects found explain, one or all of them,
may equally be one such pickup, which has no more causes than one effect. A device that adds of its own waveform reads
pulsation by a factor or, with a lead, early.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.unlisted_response import TIME_SCALES, log_prior_of_errors
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.unlisted_response import amplitudes, picked_up

Signal = dict[str, np.ndarray]
"""Condition → complex amplitudes of a waveform's harmonics."""


@dataclass(frozen=True, eq=False)
class Pickup:
    """What a device would add to its readings of a channel.

    device, signal: the channel it reads, and what it picks up, empty if that is the same; rows: of the readings (n,);
    shapes: what a response adds to them, with standard normal weights, whitened (n, k).
    """

    device: str
    signal: str
    rows: np.ndarray
    shapes: np.ndarray


class _Read(NamedTuple):
    """Readings of a channel under one condition: rows (n,), and times over the period (n,); period: s."""

    condition: str
    rows: np.ndarray
    phase: np.ndarray
    period: float


def share_of_pickups(possible: Sequence[Effect]) -> float:
    """Return the prior probability that something else is a pickup: the library's share of readings of other places."""
    return sum(effect.reads_elsewhere for effect in possible) / max(len(possible), 1)


def unlisted_pickups(
    problem: Problem, model: Linear, hypothesis: Hypothesis, log_priors: Sequence[float], possible: Sequence[Effect]
) -> dict[tuple[str, str], float]:
    """Return the log weight of an unlisted pickup in place of one or more of the effects found.

    All pairs of a device and a signal are equally likely, and so are the time scales of the response. The model about
    the effects found is linear in the weights of the response. All pickups are compared under the problem's own noise,
    and the likeliest is weighed under all noises and with the model's own error, which hardly change the comparison.

    Parameters
    ----------
    problem, model, hypothesis, log_priors, possible
        As in `unlisted_responses`.

    Returns
    -------
    dict
        Channel that the device reads, and the signal that it picks up → log prior plus log evidence of all data.
    """
    effects = list(hypothesis)
    left = [Hypothesis(kept) for size in range(len(effects)) for kept in combinations(effects, size)]
    pickups = list(possible_pickups(problem, model)) if left else []
    weights = defaultdict[tuple[str, str], float](lambda: -np.inf)
    if not (left and pickups and share_of_pickups(possible)):
        return {}
    columns = [hypothesis.columns_of(model.z, kept) for kept in left]
    residuals = problem.whitened([(model.z[own], kept) for own, kept in zip(columns, left, strict=True)])
    for kept, own, residual in zip(left, columns, residuals, strict=True):
        if not np.isfinite(residual).all():
            continue
        without = Linear(model.z[own], residual, model.jacobian[:, own])
        gains = gains_of(without, pickups)
        likeliest = pickups[int(np.argmax(gains))]
        shapes = np.zeros((len(residual), likeliest.shapes.shape[1]))
        shapes[likeliest.rows] = likeliest.shapes
        extended = without.extended(shapes)
        evidence = problem.all_data.evidence(extended.at_zero, extended.jacobian).right
        prior = log_prior_of_errors(problem, kept, [log_priors[effects.index(one)] for one in kept], possible)
        prior += np.log(RULE.prior_outside * share_of_pickups(possible) / len(pickups))
        pair = likeliest.device, likeliest.signal
        weights[pair] = np.logaddexp(weights[pair], prior + evidence + logsumexp(gains - gains.max()))
    return dict(weights)


def gains_of(model: Linear, pickups: Sequence[Pickup]) -> np.ndarray:
    """Return by how much each pickup raises the log evidence of a linear model under the problem's own noise: (n,).

    Parameters
    ----------
    model
        Without a pickup; parameters and noise are standard normal a priori.
    pickups
        Pickups.

    Returns
    -------
    ndarray
        Log Bayes factors, nats.
    """
    factor = np.linalg.cholesky(np.eye(len(model.z)) + model.jacobian.T @ model.jacobian)
    explained = np.linalg.solve(factor, model.jacobian.T)
    score = model.at_zero - explained.T @ (explained @ model.at_zero)
    gains = []
    for pickup in pickups:
        within, along = explained[:, pickup.rows] @ pickup.shapes, pickup.shapes.T @ score[pickup.rows]
        precision = np.eye(len(along)) + pickup.shapes.T @ pickup.shapes - within.T @ within
        gains.append(0.5 * (along @ np.linalg.solve(precision, along) - np.linalg.slogdet(precision)[1]))
    return np.array(gains)


def possible_pickups(problem: Problem, model: Linear) -> Iterator[Pickup]:
    """Yield each pickup of a signal that is known wherever the device reads, for each time scale of its response.

    Signals are the waveforms that are measured, without their noise: as the model predicts them; and those that drive
    the model. A signal is in units of its own standard deviation, and what a device adds in units of that of its
    readings, both under the device's first condition.
    """
    forward, sd = problem.forward, problem.sd
    predicted = problem.y - model.residual * sd
    signals, channels = defaultdict[str, Signal](dict), defaultdict[str, list[_Read]](list)
    for one, rows in zip(forward.measured, forward.rows, strict=True):
        if one.time is not None:
            name, phase = f"{one.quantity} at {one.location}", one.time / one.period
            signals[name][one.condition] = amplitudes(phase, predicted[rows], one.period)
            channels[name].append(_Read(one.condition, np.arange(rows.start, rows.stop), phase, one.period))
    periods = {one.condition: one.period for read in channels.values() for one in read}
    for name, condition in forward.conditions.items():
        for block, (time, value) in condition.drive.items() if name in periods else ():
            signals[f"drive {block}"][name] = amplitudes(time / (time[-1] - time[0]), value, periods[name])
    for device, read in channels.items():
        own, first = np.concatenate([one.rows for one in read]), read[0].condition
        for signal, known in signals.items():
            if any(one.condition not in known for one in read):
                continue
            spread = np.linalg.norm(known[first])
            for scale in TIME_SCALES if spread > 0.0 else ():
                added = [picked_up(known[one.condition], one.phase, one.period, scale) for one in read]
                shapes = np.concatenate(added) * np.linalg.norm(signals[device][first]) / spread / sd[own, None]
                yield Pickup(device, "" if signal == device else signal, own, shapes)
