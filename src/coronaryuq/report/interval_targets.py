"""Target interval widths: whether they were reached, why a growing campaign stopped, and the cost of narrower ones."""

from coronaryuq.estimation.results import RowReport, TargetPlan, read_budget, read_round
from coronaryuq.report.numbers import number

ENDED = {
    "met": "all target widths were reached",
    "bounds reached": "the maximum number of runs was reached (max_3d, max_0d)",
    "chain too short": "more runs would not help: the chains are too short at their maximum length (max_chain)",
    "rounds exhausted": "the maximum number of rounds was reached (rounds)",
}


def sentences(rows: list[RowReport], budget: str, last_round: str | None) -> list[dict]:
    """Return a line for each target width and one for the end of a growing campaign.

    Parameters
    ----------
    rows
        Rows of `estimates.json`.
    budget
        `budget.json`, with the plan for the target widths.
    last_round
        The last `allocation/round_R.json` of a campaign that grew, else None.

    Returns
    -------
    list of dict
        `text`, and `met`: whether the width was reached.
    """
    by_name = {row.row: row for row in rows}
    lines = [_row_line(one, by_name[one.row]) for one in read_budget(budget).plan]
    if not last_round:
        return lines
    ended = read_round(last_round)
    counts = ended.counts
    runs = f"{counts.n_3d} 3D and {counts.n_0d} propagation runs"
    runs += f", chains {counts.length} times as long as the first ones" if counts.length > 1 else ""
    text = f"The campaign ended in round {ended.round + 1} with {runs}: {ENDED[ended.why or '']}."
    return [*lines, {"text": text, "met": ended.why == "met"}]


def _row_line(one: TargetPlan, row: RowReport) -> dict:
    met = one.half_width <= one.target
    method = row.recommended_report.method
    text = f"{row.label}: ± {number(one.target)} targeted, ± {number(one.half_width)} reached by {method}"
    text += "." if met else f"; this needs {_needs(one)}."
    half, cost = number(one.target / 2), f"{one.cost_of_half:,.0f}"
    return {"text": f"{text} Half the target width, ± {half}, would cost about {cost} more 3D runs.", "met": met}


def _needs(one: TargetPlan) -> str:
    runs = " and ".join(f"{more:,} {name} runs" for more, name in ((one.more_3d, "3D"), (one.more_0d, "0D")) if more)
    chain = f"chains {one.longer_chain:.2g} times as long" if one.longer_chain > 1 else ""
    return " and ".join(filter(None, (f"about {runs} more" if runs else "", chain)))
