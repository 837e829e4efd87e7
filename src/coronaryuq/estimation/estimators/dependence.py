"""Variance of a mean whose samples depend on each other: states of a Markov chain, repeated or nearly repeated inputs.

Samples are cut into segments that hardly depend on each other. With S_c the sum of the contributions of segment c to
the estimate, C segments give the variance C / (C − 1) Σ S_c² (batch means). Segments that are not much longer than the
correlation lasts give too little; the lugsail estimator 2 V(b) − V(b / 3), from segments of length b and b / 3, removes
that error to first order and errs on the large side (Vats and Flegal 2022).

Samples of a posterior are states of one chain, pilot and propagation alike. Drawing more of its states does not make
the chain longer: segments of the chain carry that part of the error, because samples from the same stretch of it share
a segment however often it was drawn from.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from coronaryuq.estimation.estimators.folds import assign, assign_groups
from coronaryuq.estimation.estimators.near_duplicates import near_duplicates
from coronaryuq.estimation.runs.table import Runs, States

SIGNIFICANCE = 1e-3
"""Level of the test for autocorrelation, Bonferroni-corrected over inputs."""
LIKELY = 0.05
"""Level for a pilot whose propagation samples are autocorrelated."""
FEWEST = 6
"""Fewest segments from which a variance is estimated."""
MOST = 36
"""Most segments, so that they are long against a correlation however many samples there are.

With a third as many degrees of freedom, Student's quantile is 11 % above the normal one.
"""


@dataclass(frozen=True)
class Segments:
    """Segment of each sample (m,), in long segments and in segments a third as long."""

    long: np.ndarray
    short: np.ndarray

    def __getitem__(self, index: np.ndarray) -> "Segments":
        return Segments(self.long[index], self.short[index])


def joined(segments: Sequence[Segments]) -> Segments:
    """Return the segments of several blocks of samples, one after the other."""
    return Segments(np.concatenate([s.long for s in segments]), np.concatenate([s.short for s in segments]))


@dataclass(frozen=True)
class Dependence:
    """Segments of pilot and of propagation samples, each None where they are independent of each other.

    groups
        Pilot runs (n,) that must be held out together, by number; None if each stands for itself.
    ratio
        Variance of the propagation samples' mean less that of independent ones, over the variance of one sample; where
        the pilot is of a part of the chain only, of those from that part.
    shared
        Pilot and propagation have the error of one chain in common: one chain made both, or the pilot is weighted to
        the propagation samples. No coefficient reduces that error, and it cancels in the difference of two estimates.
    part
        Length of the part of a shared chain that the pilot is of, over that of the chain.
    reason
        How the dependence was found; empty without any.
    """

    pilot: Segments | None = None
    more: Segments | None = None
    groups: np.ndarray | None = None
    ratio: float = 0.0
    shared: bool = False
    part: float = 1.0
    reason: str = ""

    def in_common(self, beta: float) -> float:
        """Return the variance of a coefficient times the control variate over that of its mean over a shared chain.

        The chain's error of the control variate enters with `beta` through the propagation samples and, because the
        pilot is of the same chain, with 1 − beta through the residuals. From a part p of the chain these errors add
        up to 1 − beta (1 − p) times that of the part, which has variance 1 / p; from the rest comes beta (1 − p).
        """
        rest = 1 - self.part
        return ((1 - beta * rest) ** 2 + beta**2 * rest * self.part) / self.part

    def effective(self, n: int) -> float:
        """Return the number of independent runs that say as much as the n pilot runs."""
        distinct = n if self.pilot is None else len(np.unique(self.pilot.long))
        return 1 / (1 / distinct + (self.ratio if self.shared else 0.0))


INDEPENDENT = Dependence()


def variance(contributions: Sequence[tuple[np.ndarray, Segments | None]]) -> tuple[float, float]:
    """Return the variance of a sum of contributions that depend on each other, and its degrees of freedom.

    Parameters
    ----------
    contributions
        Contributions (m,) of mean zero to an estimate, with their segments.

    Returns
    -------
    tuple of float
        Variance and degrees of freedom; (0, inf) without segments.
    """
    parts = [(values, segments) for values, segments in contributions if segments is not None]
    if not parts:
        return 0.0, np.inf
    values = np.concatenate([part for part, _ in parts])
    long = np.unique(np.concatenate([segments.long for _, segments in parts]), return_inverse=True)[1]
    short = np.unique(np.concatenate([segments.short for _, segments in parts]), return_inverse=True)[1]
    count = int(long.max()) + 1
    if count < 2:
        return 0.0, 1.0
    # Var(2 V(b) − V(b / 3)) is three times Var(V(b)) for independent samples: 2 / (6 / C) degrees of freedom.
    return max(0.0, 2 * _batch_means(values, long) - _batch_means(values, short)), max(1.0, count / 3)


def _batch_means(values: np.ndarray, labels: np.ndarray) -> float:
    sums = np.bincount(labels, values)
    return float(len(sums) / (len(sums) - 1) * np.sum(sums**2))


def find(runs: Runs) -> Dependence:
    """Return how the samples of some runs depend on each other.

    Known states of a chain (columns `chain` and `draw`) come first. Otherwise the order within the file is taken for
    that of a chain if the inputs are autocorrelated in it, and repeated or nearly repeated inputs are one segment.
    """
    if runs.states is not None:
        return _states(runs, runs.states)
    more, more_reason = _in_file(runs.coordinates(runs.theta_more), SIGNIFICANCE)
    # Where propagation samples come from a chain, a pilot of the same origin is likely to, and needs less evidence.
    pilot, pilot_reason = _in_file(runs.coordinates(runs.theta), SIGNIFICANCE if more is None else LIKELY)
    reasons = [
        f"{name} inputs {reason}" for name, reason in (("pilot", pilot_reason), ("propagation", more_reason)) if reason
    ]
    ratio = 0.0 if more is None else _ratio(runs.coordinates(runs.theta_more), more)
    return Dependence(pilot, more, None if pilot is None else pilot.long, ratio, reason="; ".join(reasons))


def assign_runs(runs: Runs, folds_wanted: int, seed: int) -> tuple[np.ndarray, Dependence]:
    """Return the fold (n,) of each pilot run, those of one group in one fold, and the dependence of all samples."""
    dependence = find(runs)
    if dependence.groups is None:
        return assign(len(runs), folds_wanted, seed), dependence
    groups = np.unique(dependence.groups, return_inverse=True)[1]
    return assign_groups(groups, min(folds_wanted, int(groups.max()) + 1), seed), dependence


def _states(runs: Runs, states: States) -> Dependence:
    """Return the dependence of samples that are states of one chain.

    The pilot is too small for segments of its own: its residuals get the chain's error in proportion, as large as the
    inputs show it on average, over the part of the chain that the pilot is of.
    """
    n, theta = len(runs), runs.coordinates(np.vstack([runs.theta, runs.theta_more]))
    segments = _along_chains(states)
    same = np.unique(np.column_stack([states.chain, states.draw])[:n], axis=0, return_inverse=True)[1].ravel()
    groups = same if same.max() + 1 < n else None
    more = segments[np.arange(n, len(theta))] if len(runs.theta_more) else None
    part = _part(states.draw, n)
    inside = states.draw - states.draw.min() <= part * np.ptp(states.draw)
    if not inside.all():
        segments = _along_chains(States(states.chain[inside], states.draw[inside]))
    return Dependence(None, more, groups, _ratio(theta[inside], segments), True, part, "states of a chain")


def _part(draw: np.ndarray, n: int) -> float:
    """Return the part of the chain that the first `n` draws are of: the pilot of chains that were made longer later.

    Draws in steps of the golden ratio leave gaps of less than two mean ones.
    """
    stretch, whole = draw[:n].max() - draw.min(), np.ptp(draw)
    return float(min(1.0, stretch / (1 - 2 / n) / whole)) if n > 2 and stretch > 0 else 1.0


def _ratio(theta: np.ndarray, segments: Segments) -> float:
    """Return `Dependence.ratio`, the mean over the inputs (m, d) that move."""
    moving = theta[:, np.ptp(theta, axis=0) > 0]
    if not moving.shape[1]:
        return 0.0
    centred = (moving - moving.mean(axis=0)) / len(moving)
    whole = np.array([variance([(column, segments)])[0] for column in centred.T])
    return float(np.mean(np.maximum(0.0, whole / moving.var(axis=0, ddof=1) - 1 / len(moving))))


def _along_chains(states: States) -> Segments:
    """Cut each chain into segments by the numbers of its draws, some MOST segments of all chains together."""
    distinct, place = np.unique(states.draw, return_inverse=True)
    chain = np.unique(states.chain, return_inverse=True)[1]
    chains = int(chain.max()) + 1
    along = (distinct - distinct[0]) / max(1.0, float(np.ptp(distinct)) * (1 + 1e-9))
    return _cut(along[place], max(1, round(_count(chains * len(distinct)) / chains)), chain)


def _count(samples: int) -> int:
    """Return the number of segments of so many samples: their square root (Flegal and Jones 2010), at most MOST."""
    return min(MOST, int(samples**0.5))


def _cut(along: np.ndarray, segments: int, chain: np.ndarray | int = 0) -> Segments:
    """Return the segments of samples (m,) at places from 0 to 1 along chains of `segments` segments each."""
    long, short = (chain * k + np.floor(along * k).astype(int) for k in (segments, 3 * segments))
    return Segments(long, short)


def _in_file(log_theta: np.ndarray, level: float) -> tuple[Segments | None, str]:
    """Return the segments of a table (m, d) of inputs without known states, and the reason for them."""
    m = len(log_theta)
    moving = log_theta[:, np.ptp(log_theta, axis=0) > 0] if m > 1 else log_theta[:, :0]
    if m < 2 * FEWEST or not moving.shape[1]:
        return None, ""
    standard = moving - moving.mean(axis=0)
    standard /= moving.std(axis=0)  # in place: for a million samples every copy counts
    if autocorrelated(standard, level):
        return _in_order(m), "are autocorrelated in the order of the file"
    labels = near_duplicates(standard)
    repeated = m - (int(labels.max()) + 1)
    if not repeated:
        return None, ""
    return Segments(labels, labels), f"are repeated or nearly so: {m - repeated} distinct of {m}"


def _in_order(m: int) -> Segments:
    return _cut(np.arange(m) / m, _count(m))


def autocorrelated(values: np.ndarray, level: float = SIGNIFICANCE) -> bool:
    """Return whether any column of `values` (m, d) depends on its order, by two tests at `level` together.

    A normal test of the lag-one autocorrelation, and a chi-square test of the variance of segment means. The second one
    also sees chains that are written in turn, whose correlation sets in at a long lag and is small at every single one.
    """
    m, centred = len(values), values - values.mean(axis=0)
    lag_one = np.einsum("ij,ij->j", centred[1:], centred[:-1]) / np.einsum("ij,ij->j", centred, centred)
    segments = _in_order(m).long
    batch = np.array([_batch_means(column / m, segments) for column in centred.T])
    ratio, freedom = batch * m / centred.var(axis=0, ddof=1), int(segments.max())
    p = np.concatenate([stats.norm.sf(lag_one * np.sqrt(m)), stats.chi2.sf(freedom * ratio, freedom)])
    return bool(p.min() * len(p) < level)
