"""The error budget of an estimate as the page shows it: a stacked bar, and what the interval includes in words."""

from collections.abc import Mapping, Sequence

from coronaryuq.estimation.results import NUMERICAL, SOURCES, EstimatorReport

WORDS = {
    "runs_3d": "3D runs",
    "propagation": "0D propagation",
    "chain": "posterior chains",
    "mesh": "mesh",
    "time_step": "time step",
    "cycles": "cycles",
    "assumed": "mesh and time step (assumed)",
}
"""Sources of error as a reader knows them."""
ASSUMED = "assumed"
"""Stands for every numerical error."""


def error_budget(estimate: EstimatorReport) -> dict:
    """Return the bar of an estimate.

    Its `parts` (name, class, percent of the variance), `words`, and `left_out`, a sentence on what neither it nor the
    distribution over states includes.
    """
    total = sum(estimate.variance.values())
    percent = {name: 100 * estimate.variance[name] / total for name in SOURCES if name in estimate.variance and total}
    parts = [
        {"name": WORDS[name], "class": name, "percent": f"{part:.1f}", "rounded": f"{part:.0f}"}
        for name, part in percent.items()
    ]
    listed = ", ".join(f"{WORDS[name]} {part:.0f} %" for name, part in percent.items())
    missing = _missing(estimate.variance)
    return {
        "parts": parts,
        "words": f"{listed}{missing}",
        "left_out": _left_out(estimate.variance),
    }


def includes(estimates: Sequence[EstimatorReport]) -> str:
    """Return in words which errors the intervals of some estimates include, and which nobody measured."""
    measured = {name for estimate in estimates for name in estimate.variance}
    named = [WORDS[name] for name in SOURCES if name in measured]
    return f"The numerical error includes those of {_joined(named)}{_missing(dict.fromkeys(measured, 0.0))}."


def _missing(variance: Mapping[str, float]) -> str:
    missing = _unmeasured(variance)
    return f"; not measured: {_joined(missing)}" if missing else ""


def _left_out(variance: Mapping[str, float]) -> str:
    missing = _unmeasured(variance)
    if not missing:
        return ""
    return f"Not measured, so in none of these numbers: {_joined(missing)}."


def _unmeasured(variance: Mapping[str, float]) -> list[str]:
    if ASSUMED in variance:
        return []
    return [WORDS[name] for name in NUMERICAL if name not in variance and name != ASSUMED]


def _joined(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last
