"""Estimates as they are reported: one estimator in `estimates.json`, and all of them in `table.csv`."""

import numpy as np
import pandas as pd

from coronaryuq.estimation.estimators.crossfit import Estimate
from coronaryuq.estimation.estimators.formulas import chebyshev
from coronaryuq.estimation.results import SOURCES, STATISTICAL, EstimatorReport, RowReport


def estimator_report(estimate: Estimate) -> EstimatorReport:
    """Return an estimate as `estimates.json` holds it."""
    residual = estimate.residual_variance
    return EstimatorReport(
        method=estimate.method,
        mean=estimate.mean,
        std=estimate.std,
        chebyshev_95=chebyshev(estimate.mean, estimate.std**2, 0.95),
        chebyshev_99=chebyshev(estimate.mean, estimate.std**2, 0.99),
        calibrated=estimate.interval,
        rho_held_out=estimate.rho_held_out,
        n_3d=estimate.n_3d,
        n_0d=estimate.n_0d,
        predictions=estimate.predictions,
        beta=estimate.beta,
        variance=dict(
            zip(STATISTICAL, (residual, estimate.propagation_variance, estimate.chain_variance), strict=True)
        ),
        warnings=list(estimate.warnings),
        rho_in_sample=estimate.rho_in_sample,
        std_in_sample=estimate.std_in_sample,
    )


def table(rows: list[RowReport]) -> pd.DataFrame:
    """Return all rows × estimators, one line each."""
    lines = []
    for row in rows:
        named = {"row": row.row, "label": row.label, "column_3d": row.column_3d, "column_0d": row.column_0d}
        for name, estimate in row.estimators.items():
            line = named | {
                "estimator": name, "method": estimate.method, "mean": estimate.mean, "std": estimate.std
            }  # fmt: skip
            for kind in ("chebyshev_95", "chebyshev_99", "calibrated"):
                interval = getattr(estimate, kind)
                line |= {f"{kind}_low": interval.low, f"{kind}_high": interval.high}
            line |= {
                "rho_original": row.paper.rho_original,
                "rho_in_sample": np.nan if estimate.rho_in_sample is None else estimate.rho_in_sample,
                "rho_held_out": estimate.rho_held_out,
                **{f"variance_{source}": estimate.variance.get(source, np.nan) for source in SOURCES},
                "n_3d": estimate.n_3d, "n_0d": estimate.n_0d, "predictions": estimate.predictions,
                "warnings": "; ".join([*row.warnings, *estimate.warnings]),
            }  # fmt: skip
            lines.append(line)
    return pd.DataFrame(lines)
