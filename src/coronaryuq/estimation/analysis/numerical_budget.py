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
    shift = pd.DataFrame({name: _correction(errors, name, runs.y[name].to_numpy()) for name in runs.y.columns})
    return replace(runs, y=runs.y + shift.set_axis(runs.y.index))


def with_numerical_error(row: RowReport, errors: Errors) -> RowReport:
    """Return a row of corrected runs whose standard errors and intervals include the numerical error.

    Half-widths are added in squares. A zone's probability moves by the distribution function at its limits, which is
    taken to be linear between the estimated quantiles. `numerical_correction` is that of the recommended mean.
    """
    name = row.column_3d
    if name not in errors:
        return row
    measured = any(error.method != "assumed" for error in errors[name])

    def std(value: float) -> float:
        return sum(_variances(errors, name, value).values()) ** 0.5

    wider = {key: _wider(report, _variances(errors, name, report.mean)) for key, report in row.estimators.items()}
    return replace(
        row,
        estimators=wider,
        beyond_the_mean=_beyond(row.beyond_the_mean, std),
        numerical_correction=float(_correction(errors, name, row.recommended_report.mean)) if measured else None,
    )


def _correction(errors: Errors, name: str, values: float | np.ndarray) -> float | np.ndarray:
    shift = np.zeros_like(values)
    for error in errors.get(name, ()):
        shift = shift + error.correction * error.grown(name, values)
    return shift


def _variances(errors: Errors, name: str, value: float) -> dict[str, float]:
    """Return source → variance of its error where the quantity has a value."""
    return {error.source: float(error.std * error.grown(name, value)) ** 2 for error in errors[name]}


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


def _beyond(found: BeyondTheMean, std: Callable[[float], float]) -> BeyondTheMean:
    """Return what is estimated beyond the mean, with the numerical error; std: of a value of the quantity."""
    quantiles = found.quantiles
    if quantiles is not None:
        quantiles = {share: _widened(value, std(value.value)) for share, value in quantiles.items()}
    zones = found.zones
    if zones is not None and found.quantiles:
        moved = _mover(found.quantiles, std)
        zones = [_bounded(_widened(zone, moved(zone.at_most) - moved(zone.above))) for zone in zones]
    return replace(found, quantiles=quantiles, zones=zones)


def _mover(quantiles: Mapping[str, Value], std: Callable[[float], float]) -> Callable[[float | None], float]:
    """Return how far the probability below a limit moves with the quantity, by one standard deviation there."""
    shares = sorted(quantiles, key=float)
    at, below = [quantiles[share].value for share in shares], [float(share) for share in shares]

    def moved(limit: float | None) -> float:
        if limit is None:
            return 0.0
        ends = np.interp([limit - std(limit), limit + std(limit)], at, below, left=0.0, right=1.0)
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
