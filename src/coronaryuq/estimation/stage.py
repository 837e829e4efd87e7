"""Rule functions of the estimation stage: train, then, after the 0D model ran at the resampled inputs, estimate."""

from dataclasses import asdict
from pathlib import Path

from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.io.typed import plain
from coronaryuq.core.provenance import stamp
from coronaryuq.estimation.analysis import estimate_rows, tables
from coronaryuq.estimation.analysis.convergence import subsamples
from coronaryuq.estimation.analysis.numerical_budget import corrected, with_numerical_error
from coronaryuq.estimation.analysis.physical_range import within_range
from coronaryuq.estimation.analysis.predictive import with_prediction
from coronaryuq.estimation.estimators.level_allocation import Costs, worth
from coronaryuq.estimation.results import CoarseLevel, Estimates, RowReport
from coronaryuq.estimation.runs.gather import coarse_cost, measured_cost_ratio
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates.networks_file import read_networks, read_resampled
from coronaryuq.estimation.training import read_chosen
from coronaryuq.flow3d.mesh_study import read_discretization
from coronaryuq.flow3d.numerical_error import assumed_errors


def estimate(
    runs_folder: str | Path, networks_npz: str | Path | None, zerod_tables: list[str | Path], settings: Settings,
    seed: int, estimates_json: str | Path, table_csv: str | Path, rows_csv: str | Path | None = None,
    mesh_study: str | Path | None = None, assumed_on: str | Path | None = None,
) -> None:  # fmt: skip
    """Estimate every row; write `estimates.json` and the table.

    Parameters
    ----------
    runs_folder, settings, seed, rows_csv
        As in `train`.
    networks_npz
        Networks of `train`; None for none.
    zerod_tables
        0D outputs at the resampled inputs (Parquet or CSV), in any order.
    estimates_json, table_csv
        Files to write.
    mesh_study
        `mesh_study.json`: numerical error of the 3D runs, by which outputs are corrected and intervals widened.
    assumed_on
        `mesh.json` of the 3D runs, from which errors are assumed where that of the mesh was not measured; None: none
        are.

    Raises
    ------
    InputError
        If an input file is not as described.
    """
    runs, rows = read_chosen(runs_folder, rows_csv, settings)
    networks = read_networks(networks_npz) if networks_npz else None
    outputs = read_resampled(zerod_tables) if networks else None
    errors = read_discretization(mesh_study) if mesh_study else {}
    if assumed_on:
        settled = read_json(assumed_on, ("settings",))["settings"]["throat_resolution"]
        assumed = assumed_errors(settled, runs.y.columns)
        unmeasured = {name for name in assumed if not any(error.source == "mesh" for error in errors.get(name, ()))}
        errors |= {name: assumed[name] for name in assumed if name in unmeasured}
    results = estimate_rows.analyse(corrected(runs, errors), rows, settings, seed, networks, outputs)
    results = [within_range(with_prediction(with_numerical_error(row, errors))) for row in results]
    coarse = _coarse_level(Path(runs_folder) / "failures.json", results, settings)
    estimates = Estimates(results, coarse, settings.model_dump(mode="json"), stamp(seed=seed))
    write_json(estimates_json, plain(estimates))
    write_csv(table_csv, tables.table(results))


def convergence(
    runs_folder: str | Path, settings: Settings, seed: int, out_json: str | Path, rows_csv: str | Path | None = None,
    shown: str = "FFR, FFR",
) -> None:  # fmt: skip
    """Write the convergence study, {"convergence": [...]}; arguments as in `training.write_networks`.

    shown: beginning of the label of the rows with networks that are studied if the settings name none; all with
    networks are if no label begins so.
    """
    runs, rows = read_chosen(runs_folder, rows_csv, settings)
    named = settings.convergence_rows
    with_networks = [row for row in rows if row.networks]
    usual = [row for row in with_networks if row.label.startswith(shown)] or with_networks
    chosen = [row for row in rows if row.name in named] if named else usual
    entries = subsamples(runs, chosen, settings, seed)
    write_json(out_json, {"convergence": plain(entries)})


def _coarse_level(failures_json: Path, rows: list[RowReport], settings: Settings) -> CoarseLevel | None:
    """Compare cost and gain of the coarse level, row by row; None without one, or if its cost is unknown."""
    cost = coarse_cost(failures_json) if failures_json.exists() else None
    if cost is None:
        return None
    costs = Costs(cost.coarse_cpu_s / cost.fine_cpu_s, measured_cost_ratio(failures_json) or settings.cost_ratio)
    gained = {row.row: value for row in rows if (value := worth(row, cost.runs, costs)) is not None}
    return CoarseLevel(**asdict(cost), rows=gained)
