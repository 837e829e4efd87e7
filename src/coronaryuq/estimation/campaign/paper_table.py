"""The paper's table from published runs: its own columns beside cross-fitted ones, row by row."""

import time
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json, write_text
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.estimation.campaign import analysis, convergence_and_budget, pairs_table
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.estimators.folds_and_blocks import make_design
from coronaryuq.estimation.runs.table import Runs, read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates.emulator import Emulator

PRINTED = ("rho_original", "rho_modified", "std_mc", "std_mfmc", "std_mfmc_ae")


def paper_table(
    data: str | Path, rows_csv: str | Path, settings: Settings, seed: int,
    out_csv: str | Path | None = None, out_md: str | Path | None = None, folder: str | Path | None = None,
) -> tuple[list[dict], dict[str, float]]:  # fmt: skip
    """Rows (keys as benchmark `table` fixes them, and more) and CPU seconds by part; files if asked.

    `folder` gets what the figures are drawn from, as a campaign has it: `estimates.json`, `pairs.csv`, `budget.json`.

    Columns `rho_original, std_mc, std_mfmc` follow the paper's conventions and equal its printed digits on its data.
    `rho_ae_in_sample` is what the paper prints as modified correlation, `rho_ae_held_out` the same method on runs
    that it was not fitted on. Where the rows file carries the paper's columns they come back as `paper_...`. The 0D
    model at resampled inputs is a Gaussian-process emulator; `emulator_error` is its held-out mean square error over
    variance.
    """
    runs, rows = read_runs(data), analysis.chosen_rows(read_rows(rows_csv), settings, rows_csv)
    analysis.enough(runs, settings)
    clock = [time.process_time()]
    design = make_design(runs, rows, count(len(runs), settings.folds), seed, settings.known_scaling)
    clock.append(time.process_time())
    networks = resampled = None
    if settings.autoencoder:
        networks = analysis.train(runs, rows, settings, seed)
        wanted = analysis.wanted_0d(networks, runs, settings.curve_nodes)
        resampled = emulated(runs, [row.column_0d for row in rows], wanted)
    clock.append(time.process_time())
    results = analysis.analyse(runs, rows, settings, seed, networks, resampled, design, beyond_mean=False)
    clock.append(time.process_time())
    printed = _printed(rows_csv)
    lines = [_line(result, printed[result["row"]]) for result in results]
    if out_csv:
        write_csv(out_csv, pd.DataFrame(lines))
    if out_md:
        write_text(out_md, markdown(lines))
    if folder:
        _for_figures(Path(folder), runs, rows, settings, seed, networks, resampled, results)
    parts = dict(zip(("emulators", "autoencoders", "control_variates"), np.diff(clock), strict=True))
    return lines, {name: float(value) for name, value in parts.items()}


def _for_figures(folder: Path, runs, rows, settings: Settings, seed: int, networks, resampled, results) -> None:
    write_json(folder / "estimates.json", {"rows": results, "settings": settings.model_dump(mode="json")})
    write_csv(folder / "pairs.csv", pairs_table.pairs(runs, rows, settings, seed, networks, resampled))
    write_json(folder / "budget.json", {"budget": convergence_and_budget.budget(results, settings.cost_ratio)})


def published(data: str | Path | None) -> tuple[Path, Path]:
    """Folder of published runs and its file of rows, as a campaign names it in `paper_data`."""
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
    emulator = Emulator(np.log(runs.theta), runs.q[names])
    values = emulator.predict(np.log(wanted[list(runs.inputs)].to_numpy(float)))
    return pd.DataFrame(values, index=wanted["sample"].astype(str))


def markdown(lines: list[dict]) -> str:
    """The table for a reader; the paper's printed value in brackets where the rows file has it."""
    heads = ["row", "quantity", "ρ original", "ρ AE in-sample", "ρ AE held out", "ρ best held out"]
    heads += ["std MC", "std MFMC", "std MFMC-AE", "std best", "best"]
    text = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for line in lines:

        def with_printed(key, printed, form, line=line):
            beside = line.get(f"paper_{printed}")
            return (
                format(line[key], form) + (f" ({beside})" if beside is not None else "")
                if line[key] is not None
                else "–"
            )

        cells = [
            line["row"], line["label"], with_printed("rho_original", "rho_original", ".4f"),
            with_printed("rho_ae_in_sample", "rho_modified", ".4f"), with_printed("rho_ae_held_out", "none", ".4f"),
            format(line["rho_best_held_out"], ".5f"), with_printed("std_mc", "std_mc", ".4f"),
            with_printed("std_mfmc", "std_mfmc", ".4f"), with_printed("std_mfmc_ae", "std_mfmc_ae", ".4f"),
            format(line["std_best"], ".6f"), line["best_method"],
        ]  # fmt: skip
        text.append("| " + " | ".join(cells) + " |")
    notes = sorted({note for line in lines for note in line["warnings"]})
    text += [
        "",
        "In brackets: as printed in the paper. std MFMC-AE is the cross-fitted claim; the paper's is in-sample.",
        "",
    ]
    text += [f"- {note}" for note in notes]
    return "\n".join(text) + "\n"


def _line(result: dict, given: dict[str, float]) -> dict:
    made, printed = result["estimators"], result["paper"]
    ae, best = made.get("MFMC-AE"), made["best"]
    line = {
        "row": result["row"], "label": result["label"],
        "rho_original": printed["rho_original"],
        "rho_ae_in_sample": ae and ae["rho_in_sample"], "rho_ae_held_out": ae and ae["rho_held_out"],
        "rho_best_held_out": best["rho_held_out"], "best_method": best["method"].removeprefix("best: "),
        "std_mc": printed["std_mc"], "std_mfmc": printed["std_mfmc"],
        "std_mfmc_ae": ae and ae["std"], "std_mfmc_ae_in_sample": ae and ae["std_in_sample"], "std_best": best["std"],
        "mean_mc": made["MC"]["mean"], "mean_best": best["mean"],
        "calibrated_best": [best["calibrated"]["low"], best["calibrated"]["high"]],
        "n_3d": best["n_3d"], "predictions_best": best["predictions"],
        "emulator_error": result["emulator_error"], "recommended": result["recommended"],
        "warnings": [*result["warnings"], *(w for v in made.values() for w in v["warnings"])],
    }  # fmt: skip
    return line | {f"paper_{name}": value for name, value in given.items()}


def _printed(rows_csv: str | Path) -> dict[str, dict[str, float]]:
    """Row → what the paper prints for it, where the file of rows carries that."""
    frame = read_csv(rows_csv, columns=("row",))
    found = {name: pd.to_numeric(frame[name], errors="coerce") for name in PRINTED if name in frame}
    return {
        str(row).strip(): {name: float(values[i]) for name, values in found.items() if np.isfinite(values[i])}
        for i, row in enumerate(frame["row"])
    }
