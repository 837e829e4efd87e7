"""Numerical error of the 3D runs in the estimates: corrected outputs, and their uncertainty in every interval."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pandas as pd
from scipy.special import ndtri

from coronaryuq.estimation.estimators.formulas import chebyshev
from coronaryuq.estimation.results import BeyondTheMean, EstimatorReport, Interval, Probability, RowReport, Value
from coronaryuq.estimation.runs.table import Runs
from coronaryuq.flow3d.numerical_error import NumericalError

Errors = Mapping[str, Sequence[NumericalError]]
"""3D quantity → its errors by mesh, time step and cycles."""

Estimated = TypeVar("Estimated", Value, Probability)


def corrected(runs: Runs, errors: Errors) -> Runs:
    """Return the runs with the correction of every 3D quantity added to its outputs.

    A coarse 3D level keeps its outputs: estimators take only differences to it.
    """
    shift = pd.Series({name: _correction(errors, name) for name in runs.y.columns})
    return replace(runs, y=runs.y + shift)


def with_numerical_error(row: RowReport, errors: Errors) -> RowReport:
    """Return a row of corrected runs whose standard errors and intervals include the numerical error.

    Half-widths are added in squares. Quantiles move as the mean does; a zone's probability moves by the distribution
    function at its limits, which is taken to be linear between the estimated quantiles.
    """
    if row.column_3d not in errors:
        return row
    sources: dict[str, float] = {error.source: error.std**2 for error in errors[row.column_3d]}
    extra = sum(sources.values())
    return replace(
        row,
        estimators={name: _wider(report, sources) for name, report in row.estimators.items()},
        beyond_the_mean=_beyond(row.beyond_the_mean, extra**0.5),
        numerical_correction=_correction(errors, row.column_3d),
    )


def _correction(errors: Errors, name: str) -> float:
    return float(sum(error.correction for error in errors.get(name, ())))


def _wider(report: EstimatorReport, sources: Mapping[str, float]) -> EstimatorReport:
    extra = sum(sources.values())
    variance = report.std**2 + extra
    calibrated = report.calibrated
    half = (calibrated.half_width**2 + _normal(calibrated.level) ** 2 * extra) ** 0.5
    return replace(
        report,
        std=variance**0.5,
        chebyshev_95=chebyshev(report.mean, variance, 0.95),
        chebyshev_99=chebyshev(report.mean, variance, 0.99),
        calibrated=Interval(report.mean - half, report.mean + half, calibrated.level),
        variance={**report.variance, **sources},
    )


def _beyond(found: BeyondTheMean, std: float) -> BeyondTheMean:
    quantiles = found.quantiles
    if quantiles is not None:
        quantiles = {share: _widened(value, std) for share, value in quantiles.items()}
    zones = found.zones
    if zones is not None and found.quantiles:
        moved = _mover(found.quantiles, std)
        zones = [_bounded(_widened(zone, moved(zone.at_most) - moved(zone.above))) for zone in zones]
    return replace(found, quantiles=quantiles, zones=zones)


def _mover(quantiles: Mapping[str, Value], std: float) -> Callable[[float | None], float]:
    """Return how far the probability below a limit moves with the quantity, by one standard deviation."""
    shares = sorted(quantiles, key=float)
    at, below = [quantiles[share].value for share in shares], [float(share) for share in shares]

    def moved(limit: float | None) -> float:
        if limit is None:
            return 0.0
        ends = np.interp([limit - std, limit + std], at, below, left=0.0, right=1.0)
        return float(np.diff(ends)[0]) / 2

    return moved


def _bounded(zone: Probability) -> Probability:
    return replace(zone, low=max(0.0, zone.low), high=min(1.0, zone.high))


def _widened(value: Estimated, std: float) -> Estimated:
    """Add a standard deviation to each side of an interval, in squares."""
    far = _normal(value.level) * abs(std)
    low, high = (((value.value - value.low) ** 2 + far**2) ** 0.5, ((value.high - value.value) ** 2 + far**2) ** 0.5)
    return replace(value, std=(value.std**2 + std**2) ** 0.5, low=value.value - low, high=value.value + high)


def _normal(level: float) -> float:
    return float(ndtri((1 + level) / 2))
