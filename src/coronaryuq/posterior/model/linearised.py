"""The posterior linearised about the fit, and the first runs of the model, drawn wider than it."""

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.total_resistance import Conditioned

WIDTH = 1.5
"""Width of the design over the expected width of the posterior."""


@dataclass(frozen=True)
class Linearised:
    """A Gaussian: centre (d,), and the lower Cholesky factor (d, d) of its precision."""

    centre: np.ndarray
    factor: np.ndarray

    @classmethod
    def about(
        cls, space: Conditioned, likelihood: Likelihood, multipliers: np.ndarray, flows: np.ndarray,
        slope: np.ndarray | None = None,
    ) -> "Linearised":  # fmt: skip
        """Linearise about the fit's `multipliers` and `flows` (N,).

        f_i proportional to g_i, its fraction of conductance, and to exp(slope_i . z), slope (N, k), in the coordinates
        of uncertain parameters. The prior of the multipliers is flat.
        """
        centre, beds = space.coordinates(multipliers[None])[0], space.basis.shape[1]
        # r-hat itself, the origin, is inside the prior's bounds.
        while not np.isfinite(space.log_prior(centre[None])[0]):
            centre = 0.9 * centre
        with threadpool_limits(1):
            by = likelihood.whitening @ ((flows * multipliers)[:, None] * space.basis)
            if slope is not None:
                by = np.hstack([by, likelihood.whitening @ (flows[:, None] * slope)])
            precision = by.T @ by
            precision[range(beds, space.dimension), range(beds, space.dimension)] += 1.0
            return cls(centre, np.linalg.cholesky(precision))

    def design(self, space: Conditioned, count: int, random: np.random.Generator, width: float = WIDTH) -> np.ndarray:
        """Return design points (count, d) inside the prior's bounds: draws of this Gaussian, `width` times as wide."""
        with threadpool_limits(1):
            root = np.linalg.inv(self.factor).T
        points: list[np.ndarray] = []
        while len(points) < count:
            y = self.centre + width * np.sum(root * random.standard_normal(space.dimension), axis=1)
            for _ in range(60):
                if np.isfinite(space.log_prior(y[None])[0]):
                    points.append(y)
                    break
                y = 0.9 * y
        return np.array(points)


def design_size(dimension: int) -> int:
    """Twice the number of an emulator's coefficients."""
    return (dimension + 1) * (dimension + 2)
