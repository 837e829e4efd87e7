"""Which source of a prediction's uncertainty to improve first."""

from collections.abc import Mapping

from coronaryuq.estimation.results import NUMERICAL, EstimatorReport, Value

MEASUREMENTS = {
    "flow": "perfusion",
    "lumen": "the lumen's segmentation",
    "cuff and echo": "cuff and echocardiogram",
    "model": "what is assumed of hyperaemia, blood and unmeasured beds",
    "numerics": "mesh and time step",
}
"""Source of uncertainty → what would have to be better known."""


def numerical_share(estimate: EstimatorReport, variance: float) -> float | None:
    """Return the part of mesh, time step and cycles in the variance of a prediction; None if it was not measured."""
    if not any(name in estimate.variance for name in NUMERICAL):
        return None
    numerical = sum(estimate.variance.get(name, 0.0) for name in NUMERICAL)
    return numerical / (numerical + variance) if numerical > 0.0 else 0.0


def improve_first(effects: Mapping[str, Value], numerical: float | None) -> str:
    """Return a sentence on the shares of the sources, and on which to improve first; empty if flow alone is uncertain.

    effects: Shapley effect of each source; numerical: share of numerical error, None if it was not measured. Sources
    whose intervals overlap with the largest one's are named with it.
    """
    if not effects:
        return ""
    left = 1.0 - (numerical or 0.0)
    shares = {name: (left * e.value, left * e.low, left * e.high) for name, e in effects.items()}
    if numerical is not None:
        shares["numerics"] = (numerical, numerical, numerical)
    order = sorted(shares, key=lambda name: -shares[name][0])
    first = [name for name in order if shares[name][2] >= shares[order[0]][1]]
    listed = ", ".join(f"{name} {100 * shares[name][0]:.0f} %" for name in order)
    listed += "; numerics not measured" if numerical is None else ""
    return f"Improve first: {' or '.join(MEASUREMENTS[name] for name in first)} (shares of FFR's variance: {listed})."
