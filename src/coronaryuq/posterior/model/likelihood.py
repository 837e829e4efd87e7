"""Gaussian likelihood of target flows with their full covariance (paper, eq. 3)."""

from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError


class Likelihood:
    """log p(f_CT | flows), with f_CT = mean (N,) in mL/s and covariance (N, N)."""

    def __init__(self, mean: np.ndarray, covariance: np.ndarray, source: str | Path = "targets"):
        self.mean = np.asarray(mean, dtype=float)
        self.covariance = np.asarray(covariance, dtype=float)
        try:
            factor = np.linalg.cholesky(self.covariance)
        except np.linalg.LinAlgError:
            least = float(np.linalg.eigvalsh(self.covariance).min())
            raise InputError(
                source, "covariance", least, "smallest eigenvalue is not positive; use more realisations"
            ) from None
        self.whitening = np.linalg.inv(factor)
        self.log_constant = -0.5 * len(self.mean) * np.log(2 * np.pi) - np.sum(np.log(np.diag(factor)))

    def whitened(self, flows: np.ndarray) -> np.ndarray:
        """Return residuals (n, N) in standard deviations, uncorrelated; rows are independent of each other."""
        return np.sum(self.whitening[None] * (flows - self.mean)[:, None, :], axis=2)

    def log_density(self, flows: np.ndarray) -> np.ndarray:
        """Return the log likelihood (n,) of simulated `flows` (n, N)."""
        return self.log_constant - 0.5 * np.sum(self.whitened(flows) ** 2, axis=1)
