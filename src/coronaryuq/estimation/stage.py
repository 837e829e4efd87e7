"""Rule functions of the estimation stage: train, then, after the 0D model ran at the resampled inputs, estimate."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, replacing, write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.provenance import stamp
from coronaryuq.estimation.campaign import analysis, convergence_and_budget, tables
from coronaryuq.estimation.estimators.level_allocation import Costs, worth
from coronaryuq.estimation.runs.gather import coarse_cost, measured_cost_ratio
from coronaryuq.estimation.runs.table import read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates.networks_file import read_networks, read_resampled


def train(
    runs_folder: str | Path, settings: Settings, seed: int, networks_npz: str | Path, resampled_csv: str | Path,
    rows_csv: str | Path | None = None,
) -> None:  # fmt: skip
    """Train MFMC-AE for all rows, folds and restarts; write the networks and the 0D inputs that they want.

    `resampled_csv`: `sample` and one column per input of `params.csv`, (folds + 1) · curve_nodes lines per row; the 0D
    stage runs them like any other table of θ. Without `settings.autoencoder` both files are written empty of rows.
    """
    runs, rows = _read(runs_folder, rows_csv, settings)
    analysis.enough(runs, settings)
    if not settings.autoencoder:
        _write_npz(networks_npz, {"rows": np.array([], dtype=str)})
        write_csv(resampled_csv, pd.DataFrame(columns=["sample", *runs.inputs]))
        return
    networks = analysis.train(runs, rows, settings, seed)
    _write_npz(networks_npz, networks.arrays())
    write_csv(resampled_csv, analysis.wanted_0d(networks, runs, settings.curve_nodes))


def estimate(
    runs_folder: str | Path, networks_npz: str | Path | None, zerod_tables: list[str | Path], settings: Settings,
    seed: int, estimates_json: str | Path, table_csv: str | Path, rows_csv: str | Path | None = None,
) -> None:  # fmt: skip
    """Estimate every row; write all and the table. `zerod_tables`: 0D outputs at resampled inputs, any order."""
    runs, rows = _read(runs_folder, rows_csv, settings)
    networks = read_networks(networks_npz) if networks_npz else None
    outputs = read_resampled(zerod_tables) if networks else None
    results = analysis.analyse(runs, rows, settings, seed, networks, outputs)
    write_json(
        estimates_json,
        {
            "rows": results,
            "coarse": _coarse_level(Path(runs_folder) / "failures.json", results, settings),
            "settings": settings.model_dump(mode="json"),
            "provenance": stamp(seed=seed),
        },
    )
    write_csv(table_csv, tables.table(results))


def convergence(
    runs_folder: str | Path, settings: Settings, seed: int, out_json: str | Path, rows_csv: str | Path | None = None
) -> None:
    """Write the convergence study, {"convergence": [...]}; entries as in `studies.convergence`."""
    runs, rows = _read(runs_folder, rows_csv, settings)
    named = settings.convergence_rows
    chosen = [row for row in rows if (row.name in named if named else "osi" in row.column_3d.lower())]
    write_json(out_json, {"convergence": convergence_and_budget.convergence(runs, chosen, settings, seed)})


def budget(
    estimates_json: str | Path, settings: Settings, out_json: str | Path, failures_json: str | Path | None = None
):
    """Write the curves of both budget figures, {"budget": [...], "plan": [...]}.

    The cost of a 0D run in 3D runs comes from `failures_json` (its `cost`, CPU seconds) where given and known, else
    from settings.
    """
    results = read_json(estimates_json)["rows"]
    ratio = settings.cost_ratio
    if failures_json:
        ratio = measured_cost_ratio(failures_json) or ratio
    for name in settings.wanted:
        if name not in {result["row"] for result in results}:
            raise InputError("estimation.wanted", name, settings.wanted[name], "no such row among the estimates")
    plan = [asdict(want) for want in convergence_and_budget.plan(results, settings.wanted, ratio)]
    write_json(out_json, {"budget": convergence_and_budget.budget(results, ratio), "plan": plan})


def _coarse_level(failures_json: Path, results: list[dict], settings: Settings) -> dict | None:
    """What the coarse level cost and what it gained, row by row; None where there is none or its cost is not known."""
    level = coarse_cost(failures_json) if failures_json.exists() else None
    if level is None:
        return None
    costs = Costs(
        level["coarse_cpu_s"] / level["fine_cpu_s"], measured_cost_ratio(failures_json) or settings.cost_ratio
    )
    gained = {result["row"]: worth(result, level["runs"], costs) for result in results}
    return level | {"rows": {name: value for name, value in gained.items() if value is not None}}


def _read(runs_folder, rows_csv, settings):
    rows_csv = rows_csv or Path(runs_folder) / "rows.csv"
    return read_runs(runs_folder), analysis.chosen_rows(read_rows(rows_csv), settings, rows_csv)


def _write_npz(path: str | Path, arrays: dict) -> None:
    with replacing(path) as beside, open(beside, "wb") as out:
        np.savez(out, **arrays)
