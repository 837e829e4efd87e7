"""A target instead of a count: after each round of runs, what the next one takes to reach the wanted half-widths.

`round_R.json`: {round, counts: {n_3d, n_0d}, plan: [...] as in budget.json, next: {n_3d, n_0d}, done, why}. `why`: what
ended it (`met`, `bounds reached`, `rounds spent`), or null.
"""

from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation.campaign import analysis, convergence_and_budget
from coronaryuq.estimation.runs.gather import gather, measured_cost_ratio
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings

# A pilot knows its own correlations only roughly: no round goes further than this factor on what it knows.
GROWTH = 2
# The best N_0D / N_3D goes with the root of the cost ratio: a ratio further off than this wastes more than it has to.
FAR = 4


def decide(
    plan: list[convergence_and_budget.Want],
    counts: dict[str, int],
    most: dict[str, int],
    portion: dict[str, int],
    last: bool,
) -> dict:
    """The next counts, in whole portions, at most GROWTH times today's and never above `most`; and whether to stop."""
    if all(want.now <= want.wanted for want in plan):
        return {"next": counts, "done": True, "why": "met"}
    more = {"n_3d": max(want.more_3d for want in plan), "n_0d": max(want.more_0d for want in plan)}
    target = {}
    for name, now in counts.items():
        wanted = min(now + more[name], GROWTH * now)
        whole = int(np.ceil(wanted / portion[name])) * portion[name]
        target[name] = max(now, min(whole, most[name])) if wanted > now else now
    if target == counts:
        return {"next": counts, "done": True, "why": "bounds reached"}
    if last:
        return {"next": counts, "done": True, "why": "rounds spent"}
    return {"next": target, "done": False, "why": None}


def allocate(
    inputs: dict, limits: dict, settings: Settings, seed: int, number: int, counts: dict[str, int],
    portion: dict[str, int], out_json: str | Path,
) -> None:  # fmt: skip
    """Round `number`: gather the first `counts` runs, estimate without networks, plan, decide, write.

    The plan goes by the declared `settings.cost_ratio`, for a measured one is another in every campaign, and so would
    be the runs that it asks for. What was measured is printed beside.

    inputs: paths as `gather` names them. limits: bounds of θ. portion: runs per job, {n_3d, n_0d}.
    """
    settings = settings.model_copy(update={"autoencoder": False, "rows": []})
    with TemporaryDirectory() as folder:
        gather(**inputs, limits=limits, min_3d=settings.min_3d, out=folder, counts=counts)
        runs, rows = read_runs(folder), read_rows(Path(folder) / "rows.csv")
        measured = measured_cost_ratio(Path(folder) / "failures.json")
    known = {row.name for row in rows}
    for name in settings.wanted:
        if name not in known:
            raise InputError(
                "estimation.wanted", name, settings.wanted[name], f"no such row; there are {', '.join(known)}"
            )
    rows = [row for row in rows if row.name in settings.wanted]
    results = analysis.analyse(runs, rows, settings, seed, beyond_mean=False)
    print(_costs(settings.cost_ratio, measured))
    plan = convergence_and_budget.plan(results, settings.wanted, settings.cost_ratio)
    most = {"n_3d": settings.most_3d or counts["n_3d"], "n_0d": settings.most_0d or counts["n_0d"]}
    decided = decide(plan, counts, most, portion, number + 1 >= settings.rounds)
    write_json(out_json, {"round": number, "counts": counts, "plan": [asdict(want) for want in plan], **decided})


def _costs(declared: float, measured: float | None) -> str:
    said = f"a 0D run counts as {declared:.2g} 3D runs (estimation.cost_ratio)"
    if measured is None:
        return f"{said}; the runs so far do not tell what it costs"
    advice = "" if 1 / FAR < measured / declared < FAR else f"; declare cost_ratio: {measured:.1g} for a cheaper plan"
    return f"{said}; measured so far: {measured:.2g}{advice}"
