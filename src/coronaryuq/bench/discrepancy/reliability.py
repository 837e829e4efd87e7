"""Whether stated probabilities and intervals hold, and how large a signal has to be: scores of many cases together."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.bench.discrepancy.cases import TRACE
from coronaryuq.bench.discrepancy.tables import in_order, is_pair, names_something, right, wilson

BINS = (0.0, 0.5, 0.8, 0.9, 0.97, 1.0)
"""Edges of the five bins of stated probabilities; most are near 1."""
OPEN_WORLD = {"nothing": 1 / 3, "an effect of the library": 1 / 3, "outside the library": 1 / 3}
"""Shares of the truths in a mixture by which probabilities are compared with frequencies, too: what a search meets is
not known, and of the benchmark's cases most hide nothing."""
CONFIDENT = 0.9
"""Stated probability from which a wrong name is counted."""


def summary(cases: Sequence[dict]) -> dict:
    """Return all scores of this module.

    Parameters
    ----------
    cases
        Entries of the benchmark, skipped ones included.

    Returns
    -------
    dict
        `reliability`, `brier`, `confidently_wrong_outside`, `coverage_by_cell` and `detection`.
    """
    searched = [case for case in cases if not case.get("skipped")]
    return {
        "reliability": reliability(searched),
        "brier": brier(searched),
        "confidently_wrong_outside": confidently_wrong(searched),
        "coverage_by_cell": coverage_by_cell(searched),
        "detection": detection_curve(cases),
    }


def reliability(cases: Sequence[dict]) -> list[dict]:
    """Compare stated probabilities with frequencies: a row per bin with cases.

    Answers without a stated probability are left out. from, to: edges, the upper one included. stated: mean stated
    probability. share, low, high, trials: right answers with their Wilson interval. open_world: the same, in which the
    cases are weighted to the mixture `OPEN_WORLD`; its trials are effective ones (Kish 1965).
    """
    stating = _stating(cases)
    truths = [_truth(case) for case in stating]
    weights = np.array([OPEN_WORLD[truth] / truths.count(truth) for truth in truths])
    stated = np.array([case["probability"] for case in stating], dtype=float)
    correct = np.array([right(case) for case in stating], dtype=float)
    rows = []
    for lower, upper in zip(BINS, BINS[1:], strict=False):
        mine = (lower < stated) & (stated <= upper) | ((stated == lower) & (lower == 0.0))
        if mine.any():
            own = weights[mine] / weights[mine].sum()
            effective = float(1.0 / (own**2).sum())
            row = {"from": lower, "to": upper, "stated": float(stated[mine].mean())}
            row |= wilson(int(correct[mine].sum()), int(mine.sum()))
            mixed = {"stated": float(own @ stated[mine]), **wilson(float(own @ correct[mine]) * effective, effective)}
            rows.append(row | {"open_world": mixed})
    return rows


def _truth(case: dict) -> str:
    hidden = kind(case)
    return hidden if hidden in OPEN_WORLD else "an effect of the library"


def brier(cases: Sequence[dict]) -> dict:
    """Return the Brier score, its standard error, and how many answers stated a probability (Brier 1950)."""
    stating = _stating(cases)
    if not stating:
        return {"score": None, "se": None, "trials": 0}
    squares = np.array([(case["probability"] - right(case)) ** 2 for case in stating])
    error = float(squares.std(ddof=1) / np.sqrt(len(squares))) if len(squares) > 1 else None
    return {"score": float(squares.mean()), "se": error, "trials": len(squares)}


def confidently_wrong(cases: Sequence[dict]) -> dict:
    """Count names stated with `CONFIDENT` or more where the truth is outside the library."""
    outside = [case for case in cases if case["effect"].startswith("outside")]
    wrong = [c for c in outside if names_something(c) and c.get("probability") is not None]
    return wilson(sum(case["probability"] >= CONFIDENT for case in wrong), len(outside))


def coverage(cases: Sequence[dict]) -> dict:
    """Return how many 90 % intervals of named effects cover the true size."""
    covered = [case["covered"] for case in cases if case.get("covered") is not None]
    return wilson(sum(covered), len(covered))


def coverage_by_cell(cases: Sequence[dict]) -> list[dict]:
    """Return `coverage` by network, effect, strength and noise, for cells with intervals."""
    keys = ("network", "effect", "strength", "noise")
    cells: dict[tuple, list[dict]] = {}
    for case in cases:
        if case.get("covered") is not None:
            cells.setdefault(tuple(case.get(key) for key in keys), []).append(case)
    return [dict(zip(keys, key, strict=True)) | coverage(mine) for key, mine in cells.items()]


def detection_curve(cases: Sequence[dict]) -> list[dict]:
    """Return right answers, alarms and wrong names by the trace that single effects were scaled to.

    skipped: cases in which no place and no plausible size has that trace.
    """
    traced = [case for case in cases if case["strength"].startswith(TRACE) and not is_pair(case)]
    rows = []
    for trace in sorted({float(case["strength"].removeprefix(TRACE)) for case in traced}):
        every = [case for case in traced if float(case["strength"].removeprefix(TRACE)) == trace]
        mine = [case for case in every if not case.get("skipped")]
        wrong = [case for case in mine if names_something(case) and not right(case)]
        rows.append(
            {
                "trace": trace,
                "right": wilson(sum(map(right, mine)), len(mine)),
                "alarmed": wilson(sum(case["alarmed"] for case in mine), len(mine)),
                "wrong_name": wilson(len(wrong), len(mine)),
                "skipped": len(every) - len(mine),
            }
        )
    return rows


def by_kind(cases: Sequence[dict]) -> list[dict]:
    """Return right answers and mean CPU seconds by network, noise and kind of truth."""
    groups: dict[tuple, list[dict]] = {}
    for case in cases:
        groups.setdefault((case["network"], case["noise"], kind(case)), []).append(case)
    rows = []
    for (network, noise, name), mine in groups.items():
        searched = [case for case in mine if not case.get("skipped")]
        made = [case["cpu_s_made"] for case in mine if case.get("cpu_s_made") is not None]
        rows.append(
            {
                "network": network,
                "noise": noise,
                "hidden": name,
                **wilson(sum(map(right, searched)), len(searched)),
                "skipped": len(mine) - len(searched),
                "cpu_s_made": float(np.mean(made)) if made else None,
                "cpu_s": float(np.mean([case["cpu_s"] for case in searched])) if searched else None,
            }
        )
    return rows


def kind(case: dict) -> str:
    """Return the kind of truth of a case: nothing, one effect, two effects, outside the library."""
    if case["effect"] == "none":
        return "nothing"
    if case["effect"].startswith("outside"):
        return "outside the library"
    return "two effects" if is_pair(case) else "one effect"


def markdown(cases: Sequence[dict]) -> str:
    """Return the scores as tables for the documentation."""
    searched = [case for case in cases if not case.get("skipped")]
    spent = [(*map(_number, (row["cpu_s_made"], row["cpu_s"])),) for row in by_kind(cases)]
    kinds = [
        (row["network"], row["noise"], row["hidden"], *_share(row), row["skipped"], *cost)
        for row, cost in zip(by_kind(cases), spent, strict=True)
    ]
    head: tuple[str, ...] = (
        "network",
        "noise",
        "hidden",
        "right",
        "95 % interval",
        "skipped",
        "CPU s made",
        "searched",
    )
    parts = [_table(head, kinds)]
    rows = [
        (
            f"{r['from']:g} to {r['to']:g}",
            f"{r['stated']:.3f}",
            *_share(r),
            *(f"{r['open_world'][key]:.3f}" for key in ("stated", "share")),
            _share(r["open_world"])[1],
        )
        for r in reliability(searched)
    ]
    if rows:
        head = ("stated probability", "mean", "right", "95 % interval")
        parts.append(_table((*head, "mean, mixture", "right, mixture", "95 % interval, mixture"), rows))
    score, wrong = brier(searched), confidently_wrong(searched)
    if score["trials"]:
        error = "" if score["se"] is None else f" ± {score['se']:.3f}"
        parts.append(f"Brier score {score['score']:.3f}{error} ({score['trials']} answers with a probability).")
    if wrong["trials"]:
        held, interval = _share(wrong)
        parts.append(f"Wrong names stated at {CONFIDENT:g} or more, truth outside the library: {held} ({interval}).")
    covered = coverage_by_cell(searched)
    order = {effect: number for number, effect in enumerate(in_order(row["effect"] for row in covered))}
    intervals = [
        (row["network"], row["effect"].replace("_", " "), f"{row['strength']}, {row['noise']}", *_share(row))
        for row in sorted(covered, key=lambda row: (row["network"], order[row["effect"]]))
    ]
    if intervals:
        parts.append(
            _table(("network", "hidden", "strength, noise", "90 % intervals that cover", "95 % interval"), intervals)
        )
    curve = [
        (f"{r['trace']:g}", *_share(r["right"]), *_share(r["alarmed"]), _share(r["wrong_name"])[0], r["skipped"])
        for r in detection_curve(cases)
    ]
    if curve:
        head = ("trace, noise sd", "right", "95 % interval", "alarmed", "95 % interval", "wrong name", "skipped")
        parts.append(_table(head, curve))
    return "\n\n".join(parts) + "\n"


def _stating(cases: Sequence[dict]) -> list[dict]:
    return [case for case in cases if case.get("probability") is not None]


def _share(row: dict) -> tuple[str, str]:
    if not row["trials"]:
        return "–", "–"
    return f"{round(row['share'] * row['trials'])} of {row['trials']}", f"{row['low']:.3f} to {row['high']:.3f}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2g}"


def _table(head: Sequence[str], rows: Sequence[Sequence]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)
