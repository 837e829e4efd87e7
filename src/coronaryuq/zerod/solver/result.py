"""Result of a run of many samples of one network, the same for both solvers."""

from dataclasses import dataclass

import numpy as np

OK = "ok"


@dataclass
class Result:
    """Result of a batch of n samples.

    Attributes
    ----------
    values : dict of str to array (n,)
        Quantities over the last cycle; NaN where a sample failed.
    waveforms : dict of str to array (n, steps + 1)
        Unknowns over the last cycle.
    time : array (steps + 1,)
        Times of the last cycle, s.
    status : array (n,) of str
        `ok` or the reason for a failure.
    state : array (n, columns)
        At the end of the last cycle, that is at the start of the next; usable as `start`.
    cycles : array (n,) of int
        Cycles marched.
    cycle_error : array (n,)
        See `periodic.drift`.
    refinement : array (n,) of int
        Factor by which a sample's time steps had to be refined.
    solves : int
        Newton solves, summed over groups of `LANES` samples.
    """

    values: dict[str, np.ndarray]
    waveforms: dict[str, np.ndarray]
    time: np.ndarray
    status: np.ndarray
    state: np.ndarray
    cycles: np.ndarray
    cycle_error: np.ndarray
    refinement: np.ndarray
    solves: int = 0

    @property
    def ok(self) -> np.ndarray:
        return self.status == OK

    @classmethod
    def blank(cls, samples: int, steps: int, period: float, width: int, quantities, waveforms) -> "Result":
        """Return a result to be filled in: NaN values, no status."""
        return cls(
            values={name: np.full(samples, np.nan) for name in quantities},
            waveforms={name: np.full((samples, steps + 1), np.nan) for name in waveforms},
            time=period * np.arange(steps + 1) / steps,
            status=np.full(samples, "", dtype=object),
            state=np.full((samples, width), np.nan),
            cycles=np.zeros(samples, int),
            cycle_error=np.full(samples, np.inf),
            refinement=np.ones(samples, int),
        )
