"""Whether wanted intervals were reached, why a growing campaign stopped, and what narrower ones would cost."""

from coronaryuq.core.io.atomic import read_json
from coronaryuq.report.numbers import number

ENDED = {
    "met": "every wanted interval was reached",
    "bounds reached": "no more runs are allowed (most_3d, most_0d)",
    "rounds spent": "no more rounds are allowed (rounds)",
}


def sentences(rows: list[dict], budget: str, last_round: str | None) -> list[dict]:
    """One line per wanted row, {text, met}, and one for the campaign's end where it grew; none without `wanted`.

    rows: of `estimates.json`, whose intervals are the page's. budget: `budget.json`, with the plan for those.
    last_round: the last `allocation/round_R.json` of a campaign that grew.
    """
    labels = {row["row"]: row["label"] for row in rows}
    estimators = {row["row"]: row["estimators"][row["recommended"]]["method"] for row in rows}
    lines = [_of_row(want, labels[want["row"]], estimators[want["row"]]) for want in read_json(budget)["plan"]]
    if not last_round:
        return lines
    ended = read_json(last_round)
    runs = f"{ended['counts']['n_3d']} 3D and {ended['counts']['n_0d']} propagation runs"
    text = f"The campaign ended in round {ended['round'] + 1} with {runs}: {ENDED[ended['why']]}."
    return [*lines, {"text": text, "met": ended["why"] == "met"}]


def _of_row(want: dict, label: str, estimator: str) -> dict:
    met = want["now"] <= want["wanted"]
    text = f"{label}: ± {number(want['wanted'])} wanted, ± {number(want['now'])} reached by {estimator}"
    text += "." if met else f": not met, it would take about {_runs(want)} more."
    half, cost = number(want["wanted"] / 2), f"{want['cost_of_half']:,.0f}"
    return {"text": f"{text} Half the wanted width, ± {half}, would cost about {cost} 3D runs more.", "met": met}


def _runs(want: dict) -> str:
    parts = [f"{want[key]:,} {name} runs" for key, name in (("more_3d", "3D"), ("more_0d", "0D")) if want[key]]
    return " and ".join(parts)
