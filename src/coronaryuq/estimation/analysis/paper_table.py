"""The paper's table from published runs: its own columns next to cross-fitted ones, row by row."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.core.io.typed import plain
from coronaryuq.estimation import training
from coronaryuq.estimation.analysis import budget, estimate_rows, pairs_table
from coronaryuq.estimation.estimators.design import make_design
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.results import RowReport
from coronaryuq.estimation.runs.table import Runs, read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates.emulator import Emulator

PRINTED = ("rho_original", "rho_modified", "std_mc", "std_mfmc", "std_mfmc_ae")


def paper_table(
    data: str | Path, rows_csv: str | Path, settings: Settings, seed: int,
    out_csv: str | Path | None = None, out_md: str | Path | None = None, folder: str | Path | None = None,
) -> tuple[list[dict[str, Any]], dict[str, float]]:  # fmt: skip
    """Return the lines of the paper's table, and CPU seconds by part; write files if asked.

    Columns `rho_original, std_mc, std_mfmc` follow the paper's conventions and equal its printed digits on its data.
    `std_best_chain` is the part of `std_best` that dependence of the samples adds: the error of a chain, say.
    `rho_ae_in_sample` is what the paper prints as modified correlation, `rho_ae_held_out` the same method on runs
    that it was not fitted on. Where the rows file has the paper's columns they come back as `paper_...`. The 0D
    model at resampled inputs is a Gaussian-process emulator; `emulator_error` is its held-out mean square error over
    variance.

    Parameters
    ----------
    data
        Folder of runs in the published-runs format (docs/reference/formats.md).
    rows_csv
        Rows to estimate.
    settings, seed
        Settings of the stage and seed.
    out_csv, out_md
        The table to write, as CSV and for a reader.
    folder
        Folder for the figures' files: `estimates.json`, `pairs.csv`, `budget.json`.

    Raises
    ------
    InputError
        If the folder is not as described, or has too few runs.
    """
    runs, rows = read_runs(data), training.chosen_rows(read_rows(rows_csv), settings, rows_csv)
    training.check_number_of_runs(runs, settings)
    clock = [time.process_time()]
    design = make_design(runs, rows, count(len(runs), settings.folds), seed, settings.known_scaling)
    clock.append(time.process_time())
    networks = resampled = None
    if trained := training.with_networks(rows, settings):
        networks = training.train(runs, trained, settings, seed)
        wanted = training.resampled_inputs(networks, runs, settings.curve_nodes)
        resampled = emulated(runs, [row.column_0d for row in trained], wanted)
    clock.append(time.process_time())
    results = estimate_rows.analyse(runs, rows, settings, seed, networks, resampled, design, beyond_mean=False)
    clock.append(time.process_time())
    printed = _printed(rows_csv)
    lines = [_line(result, printed[result.row]) for result in results]
    if out_csv:
        write_csv(out_csv, pd.DataFrame(lines))
    if out_md:
        write_text(out_md, markdown(lines))
    if folder:
        folder = Path(folder)
        estimates = {"rows": plain(results), "settings": settings.model_dump(mode="json")}
        write_json(folder / "estimates.json", estimates)
        write_csv(folder / "pairs.csv", pairs_table.pairs(runs, rows, settings, seed, networks, resampled))
        curves = budget.curves(results, settings.cost_ratio)
        write_json(folder / "budget.json", {"budget": plain(curves)})
    parts = dict(zip(("emulators", "autoencoders", "control_variates"), np.diff(clock), strict=True))
    return lines, {name: float(value) for name, value in parts.items()}


def published(data: str | Path | None) -> tuple[Path, Path]:
    """Return the folder of published runs that a campaign's `paper_data` names, and its file of rows.

    Raises
    ------
    InputError
        If no folder is named, or if it has no file of rows.
    """
    if data is None:
        raise InputError("configuration", "paper_data", None, "name the folder with the published runs")
    rows = next((path for path in (Path(data, "rows.csv"), Path(data, "table1.csv")) if path.exists()), None)
    if rows is None:
        raise InputError(
            data, "rows.csv or table1.csv", None, "no such file; is this the folder of the published runs?"
        )
    return Path(data), rows


def emulated(runs: Runs, names: list[str], wanted: pd.DataFrame) -> pd.DataFrame:
    """0D outputs at wanted inputs by an emulator of all pilot 0D runs, index `sample`."""
    names = list(dict.fromkeys(names))
    emulator = Emulator(runs.coordinates(runs.theta), runs.q[names])
    values = emulator.predict(runs.coordinates(wanted[list(runs.inputs)].to_numpy(float)))
    return pd.DataFrame(values, index=wanted["sample"].astype(str))


def markdown(lines: list[dict[str, Any]]) -> str:
    """Format the table as Markdown, with the paper's printed value in brackets where the rows file has it."""
    heads = ["row", "quantity", "ρ original", "ρ AE in-sample", "ρ AE held out", "ρ crossfit-GP held out"]
    heads += ["std MC", "std MFMC", "std MFMC-AE", "std crossfit-GP", "crossfit-GP"]
    text = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for line in lines:
        cells = [
            line["row"], line["label"], _cell(line, "rho_original"), _cell(line, "rho_ae_in_sample", "rho_modified"),
            _cell(line, "rho_ae_held_out"), format(line["rho_best_held_out"], ".5f"), _cell(line, "std_mc"),
            _cell(line, "std_mfmc"), _cell(line, "std_mfmc_ae"), format(line["std_best"], ".6f"), line["best_method"],
        ]  # fmt: skip
        text.append("| " + " | ".join(cells) + " |")
    notes = sorted({note for line in lines for note in line["warnings"]})
    text += [
        "",
        "In brackets: as printed in the paper. std MFMC-AE: cross-fitted here, in-sample in the paper.",
        "min TAWSS and max OSI are extremes, which have converged on no mesh tried (docs/explanation/flow3d.md).",
        "",
    ]
    text += [f"- {note}" for note in notes]
    return "\n".join(text) + "\n"


def _cell(line: dict[str, Any], key: str, printed: str | None = None) -> str:
    """Format a number and, in brackets, the paper's printed value."""
    if line[key] is None:
        return "–"
    beside = line.get(f"paper_{printed or key}")
    return f"{line[key]:.4f}" + (f" ({beside})" if beside is not None else "")


def _line(row: RowReport, printed: dict[str, float]) -> dict[str, Any]:
    ae, crossfit_gp = row.estimators.get("MFMC-AE"), row.estimators["crossfit-GP"]
    line = {
        "row": row.row, "label": row.label,
        "rho_original": row.paper.rho_original,
        "rho_ae_in_sample": ae and ae.rho_in_sample, "rho_ae_held_out": ae and ae.rho_held_out,
        "rho_best_held_out": crossfit_gp.rho_held_out, "best_method": crossfit_gp.method.removeprefix("crossfit-GP: "),
        "std_mc": row.paper.std_mc, "std_mfmc": row.paper.std_mfmc,
        "std_mfmc_ae": ae and ae.std, "std_mfmc_ae_in_sample": ae and ae.std_in_sample, "std_best": crossfit_gp.std,
        "std_best_chain": crossfit_gp.variance["chain"] ** 0.5,
        "mean_mc": row.estimators["MC"].mean, "mean_best": crossfit_gp.mean,
        "calibrated_best": [crossfit_gp.calibrated.low, crossfit_gp.calibrated.high],
        "n_3d": crossfit_gp.n_3d, "predictions_best": crossfit_gp.predictions,
        "emulator_error": row.emulator_error, "recommended": row.recommended,
        "warnings": [*row.warnings, *(w for estimate in row.estimators.values() for w in estimate.warnings)],
    }  # fmt: skip
    return line | {f"paper_{name}": value for name, value in printed.items()}


def _printed(rows_csv: str | Path) -> dict[str, dict[str, float]]:
    """Row → what the paper prints for it, where the file of rows has that."""
    frame = read_csv(rows_csv, columns=("row",))
    columns = {name: pd.to_numeric(frame[name], errors="coerce") for name in PRINTED if name in frame}
    return {
        str(row).strip(): {name: float(values[i]) for name, values in columns.items() if np.isfinite(values[i])}
        for i, row in enumerate(frame["row"])
    }
