"""Allocation of runs to target half-widths: after each round, the counts and the chains of the next one."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.typed import plain
from coronaryuq.estimation.analysis import budget, estimate_rows
from coronaryuq.estimation.results import Bounds, Counts, Round, TargetPlan
from coronaryuq.estimation.runs.gather import RunFiles, gather, measured_cost_ratio
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings

# Correlations estimated from a pilot are uncertain: no round grows by more than this factor.
GROWTH = 2
# The optimal N_0D / N_3D is proportional to the root of the cost ratio: a ratio further off than this wastes runs.
FAR = 4


def decide(
    plan: list[TargetPlan], counts: Counts, most: Bounds, portion: Counts, last: bool
) -> tuple[Counts, bool, str | None]:
    """Return the next counts, whether to stop, and why.

    Counts come in whole portions, at most GROWTH times today's and never above `most`; last: no further round is
    allowed. Where the chains limit the error, they become GROWTH times as long, and so does the number of propagation
    samples, which makes the new states count as much as the old ones.
    """
    if all(one.half_width <= one.target for one in plan):
        return counts, True, "met"
    too_short = any(one.longer_chain > 1 and one.half_width > one.target for one in plan)
    longer = too_short and GROWTH * counts.length <= most.length
    more_0d = max(max(one.more_0d for one in plan), (GROWTH - 1) * counts.n_0d if longer else 0)
    target = Counts(
        _grown(counts.n_3d, max(one.more_3d for one in plan), most.n_3d, portion.n_3d),
        _grown(counts.n_0d, more_0d, most.n_0d, portion.n_0d),
        counts.lengths,
    )
    drawn = int(np.ceil(counts.n_0d / portion.n_0d)) * portion.n_0d  # by jobs that have run, some beyond the counts
    if longer and target.n_0d > drawn:
        target = replace(target, lengths=(*counts.lengths, (drawn, GROWTH * counts.length)))
    if target == counts:
        return counts, True, "chain too short" if too_short and not longer else "bounds reached"
    if last:
        return counts, True, "rounds exhausted"
    return target, False, None


def _grown(now: int, more: int, most: int, portion: int) -> int:
    needed = min(now + more, GROWTH * now)
    whole = int(np.ceil(needed / portion)) * portion
    return max(now, min(whole, most)) if needed > now else now


def allocate(
    inputs: RunFiles, limits: dict[str, tuple[float, float]], settings: Settings, seed: int, number: int,
    counts: Counts, portion: Counts, out_json: str | Path,
) -> None:  # fmt: skip
    """Gather the first runs of round `number`, estimate without networks, plan, decide and write the round.

    The plan uses the declared `settings.cost_ratio`: a measured one would differ in every campaign, and so would the
    runs that it requests. The measured one is printed for comparison.

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
        If `settings.target_half_width` names a row that does not exist, or if there are too few runs.
    """
    settings = settings.model_copy(update={"autoencoder": False, "rows": []})
    with TemporaryDirectory() as folder:
        gather(inputs, limits, settings.min_3d, folder, counts)
        runs, rows = read_runs(folder), read_rows(Path(folder) / "rows.csv")
        measured = measured_cost_ratio(Path(folder) / "failures.json")
    budget.check_targets(settings, [row.name for row in rows])
    rows = [row for row in rows if row.name in settings.target_half_width]
    results = estimate_rows.analyse(runs, rows, settings, seed, beyond_mean=False)
    print(_costs(settings.cost_ratio, measured))
    plan = budget.plan(results, settings.target_half_width, settings.cost_ratio)
    most = Bounds(settings.max_3d or counts.n_3d, settings.max_0d or counts.n_0d, settings.max_chain)
    following, done, why = decide(plan, counts, most, portion, number + 1 >= settings.rounds)
    write_json(out_json, plain(Round(number, counts, plan, following, done, why)))


def _costs(declared: float, measured: float | None) -> str:
    text = f"a 0D run counts as {declared:.2g} 3D runs (estimation.cost_ratio)"
    if measured is None:
        return f"{text}; no cost measured yet"
    advice = "" if 1 / FAR < measured / declared < FAR else f"; declare cost_ratio: {measured:.1g} for a cheaper plan"
    return f"{text}; measured so far: {measured:.2g}{advice}"
