"""The posterior linearised about a state, and the first runs of the model, drawn wider than it."""

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.tissue import PerGram
from coronaryuq.posterior.model.total_resistance import Conditioned

Space = Conditioned | PerGram

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
        centre, derivative = space.linearised(multipliers, flows)
        # r-hat itself, the origin, is inside the prior's bounds.
        while not np.isfinite(space.log_prior(centre[None])[0]):
            centre = 0.9 * centre
        if slope is not None:
            derivative = np.hstack([derivative, flows[:, None] * slope])
        return cls.at(space, likelihood, centre, flows, derivative)

    @classmethod
    def at(
        cls, space: Space, likelihood: Likelihood, centre: np.ndarray, flows: np.ndarray, slope: np.ndarray
    ) -> "Linearised":
        """Linearise at coordinates `centre` (d,), where `flows` (N,) have the derivatives `slope` (N, d)."""
        with threadpool_limits(1):
            by = likelihood.derivative(flows, slope)
            return cls(centre, np.linalg.cholesky(by.T @ by + np.diag(space.prior_precision)))

    def design(self, space: Space, count: int, random: np.random.Generator, width: float = WIDTH) -> np.ndarray:
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


def design_size(dimension: int, quadratic: bool = True) -> int:
    """Return twice the number of an emulator's coefficients."""
    return (dimension + 1) * (dimension + 2) if quadratic else 2 * (dimension + 1)
