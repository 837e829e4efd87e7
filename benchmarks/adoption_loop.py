"""Add cases of `coronaryuq bench discrepancy --loop` to adoption-loop.jsonl, and their scores to docs/explanation.

Arguments: NETWORK=FILE, files that the benchmark wrote (`--resume`), or none. A case of the same network, effect and
seed that is there already is replaced.
"""

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from coronaryuq.bench.discrepancy.loop import MODELS, NEGLIGIBLE, summary

FOLDER = Path(__file__).parent
CASES, PAGE = FOLDER / "adoption-loop.jsonl", FOLDER.parent / "docs" / "explanation" / "adoption.md"
LOOKED_AT = {"small loop": range(200, 204)}
"""Seeds after which the posterior of the benchmark was changed."""
START, END = "<!-- loop -->", "<!-- end of loop -->"


def read(name: str, file: Path) -> list[dict[str, Any]]:
    """Return the cases of a file of the benchmark, with the network's name."""
    lines = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return [{"network": name, **line["entry"]} for line in lines if "entry" in line]


def joined(added: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    old = map(json.loads, CASES.read_text(encoding="utf-8").splitlines()) if CASES.exists() else []
    found = {(one["network"], one["seed"], one["effect"]): one for one in [*old, *added]}
    return [found[key] for key in sorted(found)]


def held(score: dict[str, Any], prefix: str = "") -> str:
    shares = [score[f"{prefix}coverage_90_{when}"] for when in MODELS]
    counts = ", ".join(f"{share['share'] * share['trials']:.0f}" for share in shares)
    return f"{counts} of {shares[0]['trials']}"


def same_as_before(case: dict[str, Any]) -> bool:
    """Return whether the adopted model predicts as the searched one: nothing was adopted."""
    return case["after"]["ffr"]["median"] == case["before"]["ffr"]["median"]


def table(cases: list[dict[str, Any]]) -> list[str]:
    sets = {}
    for network in dict.fromkeys(case["network"] for case in cases):
        own = [case for case in cases if case["network"] == network]
        sets[network] = own
        if network in LOOKED_AT:
            unseen = [case for case in own if case["seed"] not in LOOKED_AT[network]]
            sets[f"{network}, without seeds {LOOKED_AT[network][0]} to {LOOKED_AT[network][-1]}"] = unseen
    columns = {name: column(some) for name, some in sets.items()}
    rows = [
        f"| {label} | " + " | ".join(of[label] for of in columns.values()) + " |"
        for label in next(iter(columns.values()))
    ]
    return ["| | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns), *rows]


def column(cases: list[dict[str, Any]]) -> dict[str, str]:
    """Return what the table says of some cases, by label."""
    score = summary(cases)
    others = [case for case in cases if "failed" not in case and not case["named_right"]]
    nothing = sum(map(same_as_before, others))
    right, after, ratio = score["named_right"], score["coverage_90_after"], score["error_over_truth"]
    errors = {kind: ", ".join(f"{score[f'{kind}_error_{when}']:.3f}" for when in MODELS) for kind in ("ffr", "flow")}
    seeds = sorted({case["seed"] for case in cases})
    return {
        "cases; seeds": f"{score['cases']}; {seeds[0]} to {seeds[-1]}",
        "effect named right; nothing adopted; another effect adopted": f"{right}; {nothing}; {len(others) - nothing}",
        "FFR error before, after, with the truth": errors["ffr"],
        "FFR in range before, after, with the truth": held(score),
        "the same after adoption, Wilson as if independent": (
            f"{100 * after['share']:.0f} % ({100 * after['low']:.0f} to {100 * after['high']:.0f})"
        ),
        "flow error (relative) before, after, with the truth": errors["flow"],
        "flow in range before, after, with the truth": held(score, "flow_"),
        "named right: FFR error at most a tenth above that with the truth": f"{score['as_truth']} of {right}",
        "the reverse: error with the truth at most a tenth above": f"{score['truth_as_adopted']} of {right}",
        "named right, all cases: FFR error over that with the truth (95 % interval)": (
            f"{ratio['ratio']:.2f} ({ratio['low']:.2f} to {ratio['high']:.2f})" if ratio and "low" in ratio else "–"
        ),
        f"FFR error above that before adoption by more than {NEGLIGIBLE}": (
            f"{score['worse']} of {score['cases'] - score['failed']}"
        ),
    }


def main(arguments: list[str]) -> None:
    given = (argument.split("=", 1) for argument in arguments)
    cases = joined(case for name, file in given for case in read(name, Path(file)))
    CASES.write_text("".join(json.dumps(case) + "\n" for case in cases), encoding="utf-8")
    before, rest = PAGE.read_text(encoding="utf-8").split(START)
    page = [before.rstrip("\n"), "", START, *table(cases), END + rest.split(END)[1]]
    PAGE.write_text("\n".join(page), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
