"""Anderson acceleration towards periodic states, of the map from one cycle's start to the next's.

Anderson (1965); Walker & Ni, SIAM J. Numer. Anal. 49 (2011), type II. An accelerated state is an affine combination of
states that the network reached, so that linear constraints and the loop's total blood volume stay as they are.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coronaryuq.core.jit import njit

DEPTH = 5
"""Differences of earlier cycles that a step combines."""

PATIENCE, REST = 6, 8
"""Accelerated cycles in which a sample's least error must halve; else `REST` plain cycles before a fresh start.

Valves open and close between two time steps, so on a coarse grid the map has small jumps. Acceleration may jump back
and forth across one for ever, whereas plain cycles settle on one side.
"""

STALLED = 2
"""Cycles without halving of the cycle error after which a sample is taken for as periodic as its valves allow."""

_LEAST = 1e-5
_RANK = 1e-8
_GROWTH = 3.0

Extrapolate = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Maps samples' numbers (k,), start and end (k, width) of their last cycle to states that are closer to periodic ones
than the end is."""


@dataclass(frozen=True)
class Periodicity:
    """Criterion of periodicity, and the method of reaching it.

    Attributes
    ----------
    tolerance : float
        Cycle error (see `drift`) below which a sample is periodic.
    cycles : int
        Maximum number of cycles.
    patience : int, optional
        A sample fails if its cycle error has not halved within this number of cycles.
    loose : float, optional
        Cycle error below which a sample is taken for periodic once its error has not halved within `STALLED` cycles.
    accelerate : bool
        Use Anderson acceleration; otherwise wait.
    extrapolate : callable, optional
        States that acceleration combines instead of the ends of cycles, see `Extrapolate`.
    """

    tolerance: float = 1e-4
    cycles: int = 100
    patience: int | None = None
    loose: float | None = None
    accelerate: bool = True
    extrapolate: Extrapolate | None = None

    @property
    def accepted(self) -> float:
        """Cycle error below which a sample has not failed."""
        return self.tolerance if self.loose is None else self.loose

    def over(self, error: np.ndarray, waited: np.ndarray) -> np.ndarray:
        """Return which samples (n,) end, by their cycle error and the number of cycles since it last halved."""
        over = error < self.tolerance
        if self.patience is not None:
            over |= waited >= self.patience
        if self.loose is not None:
            over |= (error < self.loose) & (waited >= STALLED)
        return over


def drift(
    before: np.ndarray, after: np.ndarray, low: np.ndarray, high: np.ndarray, kinds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the cycle error of each sample (samples,), and the scale of each unknown (samples, unknowns).

    before, after: unknowns at the cycle's start and end; low, high: their range in between; all (samples, unknowns).
    kinds: number of the quantity of each unknown, from 0, (unknowns,). The error is the largest |after − before| of any
    unknown over its scale: its range, but at least 1e-6 of its size, and `_LEAST` of the largest range of its quantity,
    because a flow into a closed branch is zero but for rounding.
    """
    ranges = high - low
    largest = np.array([ranges[:, kinds == kind].max(axis=1) for kind in range(kinds.max() + 1)]).T
    scale = np.maximum(ranges, 1e-6 * np.maximum(np.abs(low), np.abs(high)))
    scale = np.maximum(scale, _LEAST * largest[:, kinds])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(scale > 0, np.abs(after - before) / scale, 0.0).max(axis=1), scale


class Anderson:
    """Memory of the last cycles of each sample of a batch, from which the next start is proposed.

    extrapolate: gives states nearer to a periodic one than a cycle's end, which are combined instead of the ends.
    """

    def __init__(self, samples: int, width: int, extrapolate: Extrapolate | None = None):
        self._extrapolate = extrapolate
        self._ends = np.zeros((samples, DEPTH + 1, width))
        self._steps = np.zeros((samples, DEPTH + 1, width))
        self._known = np.zeros(samples, dtype=np.int64)
        self._error = np.full(samples, np.inf)
        self._least = np.full(samples, np.inf)
        self._waited = np.zeros(samples, dtype=np.int64)

    def propose(
        self, who: np.ndarray, start: np.ndarray, end: np.ndarray, scale: np.ndarray, error: np.ndarray
    ) -> np.ndarray:
        """Return the next start (k, width) of the samples numbered `who` (k,), from their last cycle.

        start, end: (k, width) whole states; scale: (k, unknowns), of their first `unknowns` columns; error: (k,).
        A sample whose error grew much starts afresh, with a plain cycle.
        """
        aim = end if self._extrapolate is None else self._extrapolate(who, start, end)
        proposed = np.empty_like(end)
        for k, sample in enumerate(who):
            self._waited[sample] += 1
            if error[k] < 0.5 * self._least[sample]:
                self._least[sample], self._waited[sample] = error[k], 0
            if self._waited[sample] > PATIENCE + REST:
                self._least[sample], self._waited[sample], self._known[sample] = error[k], 0, 0
            elif self._waited[sample] > PATIENCE:
                proposed[k] = end[k]
                continue
            if error[k] > _GROWTH * self._error[sample]:
                self._known[sample] = 0
            self._error[sample] = error[k]
            self._known[sample] = _propose(
                self._ends[sample], self._steps[sample], self._known[sample], start[k], aim[k], scale[k], proposed[k]
            )
        return proposed


@njit(cache=True, nogil=True)
def _propose(ends, steps, known, start, end, scale, proposed):
    """Record one cycle, combine the known ones and return their number; plain sums keep the bits reproducible."""
    depth, width = ends.shape
    for k in range(min(known, depth - 1), 0, -1):
        ends[k] = ends[k - 1]
        steps[k] = steps[k - 1]
    for j in range(width):
        ends[0, j] = end[j]
        steps[0, j] = end[j] - start[j]
        proposed[j] = end[j]
    known = min(known + 1, depth)
    columns = known - 1
    size = scale.shape[0]
    basis = np.zeros((columns, size))
    upper = np.zeros((columns, columns))
    right = np.zeros(size)
    for j in range(size):
        right[j] = steps[0, j] / scale[j] if scale[j] > 0.0 else 0.0
    kept = 0
    for c in range(columns):
        for j in range(size):
            basis[c, j] = (steps[c, j] - steps[c + 1, j]) / scale[j] if scale[j] > 0.0 else 0.0
        before = np.sqrt(_dot(basis[c], basis[c]))
        for b in range(kept):
            upper[b, c] = _dot(basis[b], basis[c])
            for j in range(size):
                basis[c, j] -= upper[b, c] * basis[b, j]
        norm = np.sqrt(_dot(basis[c], basis[c]))
        if not norm > _RANK * before:
            break
        upper[c, c] = norm
        for j in range(size):
            basis[c, j] /= norm
        kept += 1
    weights = np.zeros(kept)
    for c in range(kept - 1, -1, -1):
        total = _dot(basis[c], right)
        for b in range(c + 1, kept):
            total -= upper[c, b] * weights[b]
        weights[c] = total / upper[c, c]
    for c in range(kept):
        for j in range(width):
            proposed[j] -= weights[c] * (ends[c, j] - ends[c + 1, j])
    return known


@njit(inline="always")
def _dot(left, right):
    total = 0.0
    for j in range(left.shape[0]):
        total += left[j] * right[j]
    return total
