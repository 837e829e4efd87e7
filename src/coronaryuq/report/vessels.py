"""The card of one vessel: FFR over the posterior, the probability of a flow-limiting lesion, main drivers, the mean."""

from collections.abc import Mapping

import numpy as np

from coronaryuq.estimation.results import NUMERICAL, EstimatorReport, Probability, RowReport, Value
from coronaryuq.report.error_budget import error_budget
from coronaryuq.report.mesh_error import EXTREMES, MeshError
from coronaryuq.report.numbers import interval

QUANTITIES = {
    "ffr_": "FFR",
    "tawss_patch_min_": "patch-min TAWSS (dyn/cm²)",
    "low_shear_area_": "low-shear area",
    "osi_patch_max_": "patch-max OSI",
}
"""Quantities of the page's first table, by the beginning of their 3D columns; extremes have a table of their own."""
FFR_DECIMALS = 3
"""Digits of FFR. A pressure wire has two; the third shows how close the mean is to the threshold."""
ROUNDING = 1e-12
"""Relative standard error of a quantity that is the same in all runs, at most."""
LIKELY = 0.9
"""Probability, over its whole interval, above which the page states a verdict."""


def vessel_card(artery: str, rows: list[RowReport], outlets: Mapping[str, str], mesh: MeshError) -> dict:
    """Return the contents of the card of one stenosis.

    Parameters
    ----------
    artery
        Name of the stenosed artery: LAD, LCx or RCA.
    rows
        Rows of `estimates.json`.
    outlets
        Label of each input of the posterior.
    mesh
        Error of mesh and time step.
    """
    branch = artery.lower()
    ffr_row, ffr = _recommended(rows, f"ffr_{branch}")
    beyond = ffr_row.beyond_the_mean
    zones = beyond.zones or []
    return {
        "name": artery,
        "ffr": _quantity(ffr, FFR_DECIMALS) | {"mesh": mesh.of(f"ffr_{branch}")},
        "budget": error_budget(ffr),
        "patient": _patient(beyond.quantiles or {}),
        "rare": _rare(beyond.quantiles or {}),
        "drivers": _drivers(beyond.shapley or {}, outlets),
        "improve": improve_first(beyond.by_source or {}, _numerical_share(ffr, ffr_row.variance_3d)),
        "quantities": _cells(QUANTITIES, branch, rows, mesh),
        "extremes": _cells(EXTREMES, branch, rows, mesh),
        "zones": [_probability(zone) for zone in zones],
        "spread": f"{np.sqrt(ffr_row.variance_3d):.{FFR_DECIMALS}f}",
        **_verdict(zones[-1].complement if zones else None),
    }


def _cells(quantities: Mapping[str, str], branch: str, rows: list[RowReport], mesh: MeshError) -> list[dict]:
    """Return a cell of a table for each of some quantities that were estimated, with its heading."""
    columns = {f"{name}{branch}": heading for name, heading in quantities.items()}
    estimated = {row.column_3d for row in rows}
    return [
        _quantity(_recommended(rows, column)[1]) | {"heading": heading, "mesh": mesh.of(column)}
        for column, heading in columns.items()
        if column in estimated
    ]


def _recommended(rows: list[RowReport], column: str) -> tuple[RowReport, EstimatorReport]:
    """Return the row of a 3D column whose recommended estimator has the smallest standard error, and that estimate."""
    row = min((row for row in rows if row.column_3d == column), key=lambda row: row.recommended_report.std)
    return row, row.recommended_report


def _patient(quantiles: Mapping[str, Value]) -> dict:
    """Return median and outermost quantiles of FFR over the posterior; empty without them."""
    if not {"0.05", "0.50", "0.95"} <= set(quantiles):
        return {}
    low, median, high = (f"{quantiles[share].value:.2f}" for share in ("0.05", "0.50", "0.95"))
    return {"low": low, "median": median, "high": high}


def _rare(quantiles: Mapping[str, Value]) -> str:
    """Return the warning of the outermost quantiles of FFR over the posterior."""
    warned = [end for end in sorted(quantiles, key=float) if quantiles[end].warning]
    if not warned:
        return ""
    *others, last = (f"{100 * float(end):.0f} %" for end in warned)
    shares = f"{', '.join(others)} and {last} quantiles" if others else f"{last} quantile"
    return f"{shares}: {quantiles[warned[0]].warning}."


def _drivers(effects: Mapping[str, Value], outlets: Mapping[str, str], shown: int = 3) -> str:
    """Return the inputs with the largest Shapley effects on FFR that differ from zero."""
    significant = [(name, effect) for name, effect in effects.items() if effect.low > 0]
    largest = sorted(significant, key=lambda pair: -pair[1].value)[:shown]
    return ", ".join(f"{outlets.get(name, name)} {100 * effect.value:.0f} %" for name, effect in largest)


MEASUREMENTS = {
    "flow": "perfusion",
    "lumen": "the lumen's segmentation",
    "cuff and echo": "cuff and echocardiogram",
    "model": "the assumed hyperaemia and blood",
    "numerics": "mesh and time step",
}
"""Source of uncertainty → what would have to be better known."""


def _numerical_share(estimate: EstimatorReport, variance: float) -> float | None:
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


def _quantity(estimate: EstimatorReport, most_decimals: int = 6) -> dict:
    """Return value and interval in digits; no interval for a quantity that is the same in all runs."""
    calibrated = estimate.calibrated
    if estimate.std <= ROUNDING * abs(estimate.mean):
        value = f"{estimate.mean:g}"
        return {"value": value, "low": value, "high": value, "range": f"in all {estimate.n_3d} runs", "level": ""}
    low, high = interval(calibrated.low, calibrated.high)
    decimals = min(len(low.partition(".")[2]), most_decimals)
    low, high = (f"{end:.{decimals}f}" for end in (calibrated.low, calibrated.high))
    level = f"{100 * calibrated.level:.0f} % interval"
    value = f"{estimate.mean:.{decimals}f}"
    return {"value": value, "low": low, "high": high, "range": f"{low} to {high}", "level": level}


def _probability(probability: Probability) -> dict:
    share = {name: 100 * min(max(getattr(probability, name), 0.0), 1.0) for name in ("value", "low", "high")}
    decimals = 1 if share["high"] - share["low"] < 2 else 0
    return {"zone": probability.zone} | {name: f"{value:.{decimals}f} %" for name, value in share.items()}


def _verdict(probability: Probability | None) -> dict:
    if probability is None:
        return {"class": "muted", "verdict": ""}
    if probability.low > LIKELY:
        return {"class": "bad", "verdict": "Very likely flow-limiting."}
    if probability.high < 1 - LIKELY:
        return {"class": "good", "verdict": "Very likely not flow-limiting."}
    return {"class": "warn", "verdict": "Indeterminate."}
