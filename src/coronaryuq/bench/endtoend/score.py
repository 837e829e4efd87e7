"""Scores of stated intervals and probabilities against the truth: coverage, PIT, reliability, zones of FFR.

A line is one patient under one setting; see `docs/evidence/end-to-end.md`. Vessels of one patient share its errors, so
that the intervals of shares, which take them as independent, are somewhat too narrow.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from coronaryuq.bench.discrepancy.tables import wilson

LEVELS = {50: ("0.25", "0.75"), 90: ("0.05", "0.95"), 95: ("0.025", "0.975")}
"""Per cent → the quantiles at the ends of an interval."""
FFR = "ffr"
LIMIT, CALLED = 0.80, (0.1, 0.9)
"""FFR at or below which a stenosis is significant; P(FFR ≤ 0.80) up to which, and from which, a side is called."""
GREY = (0.75, 0.85)
ZONES = ("below 0.75", "0.75 to 0.85", "above 0.85")
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
"""Edges of the bins of stated probabilities."""
PIT_BINS = 10

Answer = Mapping[str, Any]
"""One quantity of one vessel: `truth`, `quantiles` (share → value) and, for FFR, `below`, the stated P(FFR ≤ 0.80)."""


def summary(lines: Sequence[Mapping[str, Any]]) -> dict:
    """Return all scores of the lines of one setting; the keys are those of the benchmark."""
    finished = [line for line in lines if line["failed"] is None]
    answers = answers_by_quantity(finished)
    ffr = answers.get(FFR, [])
    rhat = [line["rhat_max"] for line in finished if line["rhat_max"] is not None]
    costs = [line["cpu_s"] for line in finished if line["vessels"]]
    return {
        "patients": len(finished),
        "failed": len(lines) - len(finished),
        "vessels": len(ffr),
        "quantities": [{"quantity": name, **intervals(of_it)} for name, of_it in answers.items()],
        "reliability": reliability(ffr),
        "brier": brier(ffr),
        "zones": zones(ffr),
        "rhat_max": {"median": float(np.median(rhat)), "largest": max(rhat)} if rhat else None,
        "converged": sum(line["converged"] is True for line in finished),
        "cpu_s_per_patient": float(np.mean(costs)) if costs else None,
    }


def answers_by_quantity(lines: Iterable[Mapping[str, Any]]) -> dict[str, list[Answer]]:
    """Return quantity → its answers in all vessels of all lines, FFR first."""
    found: dict[str, list[Answer]] = {}
    for line in lines:
        for vessel in line["vessels"].values():
            for name, answer in vessel.items():
                found.setdefault(name, []).append(answer)
    return {name: found[name] for name in sorted(found, key=lambda name: (name != FFR, name))}


def intervals(answers: Sequence[Answer]) -> dict:
    """Return coverage of the intervals, Wilson interval of that of 90 %, mean width and bias of the median, PIT."""
    found: dict = {"vessels": len(answers)}
    for level, ends in LEVELS.items():
        found[f"coverage_{level}"] = float(np.mean([_holds(answer, ends) for answer in answers]))
        share = wilson(sum(_holds(answer, ends) for answer in answers), len(answers))
        found |= {f"low_{level}": share["low"], f"high_{level}": share["high"]}
    low, high = LEVELS[90]
    widths = [answer["quantiles"][high] - answer["quantiles"][low] for answer in answers]
    errors = [answer["quantiles"]["0.50"] - answer["truth"] for answer in answers]
    places = [pit(answer["truth"], answer["quantiles"]) for answer in answers]
    counts, _ = np.histogram(places, bins=PIT_BINS, range=(0.0, 1.0))
    return found | {
        "mean_width_90": float(np.mean(widths)), "bias": float(np.mean(errors)),
        "rms_error": float(np.sqrt(np.mean(np.square(errors)))), "pit": counts.tolist(),
    }  # fmt: skip


def _holds(answer: Answer, ends: tuple[str, str]) -> bool:
    return answer["quantiles"][ends[0]] <= answer["truth"] <= answer["quantiles"][ends[1]]


def pit(truth: float, quantiles: Mapping[str, float]) -> float:
    """Return the stated probability that the quantity is at or below its true value.

    Between the stated quantiles their normal scores are linear in the value; beyond the outermost ones the line through
    the two last goes on. Quantiles that cross, by their numerical error, are put in order.
    """
    shares = sorted(quantiles, key=float)
    scores = ndtri(np.array(shares, float))
    values = np.maximum.accumulate([quantiles[share] for share in shares])
    rising = np.r_[True, np.diff(values) > 0.0]
    if rising.sum() < 2:
        return 0.5 * (float(truth >= values[0]) + float(truth > values[0]))
    values, scores = values[rising], scores[rising]
    k = int(np.clip(np.searchsorted(values, truth), 1, len(values) - 1))
    slope = (scores[k] - scores[k - 1]) / (values[k] - values[k - 1])
    return float(ndtr(scores[k - 1] + slope * (truth - values[k - 1])))


def brier(answers: Sequence[Answer]) -> float | None:
    """Return the mean squared difference of P(FFR ≤ 0.80) from what is true (Brier 1950)."""
    if not answers:
        return None
    return float(np.mean([(answer["below"] - (answer["truth"] <= LIMIT)) ** 2 for answer in answers]))


def reliability(answers: Sequence[Answer]) -> list[dict]:
    """Return per bin of stated probability, the upper edge included, its mean and how often it was true."""
    rows = []
    for low, high in zip(BINS, BINS[1:], strict=False):
        mine = [a for a in answers if low < a["below"] <= high or a["below"] == low == 0.0]
        if mine:
            share = wilson(sum(a["truth"] <= LIMIT for a in mine), len(mine))
            rows.append(
                {
                    "bin_low": low,
                    "bin_high": high,
                    "stated": float(np.mean([a["below"] for a in mine])),
                    "observed": share["share"],
                    "observed_low": share["low"],
                    "observed_high": share["high"],
                    "vessels": len(mine),
                }
            )
    return rows


def zone(ffr: float) -> str:
    """Return the zone of a true FFR; both limits of the grey zone belong to it."""
    return ZONES[int(ffr >= GREY[0]) + int(ffr > GREY[1])]


def verdict(answer: Answer) -> str:
    """Return `undecided`, or whether the side called with a probability of 90 % is `right` or `wrong`."""
    if CALLED[0] < answer["below"] < CALLED[1]:
        return "undecided"
    return "right" if (answer["below"] >= CALLED[1]) == (answer["truth"] <= LIMIT) else "wrong"


def zones(answers: Sequence[Answer]) -> list[dict]:
    """Count the verdicts by zone of the true FFR."""
    rows = []
    for name in ZONES:
        mine = [verdict(answer) for answer in answers if zone(answer["truth"]) == name]
        counts = {kind: mine.count(kind) for kind in ("right", "undecided", "wrong")}
        rows.append({"zone": name, "vessels": len(mine), **counts})
    return rows
