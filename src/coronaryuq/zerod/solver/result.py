"""What a run of many samples of one network gave, whichever backend ran them."""

from dataclasses import dataclass

import numpy as np

OK = "ok"


@dataclass
class Result:
    """What a batch of n samples gave.

    values: quantity → (n,), over the last cycle; NaN where a sample failed. waveforms: name → (n, steps + 1) over
    `time` (steps + 1,), the last cycle. status: (n,) of `ok` or a reason. state: (n, unknowns) at the end of the last
    cycle, that is at the start of the next, usable as `start=`. cycles: (n,) spent. cycle_error: (n,), see
    `periodic.drift`.
    refinement: (n,) how many times smaller than asked a sample's steps had to be. solves: Newton solves in all, of
    groups of `LANES` samples.
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
