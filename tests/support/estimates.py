"""Rows of `estimates.json` with plausible numbers, of which a test names those that matter to it."""

from dataclasses import replace
from typing import Any

from coronaryuq.estimation.results import BeyondTheMean, EstimatorReport, Interval, PaperRow, RowReport, Value

INTERVAL = Interval(0.1, 0.3, 0.95)


def estimator(**changes: Any) -> EstimatorReport:
    usual = EstimatorReport(
        method="MC", mean=0.2, std=0.05, chebyshev_95=INTERVAL, chebyshev_99=INTERVAL, calibrated=INTERVAL,
        rho_held_out=0.5, n_3d=100, n_0d=100, predictions=100, beta=1.0,
        variance={"runs_3d": 2e-3, "propagation": 5e-4, "chain": 0.0}, warnings=[],
    )  # fmt: skip
    return replace(usual, **changes)


def row(**changes: Any) -> RowReport:
    usual = RowReport(
        row="ffr_ffr_lad", label="FFR, FFR, LAD", column_3d="ffr_lad", column_0d="ffr_lad", variance_3d=0.04,
        paper=PaperRow(0.5, 0.02, 0.018), estimators={"MC": estimator()}, recommended="MC",
        beyond_the_mean=BeyondTheMean(), levels=None, n_propagation=1000, emulator_error=1e-4, integrated_exactly=None,
        warnings=[],
    )  # fmt: skip
    return replace(usual, **changes)


def value(middle: float, low: float = 0.0, high: float = 1.0, warning: str | None = None) -> Value:
    return Value(middle, 0.01, low, high, 0.95, warning)
