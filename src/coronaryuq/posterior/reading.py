"""What a perfusion map is expected to read of the flow of a bed whose territory is drawn with wrong borders."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Reading:
    """Expectation of b, given resistances. gain (N, N), centre (N,): G and log(w / a) of `posterior.model.tissue`."""

    gain: np.ndarray
    centre: np.ndarray

    @classmethod
    def of_the_flow(cls, beds: int) -> "Reading":
        """Return the reading that is the flow itself."""
        return cls(np.zeros((beds, beds)), np.zeros(beds))

    def over_flow(self, multipliers: np.ndarray) -> np.ndarray:
        """Return the factors (n, N) on the flows at multipliers m (n, N), the common factor s included."""
        return np.exp(np.sum((np.log(multipliers) - self.centre)[:, None, :] * self.gain[None], axis=2))
