"""Train the networks of MFMC-AE; apart from the estimates, whose edits need not train them again."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import write_csv, write_npz
from coronaryuq.estimation.estimators.dependence import assign_runs
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.runs.table import Row, Runs, pair, read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae


def write_networks(
    runs_folder: str | Path, settings: Settings, seed: int, networks_npz: str | Path, resampled_csv: str | Path,
    rows_csv: str | Path | None = None,
) -> None:  # fmt: skip
    """Train MFMC-AE for all rows, folds and restarts; write the networks and the 0D inputs that they need.

    Parameters
    ----------
    runs_folder
        Runs in the published-runs format (docs/reference/formats.md).
    settings, seed
        Settings of the stage; both files are written without rows if no row has networks.
    networks_npz
        Networks to write.
    resampled_csv
        0D inputs to write: `sample` and one column per input of `params.csv`, (folds + 1) · curve_nodes lines per row.
        The 0D stage runs them like any other table of θ.
    rows_csv
        Rows to estimate; `rows.csv` of the folder if None.

    Raises
    ------
    InputError
        If the folder is not as described, or has too few runs.
    """
    runs, chosen = read_chosen(runs_folder, rows_csv, settings)
    check_number_of_runs(runs, settings)
    rows = with_networks(chosen, settings)
    if not rows:
        write_npz(networks_npz, {"rows": np.array([], dtype=str)})
        write_csv(resampled_csv, pd.DataFrame(columns=["sample", *runs.inputs]))
        return
    networks = train(runs, rows, settings, seed)
    write_npz(networks_npz, networks.arrays())
    write_csv(resampled_csv, resampled_inputs(networks, runs, settings.curve_nodes))


def read_chosen(runs_folder: str | Path, rows_csv: str | Path | None, settings: Settings) -> tuple[Runs, list[Row]]:
    """Read the runs of a folder, and the rows that the settings name of `rows_csv` or of the folder's rows."""
    rows_csv = rows_csv or Path(runs_folder) / "rows.csv"
    runs = read_runs(runs_folder)
    check_groups(runs, settings)
    return runs, chosen_rows(read_rows(rows_csv), settings, rows_csv)


def check_groups(runs: Runs, settings: Settings) -> None:
    """Raise `InputError` for a group with an input that the runs do not have, or that is in two groups."""
    grouped = [name for group in settings.input_groups.values() for name in group]
    for name in grouped:
        wrong = "is in two groups" if grouped.count(name) > 1 else f"no such input; there are {', '.join(runs.inputs)}"
        if name not in runs.inputs or grouped.count(name) > 1:
            raise InputError(runs.folder / "params.csv", "estimation.input_groups", name, wrong)


def chosen_rows(rows: list[Row], settings: Settings, file: str | Path) -> list[Row]:
    """Return the rows that the settings name, all if they name none; `InputError` for a row that does not exist."""
    names = {row.name for row in rows}
    for name in settings.rows:
        if name not in names:
            raise InputError(file, "row", name, f"no such row; the file has {', '.join(row.name for row in rows)}")
    return [row for row in rows if not settings.rows or row.name in settings.rows]


def with_networks(rows: list[Row], settings: Settings) -> list[Row]:
    """Return the rows for which MFMC-AE is trained."""
    return [row for row in rows if row.networks and settings.autoencoder]


def check_number_of_runs(runs: Runs, settings: Settings) -> None:
    """Raise `InputError` for fewer 3D runs or propagation samples than the estimators need."""
    if len(runs) < settings.min_3d:
        raise InputError(
            runs.folder / "outputs_3d.csv", "usable 3D runs", len(runs), f"estimation.min_3d is {settings.min_3d}"
        )
    if len(runs.theta_more) < 2 * count(len(runs), settings.folds):
        raise InputError(
            runs.folder / "params_propagation.csv", "samples", len(runs.theta_more),
            "draw inputs at which only the 0D model is run (or params_propagation_normalized.csv)",
        )  # fmt: skip


def box(runs: Runs) -> np.ndarray:
    """Return θ at −1 and +1 for the networks (d, 2): the limits where known, widened to hold every sample."""
    everywhere = np.vstack([runs.theta, runs.theta_more]) if len(runs.theta_more) else runs.theta
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    if runs.limits is not None:
        low, high = np.minimum(low, runs.limits[:, 0]), np.maximum(high, runs.limits[:, 1])
    return np.column_stack([low, np.where(high > low, high, low + 1.0)])


def training_settings(settings: Settings) -> mfmc_ae.Training:
    """Return the part of the settings that the networks are trained with."""
    return mfmc_ae.Training(
        settings.steps, settings.batch, settings.learning_rate, settings.decay, settings.restarts, settings.correlation
    )


def train(runs: Runs, rows: list[Row], settings: Settings, seed: int) -> mfmc_ae.Networks:
    """Train the MFMC-AE networks of these rows and all folds."""
    fold, _ = assign_runs(runs, count(len(runs), settings.folds), seed)
    return train_on(runs, rows, mfmc_ae.fits_of(fold), settings, seed)


def train_on(runs: Runs, rows: list[Row], fits: list[np.ndarray], settings: Settings, seed: int) -> mfmc_ae.Networks:
    """Train the MFMC-AE networks of all rows on each of the training sets `fits`, which hold indices of pilot runs."""
    pairs = {}
    for row in rows:
        y, q = pair(runs, row)
        pairs[row.name] = (row.column_3d, y, row.column_0d, q)
    return mfmc_ae.train(runs.theta, box(runs), pairs, fits, training_settings(settings), seed)


def resampled_inputs(networks: mfmc_ae.Networks, runs: Runs, nodes: int) -> pd.DataFrame:
    """0D inputs that MFMC-AE needs: `sample` (ROW.FOLD.NODE, fold `all` for the in-sample fit) and θ."""
    frames = []
    for row in networks.rows:
        for k in [*range(networks.folds), mfmc_ae.IN_SAMPLE]:
            theta = mfmc_ae.resampled(networks, row, k, mfmc_ae.nodes(networks, row, k, nodes))
            frame = pd.DataFrame(theta, columns=list(runs.inputs))
            frame.insert(0, "sample", [sample_name(row, k, i) for i in range(len(theta))])
            frames.append(frame)
    return pd.concat(frames, ignore_index=True)


def sample_name(row: str, k: int, node: int) -> str:
    """Return the name of a resampled input of one row and fold."""
    return f"{row}.{'all' if k == mfmc_ae.IN_SAMPLE else k}.{node:03d}"
