"""Add cells of the coverage benchmark to estimation-coverage.jsonl and its tables to estimation.md.

Arguments: files with further cells, one JSON object per line (`run_cell` of `bench.estimation.coverage`, with
`first_trial`), or none.
"""

import json
import sys
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

FOLDER = Path(__file__).parent
CELLS, PAGE = FOLDER / "estimation-coverage.jsonl", FOLDER.parent / "docs" / "explanation" / "estimation.md"
METHODS, SIZES, TRIALS = ("MC", "MFMC", "crossfit-GP", "MFMC-AE", "recommended"), (25, 50, 100, 250), 400
LABELS = {"dissimilar inputs": "different inputs", "useless 0D": "uninformative 0D"}
"""Problems with other names on the page; their own names are part of the seeds."""
FORMER = {"crossfit-GP, without logarithm", "crossfit-GP, without extrapolation factor"}
"""Name of the cells of an earlier `crossfit-GP`, used where the present one has not been measured."""
PROBLEMS = ("smooth", "dissimilar inputs", "useless 0D", "non-monotone", "constrained manifold", "long tail")
PROBLEMS += ("lognormal", "rare onset", "indicator", "heteroscedastic noise", "autocorrelated propagation")
PROBLEMS += ("autocorrelated pilot and propagation", "near-duplicates", "short chain")
PROBLEMS += tuple(f"row {number}" for number in range(1, 13))

SUMMARISED = ("recommended", "crossfit-GP")
"""Methods with a line per pilot size of what is outside the targets."""
SHOWN = ("long tail", "dependent samples", "hardly varies", "estimators disagree")
"""Warnings of the table, where at least 5 % of trials have them."""


def read(path: str | Path) -> list[dict]:
    return [json.loads(line) for line in Path(path).read_text(encoding="utf-8").splitlines() if line]


def key(cell: dict) -> tuple:
    """Identify what a cell measures; a former selector's cells count as those of `crossfit-GP`."""
    method = "crossfit-GP" if cell["method"] in FORMER else cell["method"]
    return cell.get("quantity", "mean"), METHODS.index(method), cell["n_3d"], cell["problem"]


def pooled(one: dict, other: dict) -> dict:
    """Merge the cells of two disjoint sets of trials."""
    trials = one["trials"] + other["trials"]
    both = [
        (c["trials"], c["empirical_std"], c["bias_z"] * c["empirical_std"] / np.sqrt(c["trials"])) for c in (one, other)
    ]
    mean = sum(t * m for t, _, m in both) / trials
    spread = np.sqrt(sum((t - 1) * s**2 + t * (m - mean) ** 2 for t, s, m in both) / (trials - 1))
    claims = [c["trials"] * (c["claimed_over_empirical"] * c["empirical_std"]) ** 2 for c in (one, other)]
    held = sum(c["coverage_95"] * c["trials"] for c in (one, other)) / trials
    wilson = wilson_of(held, trials)
    return (
        one
        | {
            "trials": trials,
            "claimed_over_empirical": float(np.sqrt(sum(claims) / trials) / spread),
            "coverage_95": held,
            "coverage_95_error": float(np.sqrt(0.95 * 0.05 / trials)),
            "coverage_95_low": wilson[0],
            "coverage_95_high": wilson[1],
            "bias_z": float(mean / (spread / np.sqrt(trials))),
            "empirical_std": float(spread),
            "first_trial": min(one.get("first_trial", 0), other.get("first_trial", 0)),
        }
        | warnings_of(one, other)
    )


def warnings_of(one: dict, other: dict) -> dict:
    """Merge the fractions of trials with a warning, and how often each estimator was recommended."""
    if "warned" not in one or "warned" not in other:
        return {}
    both = [(cell, cell["trials"] / (one["trials"] + other["trials"])) for cell in (one, other)]
    warned = sum(part * cell["warned"] for cell, part in both)
    found = {"warned": warned, "warned_share": warned}
    if "warnings" in one:
        codes = sorted({*one["warnings"], *other["warnings"]})
        names = sorted({*one["recommended"], *other["recommended"]})
        found["warnings"] = {code: sum(p * cell["warnings"].get(code, 0.0) for cell, p in both) for code in codes}
        found["recommended"] = {name: sum(c["recommended"].get(name, 0) for c in (one, other)) for name in names}
    return found


def merged(cells: list[dict], more: list[dict]) -> list[dict]:
    """Merge further cells into `cells`.

    Trials that follow a cell's own are pooled with it; others replace it if they are no fewer. A cell of the present
    selector replaces one of a former selector.
    """
    found = {}
    for cell in [*cells, *more]:
        had = found.get(key(cell))
        if had is None or is_former(had):
            found[key(cell)] = cell
        elif not is_former(cell) and cell.get("first_trial", 0) == had.get("first_trial", 0) + had["trials"]:
            found[key(cell)] = pooled(had, cell)
        elif not is_former(cell) and cell["trials"] >= had["trials"]:
            found[key(cell)] = cell
    return sorted(found.values(), key=order)


def is_former(cell: dict) -> bool:
    return cell["method"] in FORMER


def order(cell: dict) -> tuple:
    quantity, method, size, problem = key(cell)
    return quantity != "mean", quantity, method, size, PROBLEMS.index(problem)


def wilson_of(held: float, trials: int) -> tuple[float, float]:
    interval = binomtest(round(held * trials), trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)


def shown(cell: dict | None) -> str:
    """Format reported over empirical standard error and coverage in %; bold where either misses its target."""
    if cell is None:
        return "–"
    low, high = wilson_of(cell["coverage_95"], cell["trials"])
    text = f"{cell['claimed_over_empirical']:.2f}, {100 * cell['coverage_95']:.1f}"
    if abs(cell["claimed_over_empirical"] - 1) > 0.15 or high < 0.93:
        text = f"**{text}**"
    for code in SHOWN:
        fraction = cell.get("warnings", {}).get(code, 0.0)
        text += f", {code} {100 * fraction:.0f} %" if fraction >= 0.05 else ""
    if cell["trials"] != TRIALS:
        text += f" ({cell['trials']} trials: {100 * low:.0f} to {100 * high:.0f})"
    return text + (" †" if is_former(cell) else "")


def table(cells: list[dict], method: str) -> list[str]:
    mine = {(key(c)[3], c["n_3d"]): c for c in cells if "quantity" not in c and METHODS[key(c)[1]] == method}
    sizes = [n for n in SIZES if any(size == n for _, size in mine)]
    lines = [f"| {method} | " + " | ".join(f"N_3D = {n}" for n in sizes) + " | largest bias (in standard errors) |"]
    lines.append("|" + "---|" * (len(sizes) + 2))
    for problem in PROBLEMS:
        row = [mine.get((problem, n)) for n in sizes]
        if any(row):
            bias = max((cell["bias_z"] for cell in row if cell), key=abs)
            lines.append(f"| {LABELS.get(problem, problem)} | " + " | ".join(map(shown, row)) + f" | {bias:.1f} |")
    return lines


def summary(cells: list[dict], method: str) -> list[str]:
    """Summarise the cells of one method, size by size; `warned`: the fraction of trials with any warning."""
    lines = [
        "| N_3D | problems | coverage, % | reported / empirical standard error | outside the targets |",
        "|---|---|---|---|---|",
    ]
    for n in SIZES:
        mine = [c for c in cells if c["method"] == method and c["n_3d"] == n and "quantity" not in c]
        if not mine:
            continue
        held, claims = ([c[name] for c in mine] for name in ("coverage_95", "claimed_over_empirical"))
        outside = []
        for cell in mine:
            label = LABELS.get(cell["problem"], cell["problem"])
            low, high = (100 * end for end in wilson_of(cell["coverage_95"], cell["trials"]))
            missed = []
            if not 0.93 <= cell["coverage_95"] <= (0.97 if method == "recommended" else 1.0):
                missed.append(f"{100 * cell['coverage_95']:.1f} % ({low:.1f} to {high:.1f})")
            if abs(cell["claimed_over_empirical"] - 1) > 0.15:
                missed.append(f"standard error {cell['claimed_over_empirical']:.2f}")
            if missed and "warned" in cell:
                missed.append(f"warned {100 * cell['warned']:.0f} %")
            outside += [f"{label} {', '.join(missed)}"] if missed else []
        ranges = f"{100 * min(held):.1f} to {100 * max(held):.1f} | {min(claims):.2f} to {max(claims):.2f}"
        lines.append(f"| {n} | {len(mine)} | {ranges} | {'; '.join(outside) or 'none'} |")
    return lines


PROBABILITIES = {"smooth": "P(Y ≤ 20 % quantile)", "row 8": "P(FFR ≤ 0.80)"}


def beyond_the_mean(cells: list[dict], problem: str) -> list[str]:
    """Quantities other than the mean of one problem."""
    lines = [
        f"| quantity, {problem} | trials | reported / empirical | coverage of 95 %, % (Wilson) | "
        "bias (in standard errors) |",
        "|---|---|---|---|---|",
    ]
    for cell in (c for c in cells if c["problem"] == problem and "quantity" in c):
        low, high = (100 * end for end in wilson_of(cell["coverage_95"], cell["trials"]))
        name = cell["quantity"].replace("sobol theta_", "Sobol index of θ_")
        name = name.replace("probability", PROBABILITIES[problem])
        lines.append(
            f"| {name} | {cell['trials']} | {cell['claimed_over_empirical']:.2f} | {100 * cell['coverage_95']:.1f} "
            f"({low:.1f} to {high:.1f}) | {cell['bias_z']:.1f} |"
        )
    return lines


def put(page: str, name: str, lines: list[str]) -> str:
    """Replace the lines between the marks of the page."""
    before, _, rest = page.partition(f"<!-- {name} -->\n")
    _, end, after = rest.partition(f"<!-- end of {name} -->\n")
    assert end, f"{PAGE.name} lacks the marks of {name}"
    return "".join([before, f"<!-- {name} -->\n", "\n".join(lines), "\n", end, after])


def main(more: list[str]) -> None:
    cells = merged(read(CELLS), [cell for path in more for cell in read(path)])
    CELLS.write_text("".join(json.dumps(cell) + "\n" for cell in cells), encoding="utf-8")
    page = PAGE.read_text(encoding="utf-8")
    for method in METHODS:
        page = put(page, f"coverage of {method}", table(cells, method))
    for method in SUMMARISED:
        page = put(page, f"summary of {method}", summary(cells, method))
    for problem in ("smooth", "row 8"):
        page = put(page, f"beyond the mean, {problem}", beyond_the_mean(cells, problem))
    PAGE.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
