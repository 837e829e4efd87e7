"""Normal distribution of a fresh draw of many values, from few draws."""

import numpy as np
from scipy.linalg import solve_triangular

FOLDS = 8
"""Parts into which the draws are divided to compare the shares."""
INDEPENDENT = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
"""Shares of the variance at each row that `fresh_draw` compares as independent of all other rows."""


def fresh_draw(draws: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Describe a fresh draw, which comes with the noise, by a normal distribution.

    Draws are fewer than rows, so their covariance leaves out most directions. It is shrunk towards its diagonal, which
    keeps the variance at each row, by the share under which draws are most probable by others (cross-validation; Ledoit
    & Wolf, J. Multivar. Anal. 88 (2004), shrink by another criterion).

    Parameters
    ----------
    draws
        (n, N), n of at least `FOLDS`, in noise standard deviations.

    Returns
    -------
    mean, shapes, sd
        (N,), (n, N) with standard normal weights, and the standard deviation of the independent rest, (N,).
    """
    density = [sum(_log_density(draws, fold, share) for fold in range(FOLDS)) for share in INDEPENDENT]
    return _shrunk(draws, INDEPENDENT[int(np.argmax(density))])


def _shrunk(draws: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count, mean = len(draws), draws.mean(axis=0)
    # The mean of few draws errs as well.
    apart = (draws - mean) * np.sqrt((1.0 + 1.0 / count) / (count - 1))
    return mean, np.sqrt(1.0 - share) * apart, np.sqrt(share * np.sum(apart**2, axis=0))


def _log_density(draws: np.ndarray, fold: int, share: float) -> float:
    """Return the log density of every `FOLDS`-th draw by all others, averaged over the noise, up to a constant."""
    own = np.arange(len(draws)) % FOLDS == fold
    mean, shapes, sd = _shrunk(draws[~own], share)
    width = np.hypot(1.0, sd)
    missing, shapes = (draws[own] - mean) / width, shapes / width
    factor = np.linalg.cholesky(np.eye(len(shapes)) + shapes @ shapes.T)
    explained = [solve_triangular(factor, of, lower=True) for of in (shapes @ missing.T, shapes * (1.0 / width))]
    squares, expected = (
        np.sum(of**2) - np.sum(by**2) for of, by in zip((missing, 1.0 / width), explained, strict=True)
    )
    each = np.log(width).sum() + np.log(np.diag(factor)).sum() + 0.5 * expected
    return float(-own.sum() * each - 0.5 * squares)
