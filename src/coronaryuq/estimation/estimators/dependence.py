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
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from coronaryuq.estimation.runs.table import Runs, States

SIGNIFICANCE = 1e-3
"""Level of the test for autocorrelation, Bonferroni-corrected over inputs."""
CHANCE = 1e-3
"""Expected number of pairs of independent samples that are taken for near-duplicates."""
FEWEST = 6
"""Fewest segments from which a variance is estimated."""


@dataclass(frozen=True)
class Segments:
    """Segment of each sample (m,), in long segments and in segments a third as long."""

    long: np.ndarray
    short: np.ndarray

    def __getitem__(self, index: np.ndarray) -> "Segments":
        return Segments(self.long[index], self.short[index])


@dataclass(frozen=True)
class Dependence:
    """Segments of pilot and of propagation samples, each None where they are independent of each other.

    groups
        Pilot runs (n,) that must be held out together, by number; None if each stands for itself.
    shared
        Where one chain made all samples: variance of the chain's own mean over the variance of one of its states.
    reason
        How the dependence was found; empty without any.
    """

    pilot: Segments | None = None
    more: Segments | None = None
    groups: np.ndarray | None = None
    shared: float = 0.0
    reason: str = ""


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
    (pilot, pilot_reason), (more, more_reason) = (_in_file(np.log(theta)) for theta in (runs.theta, runs.theta_more))
    reasons = [
        f"{name} inputs {reason}" for name, reason in (("pilot", pilot_reason), ("propagation", more_reason)) if reason
    ]
    return Dependence(pilot, more, None if pilot is None else pilot.long, reason="; ".join(reasons))


def _states(runs: Runs, states: States) -> Dependence:
    """Return the dependence of samples that are states of one chain.

    The pilot is too small for segments of its own: its residuals get the chain's error in proportion, as large as the
    inputs show it on average.
    """
    n, theta = len(runs), np.log(np.vstack([runs.theta, runs.theta_more]))
    segments = _along_chains(states)
    moving = theta[:, np.ptp(theta, axis=0) > 0]
    centred = (moving - moving.mean(axis=0)) / len(moving)
    spread = moving.var(axis=0, ddof=1)
    whole = np.array([variance([(column, segments)])[0] for column in centred.T])
    shared = float(np.mean(np.maximum(0.0, whole / spread - 1 / len(moving)))) if len(spread) else 0.0
    same = np.unique(np.column_stack([states.chain, states.draw])[:n], axis=0, return_inverse=True)[1].ravel()
    groups = same if same.max() + 1 < n else None
    more = segments[np.arange(n, len(theta))] if len(runs.theta_more) else None
    return Dependence(None, more, groups, shared, "states of a chain")


def _along_chains(states: States) -> Segments:
    """Cut each chain into segments of the square root of its draws (Flegal and Jones 2010), by the draws' numbers."""
    distinct, place = np.unique(states.draw, return_inverse=True)
    chain = np.unique(states.chain, return_inverse=True)[1]
    per_chain = max(1, round(len(distinct) ** 0.5))
    reach = (distinct - distinct[0]) / max(1.0, float(np.ptp(distinct)) * (1 + 1e-9))

    def numbered(segments: int) -> np.ndarray:
        return chain * segments + np.floor(reach * segments).astype(int)[place]

    return Segments(numbered(per_chain), numbered(3 * per_chain))


def _in_file(log_theta: np.ndarray) -> tuple[Segments | None, str]:
    """Return the segments of a table (m, d) of inputs without known states, and the reason for them."""
    m = len(log_theta)
    moving = log_theta[:, np.ptp(log_theta, axis=0) > 0] if m > 1 else log_theta[:, :0]
    if m < 2 * FEWEST or not moving.shape[1]:
        return None, ""
    standard = (moving - moving.mean(axis=0)) / moving.std(axis=0)
    if autocorrelated(standard):
        third = max(1, int(np.ceil(np.sqrt(m) / 3)))
        place = np.arange(m)
        return Segments(place // (3 * third), place // third), "are autocorrelated in the order of the file"
    labels = near_duplicates(standard)
    repeated = m - (int(labels.max()) + 1)
    if not repeated:
        return None, ""
    return Segments(labels, labels), f"are repeated or nearly so: {m - repeated} distinct of {m}"


def autocorrelated(values: np.ndarray) -> bool:
    """Return whether any column of `values` (m, d) has a lag-one autocorrelation, by a normal test at SIGNIFICANCE."""
    centred = values - values.mean(axis=0)
    lag_one = np.sum(centred[1:] * centred[:-1], axis=0) / np.sum(centred**2, axis=0)
    p = stats.norm.sf(lag_one * np.sqrt(len(values)))
    return bool(p.min() * values.shape[1] < SIGNIFICANCE)


def near_duplicates(values: np.ndarray) -> np.ndarray:
    """Return a label (m,) for each row of standardised `values` (m, d); rows closer than chance allows share one.

    Among independent normal samples, CHANCE pairs are expected to lie as close in every principal component.
    """
    m = len(values)
    _, scale, axes = np.linalg.svd(values - values.mean(axis=0), full_matrices=False)
    kept = scale > 1e-6 * scale[0]
    whitened = (values @ axes[kept].T) / (scale[kept] / np.sqrt(m))
    radius = np.sqrt(np.pi) * (CHANCE / (m * (m - 1) / 2)) ** (1 / kept.sum())
    pairs = KDTree(whitened).query_pairs(min(radius, 0.1), p=np.inf, output_type="ndarray")
    linked = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(m, m))
    return connected_components(linked, directed=False)[1]
