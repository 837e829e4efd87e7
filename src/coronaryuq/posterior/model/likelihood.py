"""Gaussian likelihoods of target flows with their full covariance (paper, eq. 3)."""

from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.posterior.results import Chains
from coronaryuq.zerod.network.beds import SCALING


class Likelihood:
    """log p(f_CT | flows), with f_CT = mean (N,) in mL/s and covariance (N, N)."""

    def __init__(self, mean: np.ndarray, covariance: np.ndarray, source: str | Path = "targets"):
        self.mean = np.asarray(mean, dtype=float)
        self.covariance = np.asarray(covariance, dtype=float)
        noise = self._noise()
        try:
            self.factor = np.linalg.cholesky(noise)
        except np.linalg.LinAlgError:
            least = float(np.linalg.eigvalsh(noise).min())
            raise InputError(
                source, "covariance", least, "smallest eigenvalue is not positive; use more realisations"
            ) from None
        self.whitening = np.linalg.inv(self.factor)
        self.log_constant = -0.5 * len(self.mean) * np.log(2 * np.pi) - np.sum(np.log(np.diag(self.factor)))

    def _noise(self) -> np.ndarray:
        return self.covariance

    def whitened(self, flows: np.ndarray, data: np.ndarray | None = None) -> np.ndarray:
        """Return residuals (n, N) in standard deviations, uncorrelated; rows are independent of each other.

        Of `flows` (n, N) from the targets, or from other data (n, N).
        """
        return np.sum(self.whitening[None] * (flows - (self.mean if data is None else data))[:, None, :], axis=2)

    def log_density(self, flows: np.ndarray) -> np.ndarray:
        """Return the log likelihood (n,) of simulated `flows` (n, N)."""
        return self.log_constant - 0.5 * np.sum(self.whitened(flows) ** 2, axis=1)

    def derivative(self, flows: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return the derivatives (N, d) of the residuals at `flows` (N,), whose derivatives are `slope` (N, d)."""
        return self.whitening @ slope

    def gradient(self, flows: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return the gradient (d,) of minus the log likelihood at `flows` (N,) with derivatives `slope` (N, d)."""
        return self.derivative(flows, slope).T @ self.whitened(flows[None])[0]

    def replicated(self, flows: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """Return data (n, N) as they would be measured of `flows` (n, N)."""
        return flows + np.sum(self.factor[None] * random.standard_normal(flows.shape)[:, None, :], axis=2)


class RelativeLikelihood(Likelihood):
    """log p(f_CT | flows) where the noise is in proportion to the flow: f_CT = flows (1 + e), e normal.

    The covariance that a map states is in proportion to what was measured, so that e has the covariance over the outer
    product of the mean. Taken as it is, the noise of a low reading is too small: readings that err low weigh more, and
    an error that all share, the calibration of the map, pulls the fit below all of them (Peelle's pertinent puzzle,
    D'Agostini, Nucl. Instrum. Methods A 346 (1994) 306).
    """

    def _noise(self) -> np.ndarray:
        return self.covariance / np.outer(self.mean, self.mean)

    def whitened(self, flows: np.ndarray, data: np.ndarray | None = None) -> np.ndarray:
        relative = 1.0 - (self.mean if data is None else data) / flows
        return np.sum(self.whitening[None] * relative[:, None, :], axis=2)

    def log_density(self, flows: np.ndarray) -> np.ndarray:
        """Return the log likelihood (n,) of simulated `flows` (n, N); minus infinity unless all are positive."""
        positive = np.all(flows > 0.0, axis=1)
        safe = np.where(positive[:, None], flows, 1.0)
        return np.where(positive, super().log_density(safe) - np.sum(np.log(safe), axis=1), -np.inf)

    def derivative(self, flows: np.ndarray, slope: np.ndarray) -> np.ndarray:
        return self.whitening @ ((self.mean / flows**2)[:, None] * slope)

    def gradient(self, flows: np.ndarray, slope: np.ndarray) -> np.ndarray:
        return super().gradient(flows, slope) + slope.T @ (1.0 / flows)

    def replicated(self, flows: np.ndarray, random: np.random.Generator) -> np.ndarray:
        return flows * (1.0 + np.sum(self.factor[None] * random.standard_normal(flows.shape)[:, None, :], axis=2))


def likelihood_of(chains: Chains) -> Likelihood:
    """Return the likelihood of some chains: relative where they inferred the total, as with `uncertainty: full`."""
    kind = RelativeLikelihood if SCALING in chains.parameter_names else Likelihood
    return kind(chains.target_mean, chains.target_covariance)
