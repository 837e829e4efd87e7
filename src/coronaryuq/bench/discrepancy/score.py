"""Scores of searches: an entry per case, cells, totals with intervals, confusion matrix."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from coronaryuq.bench.discrepancy import reliability
from coronaryuq.bench.discrepancy.tables import names_something, wilson
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.reference_gap import fit_known
from coronaryuq.discrepancy.inference.cross_validation import gap, linearise
from coronaryuq.discrepancy.result.write import named
from coronaryuq.discrepancy.selection.answer import NOTHING, OTHER
from coronaryuq.discrepancy.selection.discovery import Discovery


def scored(truth: make_case.Truth, answer: Discovery) -> dict:
    """Score one answer against the hidden truth.

    oracle, oracle_z: held-out misfit with the true effect, fitted from its true size, and the error of that size in
    posterior standard deviations, which shows whether an interval misses because of the search or of the noise. first:
    an alarm without a name is "outside".
    """
    problem = answer.base_problem
    classes = [[(c.effect.name, c.place) for c in entry.members] for entry in answer.named]
    entry: dict[str, Any] = {
        "places": [place for _, place in truth.hypothesis],
        "visible": truth.visible,
        "made_by": truth.made_by,
        "probability": stated_probability(answer),
        **matches(truth.hypothesis, classes, not answer.consistent),
        "sizes": [
            one.parameters[0].from_standard(z) for (one, _), z in zip(truth.hypothesis, truth.firsts, strict=True)
        ],
        "found": [_short(effect) for effect in named(answer)],
        "before": answer.gaps.before.misfit,
        "after": answer.gaps.before.misfit if answer.outside_library else answer.gaps.after.misfit,
        "flexible": answer.gaps.flexible.misfit,
        "remaining": answer.remaining.p,
        "noise_taken": {quantity: vars(noise) for quantity, noise in answer.noise.items()},
        "varying": max((one.log_odds for one in answer.answer.constancies), default=None),
        "held_out_p": answer.held_out_p,
        "probabilities": answer.answer.probabilities,
        "forms": answer.answer.forms,
        "tested": answer.alarm,
    }
    rows = len(answer.gaps.before.residual)
    entry["held_out_lpd_gain"] = (
        0.0 if answer.outside_library else answer.gaps.after.total_lpd - answer.gaps.before.total_lpd
    )
    # The mean square of m whitened residuals has a standard deviation of sqrt(2 / m).
    entry["worse"] = bool(entry["after"] ** 2 > answer.gaps.before.misfit**2 + 2.0 * np.sqrt(2.0 / rows))
    if truth.hypothesis.effects:
        problem, oracle = fit_known(problem, truth.hypothesis, truth.sizes, answer.base)
        best = gap(problem, linearise(problem, oracle.z, truth.hypothesis), answer.folds, 1).misfit
        room = answer.gaps.before.misfit**2 - best**2
        entry["oracle"] = best
        entry["gap_closed_over_oracle"] = (
            float((answer.gaps.before.misfit**2 - entry["after"] ** 2) / room) if room > 0.1 else None
        )
        entry["covered"] = _covered(answer, truth)
        spread = np.sqrt(np.diag(oracle.covariance))[problem.count :]
        entry["oracle_z"] = float((oracle.z[problem.count] - truth.sizes[0]) / spread[0])
    return entry


def matches(hidden: Hypothesis, classes: list[list[tuple[str, str]]], alarmed: bool) -> dict:
    """Compare an answer with the hidden effects.

    Parameters
    ----------
    hidden
        The hidden effects; none also if the truth is outside the library.
    classes
        Effect and place of the members of each class named.
    alarmed
        Whether the answer is that something is missing; without a name, something else.

    Returns
    -------
    dict
        named, placed, alarmed, abstained, first, classes.
    """
    wanted = [placed.key for placed in hidden]
    got = [any(name == e for members in classes for e, _ in members) for name, _ in wanted]
    placed = [any(pair in members for members in classes) for pair in wanted]
    first, abstained = classes[0] if classes else [], alarmed and not classes
    return {
        "named": any(name == wanted[0][0] for name, _ in first) if len(wanted) == 1 else bool(wanted) and all(got),
        "placed": bool(wanted) and all(placed),
        "alarmed": alarmed,
        "abstained": abstained,
        "first": first[0][0] if first else ("outside" if abstained else "none"),
        "classes": [["@".join(member) for member in members] for members in classes],
    }


def stated_probability(answer: Discovery) -> float:
    """Return the probability that the search gives its answer; of several names, the least."""
    if answer.named:
        return min(answer.class_probability(entry) for entry in answer.named)
    return answer.answer.probabilities[NOTHING if answer.consistent else OTHER]


def _short(effect: dict) -> dict:
    """Summarise a named effect: place, probability of its class, first size with its interval."""
    name, size = next(iter(effect["sizes"].items()))
    short = {key: effect[key] for key in ("effect", "place", "class_probability", "beyond_prior")}
    return short | {name: [size["value"], *size["interval_90"]]}


def _covered(answer: Discovery, truth: make_case.Truth) -> bool | None:
    """Whether the 90 % interval covers the true size; None if the true effect was not named."""
    if len(truth.hypothesis) != 1 or not answer.named:
        return None
    (one, place), size = truth.hypothesis.effects[0], truth.sizes[0]
    for entry in named(answer):
        if (entry["effect"], entry["place"]) == (one.name, place):
            parameter = one.parameters[0]
            low, high = entry["sizes"][parameter.name]["interval_90"]
            return bool(low <= float(parameter.from_standard(size)) <= high)
    return None


def score(found: list[dict]) -> dict:
    """Summarise scored cases: cells, totals with Wilson intervals, confusion matrix."""
    skipped = [e for e in found if e.get("skipped")]
    found = [e for e in found if not e.get("skipped")]
    single = [e for e in found if len(e["places"]) == 1]
    double = [e for e in found if len(e["places"]) == 2]
    nothing = [e for e in found if e["effect"] == "none"]
    outside = [e for e in found if e["effect"].startswith("outside:")]
    headline = [e for e in single if "shape" in e or (e["noise"] == "nominal" and e["strength"] == "medium")]
    covered = [e["covered"] for e in single if e["covered"] is not None]
    closed = [e["gap_closed_over_oracle"] for e in single + double if e["gap_closed_over_oracle"] is not None]

    def share(entries: list[dict], key: str) -> dict:
        return wilson(sum(bool(e[key]) for e in entries), len(entries))

    cells: dict[tuple, list[dict]] = {}
    for e in found:
        cells.setdefault((e["effect"], e["strength"], e["noise"], e["network"]), []).append(e)
    confusion: dict[str, dict[str, int]] = {}
    for e in found:
        row = confusion.setdefault(e["effect"], {})
        row[e["first"]] = row.get(e["first"], 0) + 1
    return {
        "cells": [
            {
                "effect": key[0],
                "strength": key[1],
                "noise": key[2],
                "network": key[3],
                "seeds": len(entries),
                "named": float(np.mean([e["named"] for e in entries])),
                "placed": float(np.mean([e["placed"] for e in entries])),
                "alarmed": float(np.mean([e["alarmed"] for e in entries])),
                "abstained": float(np.mean([e["abstained"] for e in entries])),
                "gap_closed_over_oracle": _mean([e.get("gap_closed_over_oracle") for e in entries]),
                "interval_coverage_90": reliability.coverage(entries),
            }
            for key, entries in cells.items()
        ],
        "totals": {
            "identification": share(headline, "named"),
            "place": share(headline, "placed"),
            "false_alarm": share(nothing, "alarmed"),
            "abstention": share(outside, "abstained"),
            "both_of_two": share(double, "named"),
            "interval_coverage_90": wilson(sum(covered), len(covered)),
            "gap_closed": float(np.median(closed)) if closed else None,
            "gap_closed_above_90": wilson(sum(c >= 0.9 for c in closed), len(closed)),
            "worse_than_recalibration": share([e for e in found if names_something(e)], "worse"),
        },
        "confusion": confusion,
        **reliability.summary([*found, *skipped]),
        "invisible": {e["effect"]: sum(o["effect"] == e["effect"] for o in skipped) for e in skipped},
        "cpu_s_per_discovery": _mean([e["cpu_s"] for e in found]),
        "cpu_s_made_per_case": _mean([e.get("cpu_s_made") for e in [*found, *skipped]]),
        "longest_cpu_s": max((e["cpu_s"] for e in found), default=None),
        "longest_wall_s": max((e["wall_s"] for e in found), default=None),
    }


def _mean(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return float(np.mean(known)) if known else None
