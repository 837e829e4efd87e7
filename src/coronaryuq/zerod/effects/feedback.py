"""Mean pressures at beds whose resistances depend on those pressures, as under autoregulation."""

import numpy as np

MOST_ROUNDS = 12
SETTLED = 1e-3
"""Relative change of every bed's pressure from one run to the next below which a run is settled."""
STEEPEST = 0.9
"""Largest slope of the resulting pressure by the assumed one in a secant step; a steeper one would overshoot."""


class Feedback:
    """Fixed-point iteration of the bed pressures of many independent runs.

    At the fixed point the pressures that result from a run equal those assumed for its beds; secant steps find it, bed
    by bed. reference: pressures of the unmodified model, where all runs start. responds: (n,), runs whose resistances
    depend on pressure; the others are done after one round.
    """

    def __init__(self, reference: dict[str, float], responds: list[bool]):
        self.beds, self.responds = list(reference), np.array(responds, dtype=bool)
        self.failed = np.zeros(len(responds), dtype=bool)
        """Runs that have not settled in `MOST_ROUNDS`."""
        self._assumed = np.tile(np.array([*reference.values()], dtype=float), (len(responds), 1))
        self._previous = np.full((2, *self._assumed.shape), np.nan)
        """Assumed and resulting pressures of the previous round."""
        self._rounds = 0

    def assumed(self, number: int) -> dict[str, float]:
        """Return bed → assumed pressure of a run."""
        return dict(zip(self.beds, self._assumed[number].tolist(), strict=True))

    def unsettled(self, numbers: np.ndarray, resulting: np.ndarray) -> np.ndarray:
        """Update the assumed pressures of runs (k,) from the resulting ones (k, beds); return the runs to repeat."""
        self._rounds += 1
        assumed = self._assumed[numbers]
        with np.errstate(invalid="ignore"):
            going = self.responds[numbers] & (np.abs(resulting - assumed) > SETTLED * np.abs(assumed)).any(axis=1)
        left = numbers[going]
        if self._rounds == MOST_ROUNDS:
            self.failed[left] = True
            return left[:0]
        assumed, resulting = assumed[going], resulting[going]
        earlier_assumed, earlier_resulting = self._previous[0, left], self._previous[1, left]
        step = assumed - earlier_assumed
        # The slope of a step much shorter than the tolerance would be noise.
        known = np.abs(step) > 0.1 * SETTLED * np.abs(assumed)
        slope = np.divide(resulting - earlier_resulting, step, out=np.zeros_like(assumed), where=known)
        slope = np.minimum(slope, STEEPEST)
        self._previous[0, left], self._previous[1, left] = assumed, resulting
        self._assumed[left] = (resulting - slope * assumed) / (1.0 - slope)
        return left
