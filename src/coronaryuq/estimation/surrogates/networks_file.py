"""Read the trained networks of MFMC-AE and the 0D runs at their inputs."""

from pathlib import Path

import pandas as pd

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv, read_npz, read_parquet
from coronaryuq.estimation.surrogates.mfmc_ae import Networks


def read_networks(path: str | Path) -> Networks | None:
    """Read networks from the `.npz`, without pickle; None if none were trained. `InputError` for another file."""
    arrays = read_npz(path, ("rows",))
    try:
        return Networks.from_arrays(arrays) if len(arrays["rows"]) else None
    except (ValueError, KeyError) as error:
        raise InputError(path, None, None, f"not networks of this stage ({error}); train again") from None


def read_resampled(paths: list[str | Path]) -> pd.DataFrame:
    """Read 0D outputs at the resampled inputs (Parquet or CSV), index `sample`, NaN for failed runs.

    Raises
    ------
    InputError
        If a file is broken, or if a sample was run twice.
    """
    frames = []
    for path in paths:
        if Path(path).suffix == ".parquet":
            frames.append(read_parquet(path, ("sample",)))
        else:
            frames.append(read_csv(path, ("sample",)))
    frame = pd.concat(frames, ignore_index=True)
    if frame["sample"].duplicated().any():
        raise InputError(
            paths[0], "sample", frame["sample"][frame["sample"].duplicated()].iloc[0], "twice among the 0D runs"
        )
    return frame.set_index(frame.pop("sample").astype(str))
