"""What would change the conclusion on a lesion, or settle one that is open, the most important first."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import ndtri

from coronaryuq.estimation.results import NUMERICAL, STATISTICAL, EstimatorReport, Probability, RowReport
from coronaryuq.report.error_budget import WORDS
from coronaryuq.report.improve import improve_first, numerical_share
from coronaryuq.report.quantities import FFR_DECIMALS

LIKELY = 0.9
"""Probability, over its whole interval, above which the page states a verdict."""
LEAST = 0.005
"""Smallest shift of FFR that is not zero in two decimals."""


def what_would_change(row: RowReport, zones: Sequence[Probability], driver: Mapping[str, str] | None) -> list[str]:
    """Return lines on what could change the conclusion on a lesion; none without a distribution of FFR.

    Parameters
    ----------
    row
        Row of FFR at the lesion.
    zones
        Probabilities of FFR, in rising order.
    driver
        `name` and `share` of the input that explains most of the variance of FFR, None if none was found.
    """
    quantiles = row.beyond_the_mean.predictive or {}
    limit = zones[-1].above if zones else None
    if limit is None or not {"0.05", "0.50", "0.95"} <= set(quantiles):
        return []
    words, margin = _shift(quantiles, zones[-1].complement, limit)
    lines = [words]
    estimate = row.recommended_report
    if improve := improve_first(row.beyond_the_mean.by_source or {}, numerical_share(estimate, row.variance_of_states)):
        lines.append(improve)
    elif driver:
        lines.append(f"Knowing {driver['name']} would narrow the range most: {driver['share']} of its variance.")
    return [*lines, _numerics(estimate, margin)]


def verdict_of(below: Probability) -> bool | None:
    """Return whether a stenosis limits flow, given the probability of FFR at or below the limit; None if it is open."""
    if below.low > LIKELY:
        return True
    return False if below.high < 1 - LIKELY else None


def _shift(quantiles: Mapping[str, float], below: Probability, limit: float) -> tuple[str, float]:
    """Return in words which shift of FFR in every state changes the conclusion, and its size."""
    low, median, high = (_quantile(quantiles, share) for share in (1 - LIKELY, 0.5, LIKELY))
    limits = verdict_of(below)
    if limits is None:
        up, down = max(limit - low, 0.0), max(high - limit, 0.0)
        lower = f"FFR {_by('lower', down)} in every state would make it very likely flow-limiting."
        if median + up > 1.0:  # no lumen has an FFR above 1
            return lower, down
        higher = f"FFR {_by('higher', up)} in every state, as with a lumen drawn too narrow, would make it very likely "
        return f"{higher}not flow-limiting. {lower}", min(up, down)
    side, drawn, margin = ("higher", "narrow", limit - high) if limits else ("lower", "wide", low - limit)
    return (
        f"If FFR were {_by(side, margin)} in every state, for instance because the lumen was drawn too {drawn}, "
        f"it would be undecided; by {abs(median - limit):.2f}, the median would lie at {limit:.2f}."
    ), max(margin, 0.0)


def _by(side: str, shift: float) -> str:
    return f"{side} by about {shift:.2f}" if shift >= LEAST else f"a little {side}"


def _quantile(quantiles: Mapping[str, float], share: float) -> float:
    """Return a quantile of FFR, between the estimated ones on a straight line over those of a normal distribution."""
    known = sorted((float(name), value) for name, value in quantiles.items())
    return float(np.interp(ndtri(share), ndtri([name for name, _ in known]), [value for _, value in known]))


def _numerics(estimate: EstimatorReport, margin: float) -> str:
    """Return whether more runs, or a finer mesh, could move FFR by as much as would change the conclusion."""
    reach = estimate.calibrated.half_width
    numerical = sum(estimate.variance.get(name, 0.0) for name in NUMERICAL)
    statistical = sum(estimate.variance.get(name, 0.0) for name in STATISTICAL)
    better = "A finer mesh and shorter time steps" if numerical > statistical else "More simulations"
    if reach < margin:
        better = "Neither more simulations nor a finer mesh" if numerical else "More simulations"
        words = f"{better} {'would' if numerical else 'would not'} decide it: the numerical error of the mean is "
    else:
        words = f"{better} could decide it: the numerical error of the mean, mostly of {_mostly(estimate)}, is "
    return f"{words}± {reach:.{FFR_DECIMALS}f}."


def _mostly(estimate: EstimatorReport) -> str:
    return WORDS[max(estimate.variance, key=lambda name: estimate.variance[name])]
