"""Puts cases of `coronaryuq bench discrepancy` into discrepancy-cases.jsonl, and what they say into the documents.

Arguments: NETWORK=FILE for further cases, one JSON object a line as the benchmark writes them to standard error.
A case that is there already, by network, effect, strength, noise and seed, gives way to its new run.
"""

import json
import sys
from pathlib import Path

import numpy as np

from coronaryuq.bench.discovery_score import wilson
from coronaryuq.figures.style import ESTIMATORS, saved

FOLDER = Path(__file__).parent
CASES = FOLDER / "discrepancy-cases.jsonl"
PAGE, GUIDE = FOLDER / "discrepancy-benchmark.md", FOLDER / "discrepancy.md"
PICTURE = FOLDER / "pictures" / "discrepancy-benchmark.png"
NETWORKS = {
    "open loop": ESTIMATORS["MFMC"],
    "bundled patient": ESTIMATORS["MFMC-AE"],
    "another patient": ESTIMATORS["multilevel"],
    "svZeroDSolver test": ESTIMATORS["BLUE"],
    "22 outlets": ESTIMATORS["best"],
}
KEPT = "network effect strength noise seed places visible first classes named placed alarmed abstained covered before "
KEPT = (KEPT + "after oracle gap_closed_over_oracle worse foretold helped cpu_s skipped redrawn").split()
DIGITS = {"visible": 3, "before": 4, "after": 4, "oracle": 4, "gap_closed_over_oracle": 4, "cpu_s": 3}
NOMINAL = ("medium", "nominal")


def read(path: str | Path) -> list[dict]:
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines if line.startswith("{")]


def key(case: dict) -> tuple:
    return tuple(case.get(name) for name in ("network", "effect", "strength", "noise", "seed"))


def kept(case: dict, network: str) -> dict:
    """What the tables are made of; classes only where they say more than the first name."""
    found = {name: case[name] for name in KEPT if case.get(name) is not None} | {"network": network}
    for name, digits in DIGITS.items():
        if name in found:
            found[name] = float(f"{found[name]:.{digits}g}")
    return {name: found[name] for name in KEPT if name in found}


def merged(cases: list[dict], more: list[dict]) -> list[dict]:
    found = {key(case): case for case in cases} | {key(case): case for case in more}
    order = list(NETWORKS)
    return sorted(found.values(), key=lambda c: (order.index(c["network"]), c.get("seed") or 0))


def of(cases: list[dict], network: str, strength: str = "medium", noise: str = "nominal") -> list[dict]:
    """Searched cases of a network. What is hidden beside a known stenosis is strong and at half the noise there."""
    mine = [c for c in cases if c["network"] == network and not c.get("skipped")]
    beside = network != "open loop" and (strength, noise) == NOMINAL
    strengths = (strength, "none") if strength == "medium" else (strength,)
    return [c for c in mine if c["noise"] == noise and c["strength"] in strengths or beside and c["noise"] == "half"]


def singles(cases: list[dict]) -> list[dict]:
    return [c for c in cases if c["effect"] != "none" and not c["effect"].startswith("outside") and not is_pair(c)]


def is_pair(case: dict) -> bool:
    return "+" in case["effect"]


def closed(case: dict) -> float | None:
    """Share of the gap closed, of what the true effect closes."""
    if "gap_closed_over_oracle" in case or "oracle" not in case:
        return case.get("gap_closed_over_oracle")
    room = case["before"] ** 2 - case["oracle"] ** 2
    return (case["before"] ** 2 - case["after"] ** 2) / room if room > 0.1 else None


def measures(cases: list[dict]) -> dict[str, tuple[int, int]]:
    """Successes and trials."""
    single, nothing = singles(cases), [c for c in cases if c["effect"] == "none"]
    outside = [c for c in cases if c["effect"].startswith("outside")]
    shares = [closed(c) for c in single + [c for c in cases if is_pair(c)]]
    found = {
        "right name (or its class) first": [c["named"] for c in single],
        "right place": [c["placed"] for c in single],
        "90 % interval holds the size": [c["covered"] for c in single if "covered" in c],
        "false alarm, nothing hidden": [c["alarmed"] for c in nothing],
        "abstention outside the library": [c["abstained"] for c in outside],
        "both of two effects named": [c["named"] for c in cases if is_pair(c)],
        "≥ 90 % of the gap closed that the true effect closes": [s >= 0.9 for s in shares if s is not None],
        "worse than recalibration": [c["worse"] for c in cases if "worse" in c],
    }
    return {name: (sum(map(bool, held)), len(held)) for name, held in found.items()}


WANTED = {
    "right name (or its class) first": (0.95, 1.0),
    "right place": (0.90, 1.0),
    "90 % interval holds the size": (0.85, 0.95),
    "false alarm, nothing hidden": (0.0, 0.05),
    "abstention outside the library": (0.85, 1.0),
    "both of two effects named": (0.80, 1.0),
    "≥ 90 % of the gap closed that the true effect closes": (0.90, 1.0),
    "worse than recalibration": (0.0, 0.0),
}


def wanted(name: str) -> str:
    low, high = WANTED[name]
    return "0" if high == 0 else f"≥ {low:.2f}" if high == 1.0 else f"≤ {high:.2f}" if low == 0 else f"{low} to {high}"


def totals(cases: list[dict]) -> list[str]:
    lines = ["| tested | on | cases | share | 95 % interval (Wilson) | wanted |", "|---|---|---|---|---|---|"]
    parts = {name: of(cases, name) for name in NETWORKS}
    for strength, noise in (("weak", "nominal"), ("strong", "nominal"), ("medium", "half"), ("medium", "double")):
        told = f"{strength} strength" if noise == "nominal" else f"{noise} noise"
        parts[f"open loop, {told}"] = of(cases, "open loop", strength, noise)
    for name in WANTED:
        asked = wanted(name)
        for part, mine in parts.items():
            held, trials = measures(mine)[name]
            if not trials:
                continue
            share = wilson(held, trials)
            lines.append(
                f"| {name if asked else ''} | {part} | {held} of {trials} | {share['share']:.3f} | "
                f"{share['low']:.3f} to {share['high']:.3f} | {asked} |"
            )
            asked = ""
    return lines


def summary(cases: list[dict]) -> list[str]:
    """Medium strength, nominal noise: the open loop, the bundled patient, all other closed loops together."""
    others = [c for name in list(NETWORKS)[2:] for c in of(cases, name)]
    parts = {name: of(cases, name) for name in list(NETWORKS)[:2]} | {"other loops": others}
    lines = ["| tested | " + " | ".join(parts) + " | wanted |", "|---|" + "---|" * (len(parts) + 1)]
    for name in WANTED:
        row = []
        for held, trials in (measures(mine)[name] for mine in parts.values()):
            share = wilson(held, trials)
            row.append(f"{held} of {trials} ({share['low']:.2f} to {share['high']:.2f})" if trials else "–")
        lines.append(f"| {name} | " + " | ".join(row) + f" | {wanted(name)} |")
    return lines


def cells(cases: list[dict]) -> list[str]:
    """Right answers of cases, effect by effect, at medium strength and nominal noise."""
    lines = ["| hidden | " + " | ".join(NETWORKS) + " |", "|" + "---|" * (len(NETWORKS) + 1)]
    effects = list(dict.fromkeys(c["effect"] for n in NETWORKS for c in of(cases, n)))
    for effect in sorted(effects, key=lambda e: (e.startswith("outside"), "+" in e)):
        row = []
        for network in NETWORKS:
            mine = [c for c in of(cases, network) if c["effect"] == effect]
            row.append(f"{sum(map(right, mine))} of {len(mine)}" if mine else "")
        lines.append(f"| {words(effect)} | " + " | ".join(row) + " |")
    return lines


def each(cases: list[dict], network: str) -> list[str]:
    """Every case of a network by itself."""
    columns = ["hidden", "trace, noise sd", "answer", "candidates in the class", "interval holds"]
    columns += ["held-out misfit before, after, true effect", "CPU-s"]
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for case in of(cases, network):
        places = " and ".join(f"`{place}`" for place in case["places"])
        beside = ", beside a stenosis" if case["noise"] == "half" else ""
        hidden = f"{words(case['effect']).replace('none', 'nothing')}{', ' * bool(places)}{places}{beside}"
        said = words(case["classes"][0][0].split("@")[0]) if case["classes"] else "nothing"
        answer = "right" if right(case) else f"alarm, {said} named" if case["alarmed"] else "no alarm"
        alike = ", ".join(str(len(members)) for members in case["classes"])
        holds = {True: "yes", False: "no", None: ""}[case.get("covered")]
        misfits = ", ".join(f"{case[name]:.2f}" for name in ("before", "after", "oracle") if name in case)
        row = (hidden, f"{case['visible']:.0f}", answer, alike, holds, misfits, f"{case['cpu_s']:.0f}")
        lines.append("| " + " | ".join(row) + " |")
    return lines


def right(case: dict) -> bool:
    """Named and placed; both of two named; nothing named where nothing in the library is hidden."""
    if case["effect"] == "none":
        return not case["alarmed"]
    if case["effect"].startswith("outside"):
        return case["abstained"]
    return case["named"] and (case["placed"] or is_pair(case))


def words(effect: str) -> str:
    return effect.replace("outside:", "outside: ").replace("+", " + ").replace("_", " ")


def picture(cases: list[dict]) -> None:
    """What was hidden and what was named first on the open loop; shares of every network with their intervals."""
    mine = of(cases, "open loop")
    hidden = list(dict.fromkeys(c["effect"] for c in sorted(mine, key=lambda c: (c["effect"] != "none", is_pair(c)))))
    hidden.sort(key=lambda e: (e.startswith("outside"), "+" in e))
    answers = [e for e in hidden if any(c["first"] == e for c in mine)]
    answers += [a for a in dict.fromkeys(c["first"] for c in mine) if a not in answers and a != "outside"] + ["outside"]
    counts = np.array([[sum(c["effect"] == h and c["first"] == a for c in mine) for a in answers] for h in hidden])
    with saved(PICTURE, ncols=2, figsize=(12.5, 9), width_ratios=(2.1, 1)) as (_, (left, side)):
        left.imshow(counts / counts.sum(axis=1, keepdims=True), cmap="Blues", aspect="auto", vmin=0, vmax=1)
        for (row, column), count in np.ndenumerate(counts):
            if count:
                dark = count > 0.5 * counts[row].sum()
                left.text(column, row, count, ha="center", va="center", fontsize=8, color="w" if dark else "k")
        left.set_xticks(range(len(answers)), [words(a) for a in answers], rotation=60, ha="right", fontsize=8)
        left.set_yticks(range(len(hidden)), [words(h) for h in hidden], fontsize=8)
        left.set(xlabel="named first", ylabel="hidden", title="open loop: cases by what was hidden and what was named")
        for spine in left.spines.values():
            spine.set_visible(False)
        for row, name in enumerate(WANTED):
            low, high = WANTED[name]
            side.barh(row, high - low, 0.8, low, color="0.88")
            side.text(0.5, row - 0.46, name, ha="center", va="bottom", fontsize=8)
            for number, (network, colour) in enumerate(NETWORKS.items()):
                held, trials = measures(of(cases, network))[name]
                if trials:
                    share, at = wilson(held, trials), row - 0.3 + 0.15 * number
                    side.plot([share["low"], share["high"]], [at, at], color=colour, lw=1.5)
                    side.plot(share["share"], at, "o", color=colour, ms=4, label=network if row == 0 else None)
        side.set(xlabel="share, 95 % interval; grey: wanted", xlim=(-0.02, 1.02), yticks=[])
        side.set_ylim(len(WANTED) - 0.4, -0.8)
        side.spines["left"].set_visible(False)
        side.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=2, fontsize=8)


def put(page: str, name: str, lines: list[str]) -> str:
    """The page with other lines between its marks."""
    before, _, rest = page.partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition(f"<!-- end of {name} -->\n")
    assert end, f"the page lacks the marks of {name}"
    return "".join([before, f"<!-- {name} -->\n", "\n".join(lines), "\n", end, after])


def tables(cases: list[dict]) -> list[tuple[Path, str, list[str]]]:
    """Page, name and lines of every table."""
    found = [(GUIDE, "summary", summary(cases)), (PAGE, "totals", totals(cases)), (PAGE, "cells", cells(cases))]
    return [*found, (PAGE, "22 outlets", each(cases, "22 outlets"))]


def main(more: list[str]) -> None:
    given = [argument.partition("=") for argument in more]
    cases = merged(read(CASES), [kept(case, network) for network, _, path in given for case in read(path)])
    CASES.write_text("".join(json.dumps(case) + "\n" for case in cases), encoding="utf-8")
    for path, name, lines in tables(cases):
        path.write_text(put(path.read_text(encoding="utf-8"), name, lines), encoding="utf-8")
    picture(cases)


if __name__ == "__main__":
    main(sys.argv[1:])
