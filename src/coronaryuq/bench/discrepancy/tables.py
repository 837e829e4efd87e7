"""Tables of hidden cases: shares of right answers with their intervals, cells, and what was named for what.

A case is one entry of `coronaryuq bench discrepancy`; cases of several networks, strengths and noises go together.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

from coronaryuq.bench.discrepancy.hidden_cases import BESIDE_A_STENOSIS
from coronaryuq.bench.discrepancy.score import names_something, wilson
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import write_csv

OPEN_LOOP = "open loop"
"""The network none of whose cases is hidden beside a known stenosis."""
WANTED = {
    "right name (or its class) first": (0.95, 1.0),
    "right place": (0.90, 1.0),
    "90 % interval holds the size": (0.85, 0.95),
    "false alarm, nothing hidden": (0.0, 0.05),
    "abstention outside the library": (0.85, 1.0),
    "both of two effects named": (0.80, 1.0),
    "≥ 90 % of the gap closed that the true effect closes": (0.90, 1.0),
    "named, and worse than recalibration": (0.0, 0.0),
}
"""Share wanted of each measure, from and to."""


def chosen(cases: Iterable[dict], network: str, strength: str = "medium", noise: str = "nominal") -> list[dict]:
    """Searched cases of a network.

    What a closed loop has beside a known stenosis is made at one strength and noise only, half of the nominal one, and
    counts at medium and nominal.
    """
    mine = [c for c in cases if c["network"] == network and not c.get("skipped")]
    strengths = (strength, "none") if strength == "medium" else (strength,)
    beside = [c for c in mine if network != OPEN_LOOP and c["effect"].removeprefix("outside:") in BESIDE_A_STENOSIS]
    usual = [c for c in mine if c["noise"] == noise and c["strength"] in strengths and c not in beside]
    return usual + (beside if (strength, noise) == ("medium", "nominal") else [])


def measures(cases: Sequence[dict]) -> dict[str, tuple[int, int]]:
    """Successes and trials of every measure, by the names of `WANTED`."""
    nothing = [c for c in cases if c["effect"] == "none"]
    outside = [c for c in cases if c["effect"].startswith("outside")]
    double = [c for c in cases if is_pair(c)]
    single = [c for c in cases if not (is_pair(c) or c["effect"] == "none" or c["effect"].startswith("outside"))]
    shares = [closed(c) for c in single + double]
    found = [
        [c["named"] for c in single],
        [c["placed"] for c in single],
        [c["covered"] for c in single if c.get("covered") is not None],
        [c["alarmed"] for c in nothing],
        [c["abstained"] for c in outside],
        [c["named"] for c in double],
        [s >= 0.9 for s in shares if s is not None],
        [c["worse"] for c in cases if names_something(c) and c.get("worse") is not None],
    ]
    return {name: (sum(map(bool, held)), len(held)) for name, held in zip(WANTED, found, strict=True)}


def is_pair(case: dict) -> bool:
    return "+" in case["effect"]


def closed(case: dict) -> float | None:
    """Share of the gap closed, of what the true effect closes; None where that is next to nothing."""
    if case.get("gap_closed_over_oracle") is not None or case.get("oracle") is None:
        return case.get("gap_closed_over_oracle")
    room = case["before"] ** 2 - case["oracle"] ** 2
    return (case["before"] ** 2 - case["after"] ** 2) / room if room > 0.1 else None


def right(case: dict) -> bool:
    """Named and placed; both of two named; nothing named where nothing in the library is hidden."""
    if case["effect"] == "none":
        return not case["alarmed"]
    if case["effect"].startswith("outside"):
        return case["abstained"]
    return case["named"] and (case["placed"] or is_pair(case))


def in_order(effects: Iterable[str]) -> list[str]:
    """Each effect once: singles as they come, pairs, what is outside the library."""
    return sorted(dict.fromkeys(effects), key=lambda effect: (effect.startswith("outside"), "+" in effect))


def shares(parts: dict[str, Sequence[dict]]) -> pd.DataFrame:
    """One row per measure and part that has trials of it: successes, trials, share, 95 % interval (Wilson), wanted."""
    rows = []
    for name, (least, most) in WANTED.items():
        for part, mine in parts.items():
            held, trials = measures(mine)[name]
            if trials:
                told = {"tested": name, "on": part, "held": held} | wilson(held, trials)
                rows.append(told | {"wanted_from": least, "wanted_to": most})
    columns = ["tested", "on", "held", "trials", "share", "low", "high", "wanted_from", "wanted_to"]
    return pd.DataFrame(rows, columns=columns)


def answers(cases: Sequence[dict]) -> pd.DataFrame:
    """How often which effect was named first for which, network by network, at medium strength and nominal noise."""
    rows = []
    for network in dict.fromkeys(c["network"] for c in cases):
        mine = chosen(cases, network)
        for effect in in_order(c["effect"] for c in mine):
            firsts = [c["first"] for c in mine if c["effect"] == effect]
            for first in dict.fromkeys(firsts):
                rows.append({"network": network, "hidden": effect, "named": first, "cases": firsts.count(first)})
    return pd.DataFrame(rows, columns=["network", "hidden", "named", "cases"])


def cells(cases: Sequence[dict]) -> pd.DataFrame:
    """Right answers of every cell: network, effect, strength, noise; skipped: no place tried left a trace."""
    keys = ["network", "effect", "strength", "noise"]
    rows = []
    for key in dict.fromkeys(tuple(c[name] for name in keys) for c in cases):
        mine = [c for c in cases if tuple(c[name] for name in keys) == key]
        searched = [c for c in mine if not c.get("skipped")]
        told = {"right": sum(map(right, searched)), "cases": len(searched), "skipped": len(mine) - len(searched)}
        told["cpu_s"] = sum(c["cpu_s"] for c in searched) / len(searched) if searched else None
        rows.append(dict(zip(keys, key, strict=True)) | told)
    return pd.DataFrame(rows, columns=[*keys, "right", "cases", "skipped", "cpu_s"])


def tabulate(found: Sequence[str | Path], shares_csv: Path, cells_csv: Path, answers_csv: Path) -> None:
    """Cases of several runs of the benchmark (its JSON) as three tables."""
    cases = [case for path in found for case in read_json(path)["cases"]]
    parts = {network: chosen(cases, network) for network in dict.fromkeys(c["network"] for c in cases)}
    write_csv(shares_csv, shares(parts))
    write_csv(cells_csv, cells(cases))
    write_csv(answers_csv, answers(cases))
