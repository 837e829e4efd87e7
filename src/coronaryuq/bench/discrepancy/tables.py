"""Tables of the benchmark's cases: fractions of correct answers with intervals, cells, and first answers.

A case is one entry of `coronaryuq bench discrepancy`; cases of several networks, strengths and noises are combined.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

from coronaryuq.bench.discrepancy.hidden_cases import WITH_STENOSIS
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import write_csv

OPEN_LOOP = "open loop"
"""Name of the network without cases with a known stenosis."""
TARGETS = {
    "correct effect (or its class) first": (0.95, 1.0),
    "correct location": (0.90, 1.0),
    "coverage of the 90 % interval": (0.85, 0.95),
    "false alarm, nothing hidden": (0.0, 0.05),
    "“something else” outside the library": (0.85, 1.0),
    "both effects named": (0.80, 1.0),
    "≥ 90 % of the true effect's reduction of held-out misfit": (0.90, 1.0),
    "named effects predict worse than recalibration": (0.0, 0.0),
}
"""Target range of each fraction."""


def chosen(cases: Iterable[dict], network: str, strength: str = "medium", noise: str = "nominal") -> list[dict]:
    """Select the searched cases of a network.

    Cases of a closed loop with a known stenosis exist at one strength and half the nominal noise only, and count as
    medium and nominal.
    """
    searched = [c for c in cases if c["network"] == network and not c.get("skipped")]
    strengths = (strength, "none") if strength == "medium" else (strength,)
    stenosed = [c for c in searched if network != OPEN_LOOP and c["effect"].removeprefix("outside:") in WITH_STENOSIS]
    usual = [c for c in searched if c["noise"] == noise and c["strength"] in strengths and c not in stenosed]
    return usual + (stenosed if (strength, noise) == ("medium", "nominal") else [])


def measures(cases: Sequence[dict]) -> dict[str, tuple[int, int]]:
    """Count successes and trials of every measure, by the names of `TARGETS`."""
    nothing = [c for c in cases if c["effect"] == "none"]
    outside = [c for c in cases if c["effect"].startswith("outside")]
    double = [c for c in cases if is_pair(c)]
    single = [c for c in cases if not (is_pair(c) or c["effect"] == "none" or c["effect"].startswith("outside"))]
    shares = [closed(c) for c in single + double]
    outcomes = [
        [c["named"] for c in single],
        [c["placed"] for c in single],
        [c["covered"] for c in single if c.get("covered") is not None],
        [c["alarmed"] for c in nothing],
        [c["abstained"] for c in outside],
        [c["named"] for c in double],
        [s >= 0.9 for s in shares if s is not None],
        [c["worse"] for c in cases if names_something(c) and c.get("worse") is not None],
    ]
    return {name: (sum(map(bool, held)), len(held)) for name, held in zip(TARGETS, outcomes, strict=True)}


def is_pair(case: dict) -> bool:
    """Whether two effects are hidden."""
    return "+" in case["effect"]


def closed(case: dict) -> float | None:
    """Return the fraction of the gap closed over that of the true effect; None if that closes almost nothing."""
    if case.get("gap_closed_over_oracle") is not None or case.get("oracle") is None:
        return case.get("gap_closed_over_oracle")
    room = case["before"] ** 2 - case["oracle"] ** 2
    return (case["before"] ** 2 - case["after"] ** 2) / room if room > 0.1 else None


def right(case: dict) -> bool:
    """Whether an answer is right: named and placed, both of two named, or “something else” outside the library."""
    if case["effect"] == "none":
        return not case["alarmed"]
    if case["effect"].startswith("outside"):
        return case["abstained"]
    return case["named"] and (case["placed"] or is_pair(case))


def in_order(effects: Iterable[str]) -> list[str]:
    """Return each effect once: single effects in their order, pairs, effects outside the library."""
    return sorted(dict.fromkeys(effects), key=lambda effect: (effect.startswith("outside"), "+" in effect))


def shares(parts: Mapping[str, Sequence[dict]]) -> pd.DataFrame:
    """Return a row per measure and part with trials: successes, trials, fraction, 95 % Wilson interval, target."""
    rows = []
    for name, (least, most) in TARGETS.items():
        for part, selected in parts.items():
            held, trials = measures(selected)[name]
            if trials:
                interval = wilson(held, trials)
                row = {"tested": name, "on": part, "held": held, "fraction": interval.pop("share")} | interval
                rows.append(row | {"target_from": least, "target_to": most})
    columns = ["tested", "on", "held", "trials", "fraction", "low", "high", "target_from", "target_to"]
    return pd.DataFrame(rows, columns=columns)


def answers(cases: Sequence[dict]) -> pd.DataFrame:
    """Count the first answers for each hidden effect and network, at medium strength and nominal noise."""
    rows = []
    for network in dict.fromkeys(c["network"] for c in cases):
        selected = chosen(cases, network)
        for effect in in_order(c["effect"] for c in selected):
            firsts = [c["first"] for c in selected if c["effect"] == effect]
            for first in dict.fromkeys(firsts):
                rows.append({"network": network, "hidden": effect, "named": first, "cases": firsts.count(first)})
    return pd.DataFrame(rows, columns=["network", "hidden", "named", "cases"])


def cells(cases: Sequence[dict]) -> pd.DataFrame:
    """Count the right answers of every cell. skipped: cases without a detectable place."""
    keys = ["network", "effect", "strength", "noise"]
    rows = []
    for key in dict.fromkeys(tuple(c[name] for name in keys) for c in cases):
        cell = [c for c in cases if tuple(c[name] for name in keys) == key]
        searched = [c for c in cell if not c.get("skipped")]
        cost = sum(c["cpu_s"] for c in searched) / len(searched) if searched else None
        counts = {"right": sum(map(right, searched)), "cases": len(searched), "skipped": len(cell) - len(searched)}
        rows.append(dict(zip(keys, key, strict=True)) | counts | {"cpu_s": cost})
    return pd.DataFrame(rows, columns=[*keys, "right", "cases", "skipped", "cpu_s"])


def tabulate(results: Sequence[str | Path], shares_csv: Path, cells_csv: Path, answers_csv: Path) -> None:
    """Write the cases of several runs of the benchmark (its JSON) as three tables."""
    cases = [case for path in results for case in read_json(path)["cases"]]
    parts = {network: chosen(cases, network) for network in dict.fromkeys(c["network"] for c in cases)}
    write_csv(shares_csv, shares(parts))
    write_csv(cells_csv, cells(cases))
    write_csv(answers_csv, answers(cases))


def names_something(case: dict) -> bool:
    """Whether an answer names an effect; otherwise it equals recalibration."""
    return case["alarmed"] and not case["abstained"]


def wilson(successes: float, trials: float) -> dict:
    """Return a fraction with its 95 % interval (Wilson 1927); of weighted cases, by effective numbers."""
    if trials == 0:
        return {"share": None, "low": None, "high": None, "trials": 0}
    share, square = successes / trials, float(stats.norm.ppf(0.975)) ** 2
    centre = (successes + 0.5 * square) / (trials + square)
    half = np.sqrt(square * (share * (1.0 - share) * trials + 0.25 * square)) / (trials + square)
    return {"share": share, "low": float(centre - half), "high": float(centre + half), "trials": trials}
