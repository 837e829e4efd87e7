"""Evidence averaged over the noises that the scatter of waveforms leaves plausible."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from coronaryuq.discrepancy.inference.flexible import Flexible

if TYPE_CHECKING:
    from coronaryuq.discrepancy.inference.problem import Problem


@dataclass(frozen=True, eq=False)
class PossibleNoise:
    """Noise of all data, beside the one that a problem has.

    Attributes
    ----------
    log_prior
        Up to a constant that all noises of a problem share.
    variance
        Of its independent part less that of the problem's own noise: (N,), CGS.
    shapes
        Of its correlated part, with standard normal weights: (k, N), CGS.
    """

    log_prior: float
    variance: np.ndarray
    shapes: np.ndarray


def averaged_evidence(
    problem: "Problem", at_zero: np.ndarray, jacobian: np.ndarray, features: np.ndarray, blocks: np.ndarray
) -> np.ndarray:
    """Return the log evidence of all data, averaged over the problem's possible noises.

    Parameters
    ----------
    problem
        With `noises`.
    at_zero, jacobian
        Residual (N,) and sensitivities (N, p) of a linear model of all data, whitened by the problem's own noise. The
        columns of that noise's shapes are replaced by those of each possible one.
    features, blocks
        Of the flexible discrepancy (N, k), whitened likewise, and the block of each row (N,); see `Flexible`.

    Returns
    -------
    ndarray
        By amplitude of the flexible discrepancy: (T,), up to the constant of that under the problem's own noise.
    """
    columns, _ = problem.shape_weights()
    lasting = [column for column in columns if not problem.forward.nuisances[column].noise]
    others = np.setdiff1d(np.arange(jacobian.shape[1]), columns)
    log_priors = np.array([noise.log_prior for noise in problem.noises])
    found = []
    for noise in problem.noises:
        sd = np.sqrt(problem.sd**2 + noise.variance)
        ratio = problem.sd / sd
        known = np.hstack([jacobian[:, lasting] * ratio[:, None], (noise.shapes / sd).T])
        flexible = Flexible(features * ratio[:, None], blocks, range(known.shape[1]), known)
        whole = np.hstack([known, jacobian[:, others] * ratio[:, None]])
        posterior = flexible.posterior(at_zero * ratio, whole)
        found.append(posterior.log_evidence + np.log(ratio).sum())
    return logsumexp(np.array(found) + (log_priors - logsumexp(log_priors))[:, None], axis=0)
