"""Pairs of 3D and 0D outputs, before and after the shared space: the data behind the scatter figure (Fig. 3)."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.io.tables import write_csv
from coronaryuq.estimation.analysis.estimate_rows import curves_of
from coronaryuq.estimation.estimators.dependence import assign_runs
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.estimators.per_row import followed
from coronaryuq.estimation.runs.table import Row, Runs, pair, read_rows, read_runs
from coronaryuq.estimation.settings import Settings
from coronaryuq.estimation.surrogates import mfmc_ae
from coronaryuq.estimation.surrogates.networks_file import read_networks, read_resampled
from coronaryuq.estimation.training import chosen_rows


def write_pairs(
    runs_folder: str | Path, networks_npz: str | Path, zerod_tables: list[str | Path], settings: Settings, seed: int,
    out_csv: str | Path,
) -> None:  # fmt: skip
    """Write pairs of outputs: row, label, sample, y (3D), q (0D at the same θ), q_resampled (0D at the paired input).

    Every resampled value comes from the network that did not see its sample, so the figure shows what a new sample
    would show. It is the control variate of the estimator itself, moved to the mean and spread of q, so that their
    correlation is that of the table. Without networks the column is empty.

    Parameters
    ----------
    runs_folder
        Runs in the published-runs format (docs/reference/formats.md).
    networks_npz, zerod_tables
        Networks of MFMC-AE, and 0D outputs at their inputs.
    settings, seed
        Settings of the stage and seed.
    out_csv
        Table to write.

    Raises
    ------
    InputError
        If an input file is not as described.
    """
    runs, rows_csv = read_runs(runs_folder), Path(runs_folder) / "rows.csv"
    networks = read_networks(networks_npz)
    outputs = read_resampled(zerod_tables) if networks else None
    write_csv(
        out_csv, pairs(runs, chosen_rows(read_rows(rows_csv), settings, rows_csv), settings, seed, networks, outputs)
    )


def pairs(
    runs: Runs, rows: list[Row], settings: Settings, seed: int, networks: mfmc_ae.Networks | None,
    resampled: pd.DataFrame | None,
) -> pd.DataFrame:  # fmt: skip
    """Make the table of `write_pairs`; `resampled`: 0D outputs at the networks' inputs, index `sample`."""
    fold, _ = assign_runs(runs, count(len(runs), settings.folds), seed)
    frames = []
    for row in rows:
        y, q = pair(runs, row)
        paired = np.full(len(y), np.nan)
        if networks is not None and resampled is not None and row.name in networks.rows:
            curves = curves_of(networks, row, resampled[row.column_0d], settings.curve_nodes)
            if curves:
                held, _ = followed(runs.theta, y, fold, networks, row, curves)
                paired = q.mean() + q.std() * (held - held.mean()) / (held.std() or 1.0)
        frame = {"row": row.name, "label": row.label, "sample": runs.samples, "y": y, "q": q, "q_resampled": paired}
        frames.append(pd.DataFrame(frame))
    return pd.concat(frames, ignore_index=True)
