"""Estimates as plain values: what goes into `estimates.json` and `table.csv`."""

import numpy as np
import pandas as pd

from coronaryuq.estimation.estimators.crossfit import Estimate
from coronaryuq.estimation.estimators.montecarlo import Interval, chebyshev


def interval(value: Interval) -> dict:
    return {"low": value.low, "high": value.high, "level": value.level}


def estimate(value: Estimate) -> dict:
    """One estimator of one row; keys in `estimation.__init__`."""
    return {
        "method": value.method,
        "mean": value.mean,
        "std": value.std,
        "chebyshev_95": interval(chebyshev(value.mean, value.std**2, 0.95)),
        "chebyshev_99": interval(chebyshev(value.mean, value.std**2, 0.99)),
        "calibrated": interval(value.interval),
        "rho_held_out": value.rho_held_out,
        "n_3d": value.n_3d,
        "n_0d": value.n_0d,
        "predictions": value.predictions,
        "beta": value.beta,
        "residual_variance": value.residual_variance,
        "propagation_variance": value.propagation_variance,
        "warnings": list(value.warnings),
    }


def table(rows: list[dict]) -> pd.DataFrame:
    """All rows × estimators, one line each, from the rows of `estimates.json`."""
    lines = []
    for row in rows:
        for name, value in row["estimators"].items():
            line = {
                "row": row["row"],
                "label": row["label"],
                "column_3d": row["column_3d"],
                "column_0d": row["column_0d"],
            }
            line |= {"estimator": name, "method": value["method"], "mean": value["mean"], "std": value["std"]}
            for kind in ("chebyshev_95", "chebyshev_99", "calibrated"):
                line |= {f"{kind}_low": value[kind]["low"], f"{kind}_high": value[kind]["high"]}
            line |= {
                "rho_original": row["paper"]["rho_original"],
                "rho_in_sample": value.get("rho_in_sample", np.nan),
                "rho_held_out": value["rho_held_out"],
            }
            line |= {key: value[key] for key in ("n_3d", "n_0d", "predictions")}
            lines.append(line | {"warnings": "; ".join([*row["warnings"], *value["warnings"]])})
    return pd.DataFrame(lines)
