"""Whether wanted intervals were reached, why a growing campaign stopped, and what narrower ones would cost."""

from coronaryuq.estimation.results import RowReport, Want, read_budget, read_round
from coronaryuq.report.numbers import number

ENDED = {
    "met": "every wanted interval was reached",
    "bounds reached": "no more runs are allowed (most_3d, most_0d)",
    "rounds spent": "no more rounds are allowed (rounds)",
}


def sentences(rows: list[RowReport], budget: str, last_round: str | None) -> list[dict]:
    """One line per wanted row, {text, met}, and one for the campaign's end where it grew; none without `wanted`.

    rows: of `estimates.json`, whose intervals are the page's. budget: `budget.json`, with the plan for those.
    last_round: the last `allocation/round_R.json` of a campaign that grew.
    """
    by_name = {row.row: row for row in rows}
    lines = [_of_row(want, by_name[want.row]) for want in read_budget(budget).plan]
    if not last_round:
        return lines
    ended = read_round(last_round)
    runs = f"{ended.counts.n_3d} 3D and {ended.counts.n_0d} propagation runs"
    text = f"The campaign ended in round {ended.round + 1} with {runs}: {ENDED[ended.why or '']}."
    return [*lines, {"text": text, "met": ended.why == "met"}]


def _of_row(want: Want, row: RowReport) -> dict:
    met = want.now <= want.wanted
    text = f"{row.label}: ± {number(want.wanted)} wanted, ± {number(want.now)} reached by {row.best.method}"
    text += "." if met else f": not met, it would take about {_runs(want)} more."
    half, cost = number(want.wanted / 2), f"{want.cost_of_half:,.0f}"
    return {"text": f"{text} Half the wanted width, ± {half}, would cost about {cost} 3D runs more.", "met": met}


def _runs(want: Want) -> str:
    return " and ".join(f"{more:,} {name} runs" for more, name in ((want.more_3d, "3D"), (want.more_0d, "0D")) if more)
