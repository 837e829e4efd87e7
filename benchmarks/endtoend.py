"""Add patients of `coronaryuq bench endtoend` to endtoend-patients.jsonl, and their scores to the documentation.

Arguments: files that the benchmark wrote (`--resume`), or none. Patients of the same distributions, settings, seed,
noise and truth are joined; a patient that is there already is replaced.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from coronaryuq.bench.endtoend.benchmark import beside_0d
from coronaryuq.bench.endtoend.score import FFR, LEVELS, LIMIT, PIT_BINS, ZONES, answers_by_quantity, summary
from coronaryuq.figures.style import DARK, MUTED, SIMULATED, saved

FOLDER = Path(__file__).parent
DOCS = FOLDER.parent / "docs"
PATIENTS, PAGE = FOLDER / "endtoend-patients.jsonl", DOCS / "evidence" / "end-to-end.md"
PICTURE = DOCS / "pictures" / "end-to-end.png"
UNSEEN = {f"full, {first} to {first + 49}": range(first, first + 50) for first in (250, 200, 100)}
"""Patients that were run once, the latest first, and not again after later changes; what their rows are called."""
KNOWN = range(100)
"""Patients in which causes of misses were looked for; `full` and `paper` are compared on them."""
START, END = "<!-- scores -->", "<!-- end of scores -->"
COLOURS = (SIMULATED, "#D55E00")
NAMES = {
    FFR: "FFR", "tawss_patch_min": "TAWSS, lowest patch (dyn/cm²)", "tawss_mean": "TAWSS, mean (dyn/cm²)",
    "osi_patch_max": "OSI, highest patch", "osi_mean": "OSI, mean",
}  # fmt: skip
"""Quantities of the table; the lines have all."""


def read(path: Path) -> tuple[dict, list[dict]]:
    head, *lines = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return head, lines


def joined(files: list[Path]) -> tuple[dict, list[dict]]:
    """Return the head and the lines of all files, which must have one head."""
    parts = [read(path) for path in ([PATIENTS] if PATIENTS.exists() else []) + files]
    heads = [head for head, _ in parts]
    if any(head != heads[0] for head in heads):
        sys.exit("the files differ in distributions, settings, seed, noise or truth; join like with like")
    found = {(line["index"], line["setting"]): line for _, lines in parts for line in lines}
    return heads[0], [found[key] for key in sorted(found)]


def percent(row: dict, level: int) -> str:
    return f"{100 * row[f'coverage_{level}']:.0f} ({100 * row[f'low_{level}']:.0f} to {100 * row[f'high_{level}']:.0f})"


def tables(of: dict[str, list[dict]]) -> list[str]:
    scores = {setting: summary(lines) for setting, lines in of.items()}
    lines = [
        "| quantity | setting | in 50 % ranges, % | in 90 % ranges, % | in 95 % ranges, % | mean width of 90 % ranges "
        "| bias and RMS error of the median |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, text in NAMES.items():
        for setting, its in scores.items():
            row = next((row for row in its["quantities"] if row["quantity"] == name), None)
            if row is not None:
                held = " | ".join(percent(row, level) for level in LEVELS)
                errors = f"{row['bias']:+.2g}, {row['rms_error']:.2g}".replace("-", "−")
                lines.append(f"| {text} | `{setting}` | {held} | {row['mean_width_90']:.2g} | {errors} |")
    lines += ["", "| | " + " | ".join(f"`{setting}`" for setting in of) + " |", "|---|" + "---|" * len(of)]

    def add(text: str, value: Callable[[dict], str]) -> None:
        lines.append(f"| {text} | " + " | ".join(value(its) for its in scores.values()) + " |")

    add("patients; failed; stenoses", lambda its: f"{its['patients']}; {its['failed']}; {its['vessels']}")
    add("Brier score of P(FFR ≤ 0.80)", lambda its: f"{its['brier']:.3f}")
    for number, zone in enumerate(ZONES):
        verdicts = "{right}, {undecided}, {wrong}"
        text = f"true FFR {zone}: right, undecided, wrong at 90 %"
        add(text, lambda its, k=number, v=verdicts: v.format(**its["zones"][k]))
    add("R-hat: median, largest", lambda its: "{median:.2f}, {largest:.2f}".format(**its["rhat_max"]))
    ran = {name: sum(line["converged"] is not None for line in its) for name, its in of.items()}
    lines.append(
        "| patients whose chains converged, of those with a stenosis | "
        + " | ".join(f"{scores[name]['converged']} of {ran[name]}" for name in of)
        + " |"
    )
    add("CPU s of a campaign", lambda its: f"{its['cpu_s_per_patient']:.0f}")
    return lines


def quantity(scores: dict, name: str) -> dict:
    return next(row for row in scores["quantities"] if row["quantity"] == name)


def draw(of: dict[str, list[dict]]) -> None:
    """Draw stated ranges against true FFR, the PIT histogram, and the reliability diagram."""
    truths: list[float] = []
    counts: list[int] = []
    with saved(PICTURE, ncols=3, figsize=(11.5, 4.2)) as (_, (ranges, histogram, diagram)):
        for number, (setting, lines) in enumerate(of.items()):
            answers = answers_by_quantity(line for line in lines if line["failed"] is None)[FFR]
            colour, scores = COLOURS[number], summary(lines)
            truths += [one["truth"] for one in answers]
            counts.append(len(answers))
            for k, one in enumerate(answers):
                at, q = one["truth"] + 0.003 * (number - 0.5), one["quantiles"]
                ranges.plot([at, at], [q["0.05"], q["0.95"]], color=colour, lw=1.2, alpha=0.8)
                ranges.plot(
                    at, q["0.50"], "o", color=colour, ms=3, label=None if k else f"{setting}: {len(answers)} stenoses"
                )
            edges = np.linspace(0, 1, PIT_BINS + 1)
            share = np.array(quantity(scores, FFR)["pit"]) / len(answers)
            histogram.stairs(share, edges, color=colour, lw=1.8, label=setting)
            rows = scores["reliability"]
            stated, observed = ([row[name] for row in rows] for name in ("stated", "observed"))
            low, high = ([row[f"observed_{end}"] for row in rows] for end in ("low", "high"))
            shift = 0.012 * (number - 0.5)
            diagram.vlines(np.array(stated) + shift, low, high, color=colour, lw=1.2)
            diagram.plot(np.array(stated) + shift, observed, "o", color=colour, ms=5, label=setting)
            for row in rows:
                diagram.annotate(
                    row["vessels"], (row["stated"] + shift, row["observed"]), xytext=(4 if number else -4, 3),
                    ha="left" if number else "right", textcoords="offset points", fontsize=7, color=colour,
                )  # fmt: skip
        ends = ranges.get_ylim()
        ranges.plot([0, 1.1], [0, 1.1], color=DARK, lw=0.8)
        for line in (ranges.axhline, ranges.axvline):
            line(LIMIT, color=DARK, lw=0.8, ls=(0, (4, 3)), zorder=0.5)
        ranges.set(
            xlabel="true FFR (3D on the true lumen)", ylabel="stated FFR", ylim=ends,
            xlim=(min(truths) - 0.03, max(truths) + 0.03), title="90 % range and median of FFR",
        )  # fmt: skip
        even = 1 / PIT_BINS
        histogram.axhline(even, color=DARK, lw=0.8)
        spread = 1.96 * np.sqrt(even * (1 - even) / min(counts))
        histogram.axhspan(max(even - spread, 0), even + spread, color=MUTED, alpha=0.25, lw=0)
        histogram.set(
            xlabel="stated probability below the true FFR", ylabel="share of stenoses", xlim=(0, 1), ylim=(0, None)
        )
        histogram.set_title("PIT; grey: 95 % of even ones, fewer stenoses")
        diagram.plot([0, 1], [0, 1], color=DARK, lw=0.8)
        diagram.set(
            xlabel="stated P(FFR ≤ 0.80)", ylabel="share with true FFR ≤ 0.80", xlim=(-0.1, 1.05), ylim=(-0.05, 1.05)
        )
        diagram.set_title("numbers: stenoses in the bin")
        for axes in (ranges, histogram, diagram):
            axes.legend(fontsize=7.5, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)


def main() -> None:
    """Join, score, write."""
    head, lines = joined([Path(name) for name in sys.argv[1:]])
    PATIENTS.write_text("".join(json.dumps(line) + "\n" for line in [head, *lines]), encoding="utf-8")
    of = {s: [line for line in lines if line["setting"] == s] for s in ("full", "paper")}
    shown = {name: [line for line in of["full"] if line["index"] in its] for name, its in UNSEEN.items()}
    both = {line["index"] for line in of["full"]} & {line["index"] for line in of["paper"]} & set(KNOWN)
    shown |= {
        name: [line for line in of[setting] if line["index"] in both]
        for name, setting in (("full, 0 to 99", "full"), ("paper", "paper"))
    }
    shown = {name: its for name, its in shown.items() if its}
    levels = beside_0d([line for name in shown if name != "paper" for line in shown[name]])
    text = tables(shown)
    text += ["", "FFR by 0D less that of the 3D truth, root mean square and largest:"]
    for name, what in (("ffr_0d", "with the losses of Young and Tsai"), ("ffr_trained", "with losses learnt from 3D")):
        text.append(f"{what} {levels[name]['rms']:.4f} and {levels[name]['largest']:+.4f};".replace("-", "−"))
    text[-1] = text[-1].removesuffix(";") + f" ({levels['ffr_0d']['vessels']} stenoses)."
    page = PAGE.read_text(encoding="utf-8")
    before, after = page.split(START)[0], page.split(END)[1]
    PAGE.write_text(before + START + "\n" + "\n".join(text) + "\n" + END + after, encoding="utf-8")
    latest = next(iter(shown))
    draw({latest: shown[latest], "paper, 0 to 99": shown["paper"]})


if __name__ == "__main__":
    main()
