"""The card of one lesion: what it means, FFR over the posterior, where it is read, what would change the conclusion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.case.anatomy.ffr_place import STOPS
from coronaryuq.case.case_json import CaseStenosis
from coronaryuq.estimation.results import Probability, RowReport, Value
from coronaryuq.figures.style import colour
from coronaryuq.report.change import verdict_of, what_would_change
from coronaryuq.report.error_budget import error_budget
from coronaryuq.report.mesh_error import MeshError
from coronaryuq.report.quantities import FFR, KINDS, Digits, Percent, constant

ADVISED_MM = (10, 20)
"""Distance beyond a lesion at which experts advise to read FFR from CT."""
SHOWN = ("0.05", "0.25", "0.50", "0.75", "0.95")
"""Quantiles of FFR on the card."""
SCALE = (0.5, 1.0)
"""Ends of the scale of FFR, unless a value lies below."""


@dataclass(frozen=True)
class Lesion:
    """What the page knows of a stenosis besides its estimates.

    inputs: name of each input of the posterior. reading: distance (cm) beyond the lesion at which 3D FFR is read, None
    where there is no such plane; the 0D distance follows from the stenosis. past_branching: whether the plane lies in
    another vessel than the lesion.
    """

    stenosis: CaseStenosis
    inputs: Mapping[str, str]
    mesh: MeshError
    reading: float | None = None
    past_branching: bool = False


def lesion_card(lesion: Lesion, rows: Sequence[RowReport]) -> dict:
    """Return the contents of the card of one stenosis.

    Parameters
    ----------
    lesion
        The stenosis.
    rows
        Rows of `estimates.json`.
    """
    name = lesion.stenosis.name
    branch = name.lower()
    ffr_row = recommended_row(rows, f"{FFR}{branch}")
    beyond, digits = ffr_row.beyond_the_mean, Digits(ffr_row.column_3d, rows)
    zones, quantiles = beyond.zones or [], beyond.quantiles or {}
    patient, verdict = _patient(beyond.predictive or {}), _verdict(name, zones)
    percent = Percent(rows)
    estimate, drivers = ffr_row.recommended_report, _drivers(beyond.shapley or {}, lesion.inputs)
    return {
        "name": name,
        "colour": colour(lesion.stenosis.artery),
        "patient": patient,
        "rare": _rare(quantiles),
        "zones": [_probability(zone, percent) for zone in zones],
        "limit": _limit(zones),
        **verdict,
        "sentence": _sentence(verdict["verdict"], patient, zones, percent),
        "reading": _reading(lesion),
        "change": what_would_change(ffr_row, zones, next(iter(drivers), None)),
        "open": verdict["class"] == "warn",
        "mean": quantity_cell(ffr_row, rows, lesion.mesh),
        "budget": error_budget(estimate) | {"std": digits.error(estimate.std)},
        "spread": digits(float(np.sqrt(ffr_row.variance_of_states))),
        "drivers": drivers,
        "quantities": _cells(rows, branch, lesion.mesh, extreme=False),
        "extremes": _cells(rows, branch, lesion.mesh, extreme=True),
    }


def recommended_row(rows: Sequence[RowReport], column: str) -> RowReport:
    """Return the row of a 3D column whose recommended estimator has the smallest standard error."""
    return min((row for row in rows if row.column_3d == column), key=lambda row: row.recommended_report.std)


def quantity_cell(row: RowReport, rows: Sequence[RowReport], mesh: MeshError) -> dict:
    """Return mean and interval of a quantity; no interval for one that is the same in all runs."""
    estimate, digits = row.recommended_report, Digits(row.column_3d, rows)
    cell = {
        "row": row.row, "heading": digits.kind.heading, "value": digits(estimate.mean), "raw": estimate.mean,
        "mesh": mesh.of(row.column_3d, digits.kind.scale), "level": f"{100 * estimate.calibrated.level:.0f} % interval",
    }  # fmt: skip
    if constant(row):
        return cell | {
            "value": f"{estimate.mean * digits.kind.scale:g}",
            "range": f"in all {estimate.n_3d} runs",
            "low": "",
            "high": "",
        }
    low, high = digits(estimate.calibrated.low), digits(estimate.calibrated.high)
    return cell | {"range": f"{low} to {high}", "low": low, "high": high}


def _cells(rows: Sequence[RowReport], branch: str, mesh: MeshError, extreme: bool) -> list[dict]:
    """Return a cell for each quantity of a branch that was estimated, averages or extremes."""
    kinds = {prefix: kind for prefix, kind in KINDS.items() if not kind.of_artery}
    columns = [f"{prefix}{branch}" for prefix, kind in kinds.items() if kind.extreme == extreme]
    estimated = {row.column_3d for row in rows}
    return [quantity_cell(recommended_row(rows, column), rows, mesh) for column in columns if column in estimated]


def _patient(value: Mapping[str, float]) -> dict:
    """Return median, quartiles and 90 % range of the patient's FFR, by predictive quantiles; empty without them."""
    if not {"0.05", "0.50", "0.95"} <= set(value):
        return {}
    low, median, high = (f"{value[share]:.2f}" for share in ("0.05", "0.50", "0.95"))
    inner = [value.get("0.25", value["0.50"]), value.get("0.75", value["0.50"])]
    scale = [min(SCALE[0], np.floor(10 * value["0.05"]) / 10), SCALE[1]]
    return {
        "low": low, "median": median, "high": high, "values": [value["0.05"], *inner, value["0.95"]],
        "middle": value["0.50"], "scale": scale,
    }  # fmt: skip


def _rare(quantiles: Mapping[str, Value]) -> str:
    """Return the warning of the shown quantiles of FFR over the posterior that rest on few runs."""
    warned = [share for share in SHOWN if share in quantiles and quantiles[share].warning]
    if not warned:
        return ""
    warning = quantiles[warned[0]].warning
    alike = [f"{100 * float(end):.0f} %" for end in warned if quantiles[end].warning == warning]
    if len(alike) == 1:
        return f"One end of this range is rough: the {alike[0]} quantile {warning}. More 3D runs would make it sharper."
    ends = f"{', '.join(alike[:-1])} and {alike[-1]} quantiles"
    return f"The ends of this range are rough: of the {ends}, each {warning}. More 3D runs would make them sharper."


def _drivers(effects: Mapping[str, Value], inputs: Mapping[str, str], shown: int = 3) -> list[dict]:
    """Return the inputs with the largest Shapley effects on FFR that differ from zero."""
    significant = [(name, effect) for name, effect in effects.items() if effect.low > 0]
    largest = sorted(significant, key=lambda pair: -pair[1].value)[:shown]
    return [{"name": inputs.get(name, name), "share": f"{100 * effect.value:.0f} %"} for name, effect in largest]


def _probability(probability: Probability, percent: Percent) -> dict:
    share = round(100 * min(max(probability.value, 0.0), 1.0), 2)
    low, high = percent.end(probability.low).removesuffix(" %"), percent.end(probability.high)
    return {"zone": probability.zone, "percent": share, "value": percent(probability), "low": low, "high": high}


def _limit(zones: Sequence[Probability]) -> float | None:
    return zones[-1].above if zones else None


def _verdict(name: str, zones: Sequence[Probability]) -> dict:
    below = zones[-1].complement if zones else None
    if below is None:
        return {"class": "muted", "verdict": f"FFR of the {name} stenosis", "badge": ""}
    limits = verdict_of(below)
    if limits:
        verdict = f"The {name} stenosis very likely limits blood flow"
        return {"class": "bad", "badge": "very likely flow-limiting", "verdict": verdict}
    if limits is False:
        verdict = f"The {name} stenosis very likely does not limit blood flow"
        return {"class": "good", "badge": "very likely not flow-limiting", "verdict": verdict}
    verdict = f"It is undecided whether the {name} stenosis limits blood flow"
    return {"class": "warn", "badge": "undecided", "verdict": verdict}


def _sentence(verdict: str, patient: dict, zones: Sequence[Probability], percent: Percent) -> str:
    """Return the conclusion in one sentence of plain words."""
    if not patient:
        return f"{verdict}: no distribution over the states that fit the data was estimated."
    ffr = f"FFR is {patient['median']} (90 % range {patient['low']} to {patient['high']})"
    if not zones:
        return f"{verdict}: {ffr}."
    chance = percent.in_words(zones[-1].complement)
    return f"{verdict}: {ffr}; the probability of {_limit(zones):.2f} or less is {chance}."


def _reading(lesion: Lesion) -> dict:
    """Return where the FFR of the card, of 3D, is read, whether experts advise to, and where 0D reads if elsewhere."""
    stenosis, distance = lesion.stenosis, lesion.reading
    if distance is None:
        return {"words": "", "advised": True, "by_0d": ""}
    mm, read = round(10 * distance), stenosis.read
    in_0d = 0.0 if read is None or stenosis.end is None else 10 * (read.arc - stenosis.end)
    words = f"{mm} mm beyond the lesion{', past a branching' if lesion.past_branching else ''}"
    stop = ""
    if read is not None and read.stop is not None:
        stop = f", {STOPS[read.stop]} ({10 * read.asked:g} mm were asked for)"
    by_0d = ""
    if abs(10 * distance - in_0d) >= 1:
        place = f"{in_0d:.0f} mm beyond it" if in_0d >= 0.5 else "at the lesion's end"
        by_0d = f"The 0D model, which helps to estimate it, reads {place}{stop}."
    else:
        words += stop
    advised = ADVISED_MM[0] <= mm <= ADVISED_MM[1]
    return {"words": words, "advised": advised, "advice": "{} to {} mm".format(*ADVISED_MM), "by_0d": by_0d}
