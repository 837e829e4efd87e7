"""Unlisted pickup: a device that also reads another channel, through a linear response of unknown shape.

A capacitive coupling adds the slope of a pressure to a flow, and crosstalk that grows with frequency adds a part of it;
a compliance and a delay together have nearly the same response. So what the effects found explain, one or all of them,
may equally be one such pickup, which has no more causes than one effect.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.unlisted_response import TIME_SCALES, log_prior_of_errors
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.unlisted_response import late_parts
from coronaryuq.zerod.network.waveforms import CONTENT

POINTS = 512
"""Points of a beat on which the waveform that is picked up is interpolated."""
Signal = dict[str, np.ndarray]
"""Condition → complex amplitudes of a waveform's harmonics."""


@dataclass(frozen=True, eq=False)
class Pickup:
    """What a device would add to its readings of a channel.

    device, signal: the channel it reads, and what it picks up; rows: of the readings (n,); shapes: what a response adds
    to them, with standard normal weights, whitened (n, k).
    """

    device: str
    signal: str
    rows: np.ndarray
    shapes: np.ndarray


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
    pickups = list(possible_pickups(problem))
    weights = defaultdict[tuple[str, str], float](lambda: -np.inf)
    if not (left and pickups and share_of_pickups(possible)):
        return {}
    columns = [_columns(model, hypothesis, kept) for kept in left]
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


def possible_pickups(problem: Problem) -> Iterator[Pickup]:
    """Yield each pickup of a signal that is known wherever the device reads, for each time scale of its response.

    Signals are the other measured waveforms, and those that drive the model. A signal is in units of its own standard
    deviation, and what a device adds in units of that of its readings, both under the device's first condition.
    """
    forward, sd = problem.forward, problem.sd
    signals, channels = defaultdict[str, Signal](dict), defaultdict[str, list[_Read]](list)
    for one, rows in zip(forward.measured, forward.rows, strict=True):
        if one.time is not None:
            name, phase = f"{one.quantity} at {one.location}", one.time / one.period
            signals[name][one.condition] = _harmonics(phase, one.value, one.period)
            channels[name].append(_Read(one.condition, np.arange(rows.start, rows.stop), phase, one.period))
    periods = {read.condition: read.period for each in channels.values() for read in each}
    for name, condition in forward.conditions.items():
        for block, (time, value) in condition.drive.items() if name in periods else ():
            phase = time / (time[-1] - time[0])
            signals[f"drive {block}"][name] = _harmonics(phase, value, periods[name])
    for device, reads in channels.items():
        own, first = np.concatenate([read.rows for read in reads]), reads[0].condition
        size = np.linalg.norm(signals[device][first])
        for signal, known in signals.items():
            if signal == device or any(read.condition not in known for read in reads):
                continue
            spread = np.linalg.norm(known[first])
            for scale in TIME_SCALES if spread > 0.0 else ():
                added = [((read.responses[scale] * known[read.condition]) @ read.waves).real.T for read in reads]
                yield Pickup(device, signal, own, np.concatenate(added) * size / spread / sd[own, None])


def _harmonics(phase: np.ndarray, values: np.ndarray, period: float) -> np.ndarray:
    """Return the complex amplitudes of a waveform's harmonics within `CONTENT`, the first one first."""
    even = np.interp(np.arange(POINTS) / POINTS, phase, values, period=1.0)
    return 2.0 * np.fft.rfft(even)[1 : int(CONTENT * period) + 1] / POINTS


@dataclass(frozen=True, eq=False)
class _Read:
    """Readings of a channel under one condition: their rows (n,), and their phases (n,) of a beat of a period, s."""

    condition: str
    rows: np.ndarray
    phase: np.ndarray
    period: float

    @cached_property
    def _numbers(self) -> np.ndarray:
        return np.arange(1, int(CONTENT * self.period) + 1)

    @cached_property
    def waves(self) -> np.ndarray:
        """Harmonics of unit amplitude: (h, n)."""
        return np.exp(2j * np.pi * np.multiply.outer(self._numbers, self.phase))

    @cached_property
    def responses(self) -> dict[float, np.ndarray]:
        """Time scale → transfer functions (k, h): at once, and with each shape of lags."""
        at_once, frequency = np.ones(len(self._numbers)), (self._numbers / self.period).tobytes()
        return {scale: np.vstack([at_once, late_parts(scale, frequency)]) for scale in TIME_SCALES}


def _columns(model: Linear, hypothesis: Hypothesis, kept: Hypothesis) -> np.ndarray:
    """Return the columns of z without those of the effects that are not kept."""
    gone = [np.r_[hypothesis.columns(model.z, placed)] for placed in hypothesis if placed not in kept]
    return np.delete(np.arange(len(model.z)), np.concatenate(gone))
