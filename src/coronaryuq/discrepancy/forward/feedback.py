"""Mean pressures at the beds at which runs settle whose resistances follow those pressures, as under autoregulation."""

import numpy as np

MOST_ROUNDS = 12
SETTLED = 1e-3
"""Relative change of every bed's pressure from one run to the next at which a run counts as settled."""
STEEPEST = 0.9
"""Slope of the pressure that a run has by the one that its beds feel, above which a secant step would leap too far."""


class Feedback:
    """What the beds of many runs feel, round after round; every run goes on by itself, whatever the others do.

    The pressures that a run has are those that its beds feel at a fixed point, which secant steps find, bed by bed.
    resting: pressures of the model as it is, where all begin. responds: (n,), runs whose resistances follow at all;
    the others are done after one round.
    """

    def __init__(self, resting: dict[str, float], responds: list[bool]):
        self.beds, self.responds = list(resting), np.array(responds, dtype=bool)
        self.astray = np.zeros(len(responds), dtype=bool)
        """Runs that have not settled in `MOST_ROUNDS`."""
        self._felt = np.tile(np.array([*resting.values()], dtype=float), (len(responds), 1))
        self._before = np.full((2, *self._felt.shape), np.nan)
        """Of the round before, what was felt and what the run then had."""
        self._rounds = 0

    def felt(self, number: int) -> dict[str, float]:
        """Bed → pressure that a run's beds feel."""
        return dict(zip(self.beds, self._felt[number].tolist(), strict=True))

    def unsettled(self, numbers: np.ndarray, had: np.ndarray) -> np.ndarray:
        """Of runs `numbers` (k,) that had these pressures (k, beds), those that have to be made again."""
        self._rounds += 1
        felt = self._felt[numbers]
        with np.errstate(invalid="ignore"):
            going = self.responds[numbers] & (np.abs(had - felt) > SETTLED * np.abs(felt)).any(axis=1)
        left = numbers[going]
        if self._rounds == MOST_ROUNDS:
            self.astray[left] = True
            return left[:0]
        felt, had = felt[going], had[going]
        earlier, then_had = self._before[0, left], self._before[1, left]
        moved = felt - earlier
        # Of a step much shorter than what counts as settled a slope would be noise.
        known = np.abs(moved) > 0.1 * SETTLED * np.abs(felt)
        slope = np.divide(had - then_had, moved, out=np.zeros_like(felt), where=known)
        slope = np.minimum(slope, STEEPEST)
        self._before[0, left], self._before[1, left] = felt, had
        self._felt[left] = (had - slope * felt) / (1.0 - slope)
        return left
