"""A target instead of a count: after each round of runs, what the next one needs to reach the wanted half-widths."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.typed import plain
from coronaryuq.estimation.campaign import analysis, convergence_and_budget
from coronaryuq.estimation.results import Counts, Round, Want
from coronaryuq.estimation.runs.gather import RunFiles, gather, measured_cost_ratio
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings

# A pilot knows its own correlations only roughly: no round grows by more than this factor on their strength.
GROWTH = 2
# The best N_0D / N_3D goes with the root of the cost ratio: a ratio further off than this wastes runs.
FAR = 4


def decide(
    plan: list[Want], counts: Counts, most: Counts, portion: Counts, last: bool
) -> tuple[Counts, bool, str | None]:
    """Return the next counts, whether to stop, and why.

    Counts come in whole portions, at most GROWTH times today's and never above `most`; last: no further round is
    allowed.
    """
    if all(want.now <= want.wanted for want in plan):
        return counts, True, "met"
    target = Counts(
        _grown(counts.n_3d, max(want.more_3d for want in plan), most.n_3d, portion.n_3d),
        _grown(counts.n_0d, max(want.more_0d for want in plan), most.n_0d, portion.n_0d),
    )
    if target == counts:
        return counts, True, "bounds reached"
    if last:
        return counts, True, "rounds spent"
    return target, False, None


def _grown(now: int, more: int, most: int, portion: int) -> int:
    wanted = min(now + more, GROWTH * now)
    whole = int(np.ceil(wanted / portion)) * portion
    return max(now, min(whole, most)) if wanted > now else now


def allocate(
    inputs: RunFiles, limits: dict[str, tuple[float, float]], settings: Settings, seed: int, number: int,
    counts: Counts, portion: Counts, out_json: str | Path,
) -> None:  # fmt: skip
    """Gather the first runs of round `number`, estimate without networks, plan, decide and write the round.

    The plan uses the declared `settings.cost_ratio`: a measured one would differ in every campaign, and so would the
    runs that it asks for. The measured one is printed beside it.

    Parameters
    ----------
    inputs
        Files of the campaign.
    limits
        Bounds of θ, as in `gather`.
    settings, seed
        Settings of the stage, and the campaign's seed.
    number
        Of the round, from 0.
    counts
        Runs of this round.
    portion
        Runs per job.
    out_json
        `round_R.json` to write.

    Raises
    ------
    InputError
        If `settings.wanted` names a row that does not exist, or if there are too few runs.
    """
    settings = settings.model_copy(update={"autoencoder": False, "rows": []})
    with TemporaryDirectory() as folder:
        gather(inputs, limits, settings.min_3d, folder, counts)
        runs, rows = read_runs(folder), read_rows(Path(folder) / "rows.csv")
        measured = measured_cost_ratio(Path(folder) / "failures.json")
    check_wanted(settings, [row.name for row in rows])
    rows = [row for row in rows if row.name in settings.wanted]
    results = analysis.analyse(runs, rows, settings, seed, beyond_mean=False)
    print(_costs(settings.cost_ratio, measured))
    plan = convergence_and_budget.plan(results, settings.wanted, settings.cost_ratio)
    most = Counts(settings.most_3d or counts.n_3d, settings.most_0d or counts.n_0d)
    following, done, why = decide(plan, counts, most, portion, number + 1 >= settings.rounds)
    write_json(out_json, plain(Round(number, counts, plan, following, done, why)))


def check_wanted(settings: Settings, rows: list[str]) -> None:
    """Raise `InputError` for a wanted half-width of a row that does not exist."""
    for name in settings.wanted:
        if name not in rows:
            raise InputError(
                "estimation.wanted", name, settings.wanted[name], f"no such row; there are {', '.join(rows)}"
            )


def _costs(declared: float, measured: float | None) -> str:
    text = f"a 0D run counts as {declared:.2g} 3D runs (estimation.cost_ratio)"
    if measured is None:
        return f"{text}; the runs so far do not show what it costs"
    advice = "" if 1 / FAR < measured / declared < FAR else f"; declare cost_ratio: {measured:.1g} for a cheaper plan"
    return f"{text}; measured so far: {measured:.2g}{advice}"
