"""What each model of a branch predicts: FFR over the samples of the tables, before and after the effect is added."""

import numpy as np

from coronaryuq.discrepancy.table_model.branch_search import BranchSearch

LEVELS = {"low": 0.05, "median": 0.5, "high": 0.95}
"""Quantiles that are stated: a 90 % range and its middle."""
LIMITS = (0.75, 0.80)
"""Limits of FFR, as those of `estimation.ffr_zones`."""


def predictions(search: BranchSearch) -> dict[str, dict]:
    """Return model → quantiles of FFR over all samples, and the fraction of samples at or below each limit.

    Of a model that was fitted, each sample is predicted by the fit that had not seen it. A range is the spread of the
    samples, not the error of the model.
    """
    models = {
        "simulated": search.before,
        "recalibrated": search.plain,
        "repaired": search.after,
        "measured": search.measured,
    }
    return {name: _summary(values) for name, values in models.items()}


def _summary(ffr: np.ndarray) -> dict:
    return {
        **{name: float(np.quantile(ffr, level)) for name, level in LEVELS.items()},
        "at_most": {f"{limit:.2f}": float(np.mean(ffr <= limit)) for limit in LIMITS},
    }


def table_of_predictions(branch: str, predicted: dict[str, dict]) -> list[dict]:
    """Return the rows of `predicted.csv` of a branch."""
    return [
        {"branch": branch, "model": model}
        | {f"ffr_{name}": row[name] for name in LEVELS}
        | {f"at_most_{limit}": share for limit, share in row["at_most"].items()}
        for model, row in predicted.items()
    ]
