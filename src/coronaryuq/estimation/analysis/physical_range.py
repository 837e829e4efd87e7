"""Quantiles and intervals end where the quantity does: no area below zero, no oscillatory index above one half."""

from dataclasses import replace
from typing import TypeVar

from coronaryuq.estimation.results import EstimatorReport, Interval, RowReport, Value

Ends = TypeVar("Ends", Interval, Value)

RANGES = {
    "ffr_": (0.0, 1.0),
    "lowest_ffr_": (0.0, 1.0),
    "tawss_": (0.0, float("inf")),
    "osi_": (0.0, 0.5),
    "low_shear_area_": (0.0, 1.0),
}
"""Smallest and largest possible value of a 3D quantity, by the beginning of its column."""


def within_range(row: RowReport) -> RowReport:
    """Return a row with quantiles and intervals in the quantity's range; an interval that holds the truth still does.

    An estimated mean above the range extends it: where a vessel widens, pressure that is regained from the speed of the
    blood may bring FFR a little above 1.
    """
    ends = next((ends for start, ends in RANGES.items() if row.column_3d.startswith(start)), None)
    if ends is None:
        return row
    ends = (ends[0], max(ends[1], row.recommended_report.mean))
    beyond = row.beyond_the_mean
    if beyond.quantiles is not None:
        beyond = replace(beyond, quantiles={share: _quantile(value, ends) for share, value in beyond.quantiles.items()})
    if beyond.predictive is not None:
        inside = {share: min(max(value, ends[0]), ends[1]) for share, value in beyond.predictive.items()}
        beyond = replace(beyond, predictive=inside)
    return replace(
        row,
        estimators={name: _report(report, ends) for name, report in row.estimators.items()},
        beyond_the_mean=beyond,
    )


def _report(report: EstimatorReport, ends: tuple[float, float]) -> EstimatorReport:
    names = ("calibrated", "chebyshev_95", "chebyshev_99")
    return replace(report, **{name: _cut(getattr(report, name), ends) for name in names})


def _quantile(found: Value, ends: tuple[float, float]) -> Value:
    return replace(_cut(found, ends), value=min(max(found.value, ends[0]), ends[1]))


def _cut(interval: Ends, ends: tuple[float, float]) -> Ends:
    low, high = (min(max(end, ends[0]), ends[1]) for end in (interval.low, interval.high))
    return replace(interval, low=low, high=high)
