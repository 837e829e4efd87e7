"""Whether requested interval widths were reached, why a growing campaign stopped, and the cost of narrower ones."""

from coronaryuq.estimation.results import RowReport, Want, read_budget, read_round
from coronaryuq.report.numbers import number

ENDED = {
    "met": "all requested widths were reached",
    "bounds reached": "it reached the largest number of runs (most_3d, most_0d)",
    "rounds spent": "it reached the largest number of rounds (rounds)",
}


def sentences(rows: list[RowReport], budget: str, last_round: str | None) -> list[dict]:
    """Return a line for each requested width and one for the end of a campaign that grew.

    Parameters
    ----------
    rows
        Rows of `estimates.json`.
    budget
        `budget.json`, with the plan for the requested widths.
    last_round
        The last `allocation/round_R.json` of a campaign that grew, else None.

    Returns
    -------
    list of dict
        `text`, and `met`: whether the width was reached.
    """
    by_name = {row.row: row for row in rows}
    lines = [_row_line(want, by_name[want.row]) for want in read_budget(budget).plan]
    if not last_round:
        return lines
    ended = read_round(last_round)
    runs = f"{ended.counts.n_3d} 3D and {ended.counts.n_0d} propagation runs"
    text = f"The campaign ended in round {ended.round + 1} with {runs}: {ENDED[ended.why or '']}."
    return [*lines, {"text": text, "met": ended.why == "met"}]


def _row_line(want: Want, row: RowReport) -> dict:
    met = want.now <= want.wanted
    text = f"{row.label}: ± {number(want.wanted)} requested, ± {number(want.now)} reached by {row.best.method}"
    text += "." if met else f"; this needs about {_runs(want)} more."
    half, cost = number(want.wanted / 2), f"{want.cost_of_half:,.0f}"
    return {"text": f"{text} Half the requested width, ± {half}, would cost about {cost} more 3D runs.", "met": met}


def _runs(want: Want) -> str:
    return " and ".join(f"{more:,} {name} runs" for more, name in ((want.more_3d, "3D"), (want.more_0d, "0D")) if more)
