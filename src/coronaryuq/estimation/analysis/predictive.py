"""Range of a quantity in the patient: the spread over the states, and the errors of its own ends."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.special import ndtr, ndtri

from coronaryuq.estimation.results import RowReport, Value

STATES, ERRORS = 2000, 200
"""Points by which the distribution over states and that of the errors are represented."""


def with_prediction(row: RowReport) -> RowReport:
    """Return a row with the predictive quantiles of its quantity; unchanged if it has no quantiles."""
    beyond = row.beyond_the_mean
    if not beyond.quantiles:
        return row
    return replace(row, beyond_the_mean=replace(beyond, predictive=predictive(beyond.quantiles)))


def predictive(quantiles: Mapping[str, Value]) -> dict[str, float]:
    """Return the quantiles of a value whose distribution is known only up to errors.

    A state has the value Q(U), U uniform; Q is estimated with a standard error s(U), statistical and numerical, that
    all states share up to its size. The prediction is the distribution of Q(U) + s(U) Z with Z standard normal. A range
    between two estimated quantiles alone holds too little: its ends are off to either side, and what is lost where the
    range is too short outweighs what is won where it is too long.

    Parameters
    ----------
    quantiles
        Share → estimated quantile.

    Returns
    -------
    dict
        Share → predictive quantile, in the unit of the quantity.
    """
    shares = sorted(quantiles, key=float)
    score = ndtri(np.array(shares, float))
    value = np.maximum.accumulate([quantiles[share].value for share in shares])
    error = np.array([quantiles[share].std for share in shares])
    # Midpoints of equal probabilities: normal scores, between which a quantile is linear, as beyond the outermost two.
    states, errors = (ndtri((np.arange(n) + 0.5) / n) for n in (STATES, ERRORS))
    at = _extended(states, score, value)
    spread = np.interp(states, score, error)
    mixed = (at[:, None] + spread[:, None] * errors).ravel()
    found = np.quantile(mixed, ndtr(score))
    return dict(zip(shares, found.tolist(), strict=True))


def _extended(x: np.ndarray, score: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Interpolate linearly, and go on along the outermost two points on either side."""
    inside = np.interp(x, score, value)
    if len(score) < 2:
        return inside
    first, last = (value[1] - value[0]) / (score[1] - score[0]), (value[-1] - value[-2]) / (score[-1] - score[-2])
    below, above = np.minimum(x - score[0], 0.0), np.maximum(x - score[-1], 0.0)
    return inside + first * below + last * above
