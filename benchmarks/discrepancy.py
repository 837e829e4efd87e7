"""Add cases of `coronaryuq bench discrepancy` to discrepancy-cases.jsonl, and their results to the documentation.

Arguments: NETWORK=FILE for further cases, one JSON object per line as the benchmark writes them to standard error. An
existing case of the same network, effect, strength, noise and seed is replaced. `scores FILE...` prints the scores of
files of cases instead: right answers and cost by kind, reliability, Brier score, coverage by cell, detection curve.
`rivals` lets other methods answer the cases of the open loop, into discrepancy-rivals.jsonl; it resumes where it ended.
`patient FILE` writes the loop of the second patient.
"""

import hashlib
import json
import sys
import tempfile
from pathlib import Path

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import LIBRARY, Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.reliability import markdown
from coronaryuq.bench.discrepancy.rivals.compare import (
    OURS,
    ahead,
    compared,
    every_rival,
    rival_trial,
    side_by_side,
)
from coronaryuq.bench.discrepancy.rivals.findings import findings
from coronaryuq.bench.discrepancy.tables import (
    TARGETS,
    answers,
    chosen,
    in_order,
    is_pair,
    measures,
    right,
    shares,
    wilson,
)
from coronaryuq.bench.endtoend.patients import draw
from coronaryuq.core.io.tables import write_csv
from coronaryuq.figures.discrepancy_benchmark import cell_label, hidden_effects
from coronaryuq.figures.discrepancy_rivals import rivals as draw_rivals
from coronaryuq.report.discrepancy_benchmark import target
from coronaryuq.synthetic.truth import patient_of
from coronaryuq.zerod.network.read import write_network

FOLDER = Path(__file__).parent
DOCS = FOLDER.parent / "docs"
CASES = FOLDER / "discrepancy-cases.jsonl"
GUIDE = DOCS / "how-to" / "discrepancy.md"
PAGE = DOCS / "evidence" / "discrepancy-benchmark.md"
PICTURE = DOCS / "pictures" / "discrepancy-benchmark.png"
RIVALS, RIVALS_PICTURE = FOLDER / "discrepancy-rivals.jsonl", DOCS / "pictures" / "discrepancy-rivals.png"
ONE_IN = 20
"""Cases of the open loop of which the rivals answer one, drawn by a digest of the case."""
NETWORKS = ("open loop", "small loop", "bundled patient", "second patient", "22 outlets")
SECOND_PATIENT = (1, 2)
"""Seed and number of that patient in `bench endtoend`: three stenoses, two of them severe."""
KEPT = "network effect strength noise seed places visible first classes named placed alarmed abstained covered before "
KEPT += "after oracle gap_closed_over_oracle worse held_out_p probability made_by cpu_s cpu_s_made skipped redrawn"
KEPT = KEPT.split()
DIGITS = {
    "visible": 3,
    "before": 4,
    "after": 4,
    "oracle": 4,
    "gap_closed_over_oracle": 4,
    "cpu_s": 3,
    "cpu_s_made": 3,
    "probability": 4,
}


def read(path: str | Path) -> list[dict]:
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    found = [json.loads(line) for line in lines if line.startswith("{")]
    return [case for case in found if "effect" in case]


def key(case: dict) -> tuple:
    return tuple(case.get(name) for name in ("network", "effect", "strength", "noise", "seed"))


def kept(case: dict, network: str) -> dict:
    """Keep the fields that the tables need; classes only if they have more than the first name."""
    found = {name: case[name] for name in KEPT if case.get(name) is not None} | {"network": network}
    for name, digits in DIGITS.items():
        if name in found:
            found[name] = float(f"{found[name]:.{digits}g}")
    return {name: found[name] for name in KEPT if name in found}


def merged(cases: list[dict], more: list[dict]) -> list[dict]:
    found = {key(case): case for case in cases} | {key(case): case for case in more}
    return sorted(found.values(), key=lambda c: (NETWORKS.index(c["network"]), c.get("seed") or 0))


def totals(cases: list[dict]) -> list[str]:
    lines = ["| tested | on | cases | fraction | 95 % interval (Wilson) | target |", "|---|---|---|---|---|---|"]
    before = None
    for one in shares({name: chosen(cases, name) for name in NETWORKS}).itertuples():
        first = one.tested != before
        lines.append(
            f"| {one.tested if first else ''} | {one.on} | {one.held} of {one.trials} | {one.fraction:.3f} | "
            f"{one.low:.3f} to {one.high:.3f} | {target(one.target_from, one.target_to) if first else ''} |"
        )
        before = one.tested
    return lines


def costs(cases: list[dict]) -> list[str]:
    """CPU seconds of a search, mean and largest, by hidden effect."""
    kinds = {
        "nothing hidden": lambda c: c["effect"] == "none",
        "one effect": lambda c: c["effect"] != "none" and not is_pair(c) and not c["effect"].startswith("outside"),
        "two effects": is_pair,
        "outside the library": lambda c: c["effect"].startswith("outside"),
    }
    lines = ["| CPU s of a search: mean, largest | " + " | ".join(kinds) + " |", "|---|" + "---|" * len(kinds)]
    for network in NETWORKS:
        spent = [[c["cpu_s"] for c in chosen(cases, network) if of_kind(c)] for of_kind in kinds.values()]
        row = [
            ", ".join(f"{v:.0f}" if v > 10 else f"{v:.1f}" for v in (sum(s) / len(s), max(s))) if s else ""
            for s in spent
        ]
        lines.append(f"| {network} | " + " | ".join(row) + " |")
    return lines


def summary(cases: list[dict]) -> list[str]:
    """Medium strength, nominal noise."""
    parts = {name: chosen(cases, name) for name in NETWORKS}
    lines = ["| tested | " + " | ".join(parts) + " | target |", "|---|" + "---|" * (len(parts) + 1)]
    for name, sought in TARGETS.items():
        row = []
        for held, trials in (measures(mine)[name] for mine in parts.values()):
            share = wilson(held, trials)
            row.append(f"{held} of {trials} ({share['low']:.3f} to {share['high']:.3f})" if trials else "–")
        lines.append(f"| {name} | " + " | ".join(row) + f" | {target(*sought)} |")
    return lines


def cells(cases: list[dict]) -> list[str]:
    """Count correct answers, effect by effect, at medium strength and nominal noise."""
    lines = ["| hidden | " + " | ".join(NETWORKS) + " |", "|" + "---|" * (len(NETWORKS) + 1)]
    for effect in in_order(c["effect"] for n in NETWORKS for c in chosen(cases, n)):
        row = []
        for network in NETWORKS:
            mine = [c for c in chosen(cases, network) if c["effect"] == effect]
            row.append(f"{sum(map(right, mine))} of {len(mine)}" if mine else "")
        lines.append(f"| {cell_label(effect)} | " + " | ".join(row) + " |")
    return lines


def misses(cases: list[dict]) -> list[str]:
    """Every wrong answer, with the first name in place of the hidden effect."""
    columns = ["on", "hidden", "strength, noise", "detectable signal, noise sd", "answer", "seed"]
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for case in (c for c in cases if not c.get("skipped") and not right(c)):
        places = " and ".join(f"`{place}`" for place in dict.fromkeys(case.get("places", [])))
        hidden = f"{cell_label(case['effect'])}{', ' * bool(places)}{places}"
        beside = ", with a known stenosis" if case["network"] != NETWORKS[0] and case["noise"] == "half" else ""
        size = "–" if case["strength"] == "none" else f"{case['strength']}, {case['noise']}"
        row = (case["network"], hidden + beside, size, _rounded(case["visible"]), answered(case), str(case["seed"]))
        lines.append("| " + " | ".join(row) + " |")
    return lines


def untested(cases: list[dict]) -> list[str]:
    """Name the effects of the library that no searched case of this page hides."""
    hidden = {effect for c in cases if not c.get("skipped") for effect in c["effect"].split("+")}
    missing = [cell_label(effect.name) for effect in LIBRARY if effect.name not in hidden]
    return [f"Effects of the library that are hidden in no case of this page: {', '.join(missing) or 'none'}."]


def _rounded(signal: float) -> str:
    return f"{signal:.1f}" if signal < 10.0 else f"{signal:.0f}"


def answered(case: dict) -> str:
    """Return the first named effect of each class, or “something else” or “nothing”."""
    first = [members[0].split("@") for members in case.get("classes", [])]
    if first:
        return " and ".join(f"{cell_label(name)}, `{place}`" for name, place in first)
    return "something else" if case["alarmed"] else "nothing"


def picture(cases: list[dict]) -> None:
    """Draw hidden against first named effects on the open loop, and every network's fractions with intervals."""
    with tempfile.TemporaryDirectory() as name:
        tables = [Path(name) / table for table in ("shares.csv", "answers.csv")]
        write_csv(tables[0], shares({network: chosen(cases, network) for network in NETWORKS}))
        write_csv(tables[1], answers(cases))
        hidden_effects(*map(str, tables), output=str(PICTURE))


def to_answer(cases: list[dict]) -> list[dict]:
    """Return a random sample of the searched cases of the open loop, for the rivals to answer."""

    def drawn(case: dict) -> bool:
        return int(hashlib.sha256(json.dumps(key(case)).encode()).hexdigest(), 16) % ONE_IN == 0

    return [case for case in of_open_loop(cases) if drawn(case)]


def of_open_loop(cases: list[dict]) -> list[dict]:
    """Return the searched cases of the open loop."""
    return [case for case in cases if case["network"] == NETWORKS[0] and not case.get("skipped")]


def made_again(case: dict) -> Case:
    """Return the case of an entry."""
    outside = case["effect"].removeprefix("outside:") if case["effect"].startswith("outside:") else ""
    effects = () if outside or case["effect"] == "none" else tuple(case["effect"].split("+"))
    return Case(effects, case["strength"], case["noise"], case["seed"], outside)


def answer_rivals(cases: list[dict]) -> None:
    """Let the rivals answer the cases that they have not answered yet."""
    answered = {key(case) for case in (read(RIVALS) if RIVALS.exists() else [])}
    waiting = [case for case in to_answer(cases) if key(case) not in answered]
    experiment = open_loop()
    rivals = every_rival(experiment, NATURE) if waiting else []
    for case in waiting:
        entry = rival_trial(made_again(case), experiment, NATURE, rivals)
        assert entry is not None, case
        for answer in entry.get("answers", {}).values():
            answer["cpu_s"] = float(f"{answer['cpu_s']:.3g}")
        with RIVALS.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"network": case["network"]} | entry, default=float) + "\n")


def against_rivals(cases: list[dict]) -> list[str]:
    """Return the outcomes of every method by group, and by how much ours is ahead over all cases."""
    rows = side_by_side(read(RIVALS), cases)
    columns = [
        "hidden",
        "method",
        "right",
        "95 % interval",
        "nothing else named",
        "wrong name",
        "missed",
        "false alarm",
    ]
    lines = ["| " + " | ".join([*columns, "CPU s"]) + " |", "|" + "---|" * (len(columns) + 1)]
    before = None
    for row in compared(rows).to_dict("records"):
        first, before = row["group"] != before, row["group"]
        shown = (f"{row['right']} of {row['cases']}", f"{row['low']:.3f} to {row['high']:.3f}", row["alone"])
        counts = (row["wrong name"], row["missed"], row["false alarm"], f"{row['cpu_s']:.1f}")
        lines.append("| " + " | ".join(map(str, (before if first else "", row["method"], *shown, *counts))) + " |")
    columns = ["points, in the proportions of all recorded cases", "95 % interval", "points, these cases"]
    columns = [f"right answers of {OURS} minus", *columns, "95 % interval", "right alone: ours, theirs"]
    lines += ["", "| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    for both in zip(ahead(rows, of_open_loop(cases)), ahead(rows), strict=True):
        shown = [
            f"{100.0 * row['difference']:.0f} | {100.0 * row['low']:.0f} to {100.0 * row['high']:.0f}" for row in both
        ]
        alone = f"{both[1]['only_ours']}, {both[1]['only_theirs']}"
        lines.append(f"| {both[0]['method']} | {' | '.join(shown)} | {alone} |")
    return lines


def picture_of_rivals(cases: list[dict]) -> None:
    """Draw the right answers of every method by group."""
    with tempfile.TemporaryDirectory() as name:
        table = Path(name) / "outcomes.csv"
        write_csv(table, compared(side_by_side(read(RIVALS), cases)))
        draw_rivals(str(table), str(RIVALS_PICTURE))


def put(page: str, name: str, lines: list[str]) -> str:
    """Replace the lines between the marks of the page."""
    before, _, rest = page.partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition(f"<!-- end of {name} -->\n")
    assert end, f"the page lacks the marks of {name}"
    return "".join([before, f"<!-- {name} -->\n", "\n".join(lines), "\n", end, after])


def tables(cases: list[dict]) -> list[tuple[Path, str, list[str]]]:
    """Page, name and lines of every table."""
    found = [(GUIDE, "summary", summary(cases)), (PAGE, "totals", totals(cases)), (PAGE, "cells", cells(cases))]
    found.append((PAGE, "untested", untested(cases)))
    # Without the coverage of each cell, which says little for a few cases.
    scores, _, _ = markdown(cases).partition("| network | hidden | strength")
    found.append((PAGE, "scores", scores.rstrip().splitlines()))
    found.append((PAGE, "rivals", against_rivals(cases)))
    others = read(RIVALS)
    found.append((PAGE, "findings", findings(side_by_side(others, cases), others, of_open_loop(cases))))
    return [*found, (PAGE, "misses", misses(cases)), (PAGE, "costs", costs(cases))]


def main(more: list[str]) -> None:
    if more[:1] == ["scores"]:
        print(markdown([case for path in more[1:] for case in read(path)]), end="")
        return
    if more[:1] == ["patient"]:
        drawn = draw(*SECOND_PATIENT, 1.0)
        patient = patient_of(drawn.true, drawn.settings, drawn.seed, drawn.physics)
        write_network(Path(more[1]), patient.rest.network)
        return
    if more[:1] == ["rivals"]:
        more = []
        answer_rivals(read(CASES))
    given = [argument.partition("=") for argument in more]
    cases = merged(read(CASES), [kept(case, network) for network, _, path in given for case in read(path)])
    CASES.write_text("".join(json.dumps(case) + "\n" for case in cases), encoding="utf-8")
    for path, name, lines in tables(cases):
        path.write_text(put(path.read_text(encoding="utf-8"), name, lines), encoding="utf-8")
    picture(cases)
    picture_of_rivals(cases)


if __name__ == "__main__":
    main(sys.argv[1:])
