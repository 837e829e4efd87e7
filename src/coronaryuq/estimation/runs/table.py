"""Reads a folder of runs in the published-runs format: pilot inputs with 3D and 0D outputs, propagation inputs."""

from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.records import STATE

KEYS = ("row", "column_3d", "column_0d")
# Columns named where one is missing: those that resemble it most.
SHOWN = 6


@dataclass(frozen=True)
class States:
    """Chain and draw (n + m,) of the pilot's samples and then of the propagation samples."""

    chain: np.ndarray
    draw: np.ndarray


@dataclass(frozen=True)
class CoarseRuns:
    """A coarse 3D level: outputs at the n pilot samples and then at m_c further ones, NaN where a run failed.

    theta (m_c, d), q (m_c rows): inputs and 0D outputs of the further samples.
    """

    outputs: pd.DataFrame
    theta: np.ndarray
    q: pd.DataFrame


@dataclass(frozen=True)
class Runs:
    """Runs of one patient, pilot rows aligned by `sample`.

    inputs: columns of θ, d of them. theta (n, d): the n samples whose 3D and 0D runs both succeeded. y: 3D outputs,
    q: 0D outputs (n rows each). theta_more (m, d): propagation samples. q_more: their 0D outputs (m rows), or None
    if they were not run. theta_failed (f, d): pilot samples without a 3D run. limits: (d, 2) bounds of θ or None.
    states: where in a chain all samples stand, if both tables of inputs say so. theta_more_failed (g, d): propagation
    samples whose 0D run failed.
    """

    folder: Path
    inputs: tuple[str, ...]
    samples: tuple[str, ...]
    theta: np.ndarray
    y: pd.DataFrame
    q: pd.DataFrame
    theta_more: np.ndarray
    q_more: pd.DataFrame | None
    theta_failed: np.ndarray
    limits: np.ndarray | None = None
    samples_more: tuple[str, ...] = field(default=())
    coarse: CoarseRuns | None = None
    states: States | None = None
    theta_more_failed: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.theta)

    @cached_property
    def logged(self) -> np.ndarray:
        """Inputs (d,) that are positive in every sample, so that estimators see their logarithm."""
        parts = [self.theta, self.theta_more, self.theta_failed, self.theta_more_failed]
        if self.coarse is not None:
            parts.append(self.coarse.theta)
        return np.all([(part > 0).all(axis=0) for part in parts if part is not None and len(part)], axis=0)

    def coordinates(self, theta: np.ndarray) -> np.ndarray:
        """Return inputs (m, d) as estimators see them: the logarithm of those that are `logged`, others as given."""
        if self.logged.all():
            return np.log(theta)
        return np.where(self.logged, np.log(np.where(self.logged, theta, 1.0)), theta)

    def from_coordinates(self, coordinates: np.ndarray) -> np.ndarray:
        """Return the inputs (m, d) of some coordinates: the inverse of `coordinates`."""
        return np.exp(coordinates) if self.logged.all() else np.where(self.logged, np.exp(coordinates), coordinates)

    def bounds(self, name: str) -> tuple[float, float]:
        """Bounds of one input of runs that have limits."""
        if self.limits is None:
            raise ValueError(f"{self.folder} has no limits of θ")
        low, high = self.limits[self.inputs.index(name)]
        return low, high


@dataclass(frozen=True)
class Row:
    """One line of the table: a 3D quantity, the 0D quantity that the paper pairs with it, and a label.

    networks: whether MFMC-AE is trained for it. warning: what a reader has to know about the quantity. shared: whether
    control variates of other rows see its 0D output.
    """

    name: str
    column_3d: str
    column_0d: str
    label: str
    networks: bool = True
    warning: str = ""
    shared: bool = True


def read_runs(folder: str | Path) -> Runs:
    """Read a folder of runs in the published-runs format (docs/reference/formats.md).

    A pilot sample that is missing or not finite in any column of `outputs_3d.csv` counts as failed; columns without
    any value are left out. A sample that is missing from `outputs_3d_coarse.csv` failed on the coarse level.

    Raises
    ------
    InputError
        If anything is missing, duplicated, unknown or not a number.
    """
    folder = Path(folder)
    params = _table(folder / "params.csv")
    states = _states(folder / "params.csv", params)
    params = params.drop(columns=[name for name in STATE if name in params])
    inputs = tuple(params.columns)
    if not inputs:
        raise InputError(
            folder / "params.csv",
            None,
            None,
            "contains no inputs; expected one column per input in addition to `sample`",
        )
    limits = _limits(folder / "param_limits.json", inputs)
    theta = _finite(folder / "params.csv", params)
    outputs_3d, outputs_0d = _table(folder / "outputs_3d.csv"), _table(folder / "outputs_0d.csv")
    for name, outputs in (("outputs_3d.csv", outputs_3d), ("outputs_0d.csv", outputs_0d)):
        unknown = outputs.index.difference(params.index)
        if len(unknown):
            raise InputError(
                folder / name, "sample", str(unknown[0]), "not in params.csv; write both from the same campaign"
            )
    y = outputs_3d.dropna(axis=1, how="all").reindex(params.index)
    q = outputs_0d.dropna(axis=1, how="all").reindex(params.index)
    _check_finite(folder / "outputs_0d.csv", q, "leave the column out")
    ended = np.isfinite(y.to_numpy(dtype=float)).all(axis=1)
    if ended.sum() < 2:
        raise InputError(
            folder / "outputs_3d.csv", None, None, f"{int(ended.sum())} usable 3D runs; at least 2 are needed"
        )
    theta_more, samples_more, states_more = _propagation(folder, inputs, limits)
    q_more, lost = None, None
    if (folder / "outputs_0d_propagation.csv").exists():
        given = samples_more
        theta_more, samples_more, q_more, lost = _propagation_outputs(folder, theta_more, samples_more)
        states_more = None if states_more is None else states_more[np.isin(given, samples_more)]
    both = None
    if states is not None and (states_more is not None or not len(theta_more)):
        parts = states[ended] if states_more is None else np.vstack([states[ended], states_more])
        both = States(*parts.T)
    return Runs(
        folder, inputs, tuple(params.index[ended]), theta[ended],
        y[ended].reset_index(drop=True), q[ended].reset_index(drop=True),
        theta_more, q_more, theta[~ended], limits, samples_more, _coarse(folder, y, q, params.index[ended], inputs),
        both, lost,
    )  # fmt: skip


def read_rows(path: str | Path) -> list[Row]:
    """Read `rows.csv`: columns `row, column_3d, column_0d`; the label joins `qoi_3d, qoi_0d, branch` where present.

    Where present, `networks` says whether MFMC-AE is trained for the row, `shared` whether control variates of other
    rows see its 0D output, and `warning` what a reader has to know about its quantity.

    Raises
    ------
    InputError
        If the file has no rows, an empty cell in a needed column, two rows of one name, or `networks` or `shared` other
        than yes and no.
    """
    frame = read_csv(path, columns=KEYS)
    if not len(frame):
        raise InputError(path, "row", None, "no rows; name a 3D and a 0D column in each")
    for key in KEYS:
        if frame[key].isna().any():
            line = int(frame[key].isna().argmax()) + 2
            raise InputError(path, f"{key} of line {line}", None, "empty; every row needs a name, a 3D and a 0D column")
    frame = frame.astype(object).where(frame.notna(), "").astype(str).apply(lambda values: values.str.strip())
    if frame["row"].duplicated().any():
        raise InputError(
            path, "row", frame["row"][frame["row"].duplicated()].iloc[0], "twice in the file; row names must be unique"
        )
    words = [c for c in ("qoi_3d", "qoi_0d", "branch") if c in frame]
    return [
        Row(
            r["row"],
            r["column_3d"],
            r["column_0d"],
            ", ".join(filter(None, (r[w] for w in words))) or r["column_3d"],
            _yes(path, "networks", r.get("networks", "")),
            r.get("warning", ""),
            _yes(path, "shared", r.get("shared", "")),
        )
        for _, r in frame.iterrows()
    ]


def _yes(path: str | Path, column: str, word: str) -> bool:
    """Return what a column says of a row: yes, unless the file says no."""
    if word.lower() not in ("", "yes", "no"):
        raise InputError(path, column, word, "write yes or no")
    return word.lower() != "no"


def pair(runs: Runs, row: Row) -> tuple[np.ndarray, np.ndarray]:
    """Return 3D and 0D outputs (n,), (n,) of one row on the pilot; `InputError` for a missing column."""
    return column(runs.folder / "outputs_3d.csv", runs.y, row.column_3d), column(
        runs.folder / "outputs_0d.csv", runs.q, row.column_0d
    )


def column(path: Path, frame: pd.DataFrame, name: str) -> np.ndarray:
    """Return a column as a float array; the `InputError` for a missing one lists those that exist."""
    if name not in frame.columns:
        names = [str(column) for column in frame.columns]
        near = get_close_matches(name, names, n=SHOWN, cutoff=0.0)
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        raise InputError(path, name, None, f"column missing; the file has {', '.join(near)}{more}")
    return frame[name].to_numpy(dtype=float)


def _table(path: Path) -> pd.DataFrame:
    frame = read_csv(path, columns=("sample",))
    names = frame.pop("sample").astype(str)
    if names.duplicated().any():
        raise InputError(path, "sample", names[names.duplicated()].iloc[0], "twice in the file; keep one of them")
    frame.index = pd.Index(names, name="sample")
    for name, values in frame.items():
        if not pd.api.types.is_numeric_dtype(values) or pd.api.types.is_bool_dtype(values):
            raise InputError(
                path, str(name), str(values.iloc[0]), "not a number; only numbers and empty cells are allowed"
            )
    return frame


def _states(path: Path, frame: pd.DataFrame) -> np.ndarray | None:
    """Return chain and draw (n, 2) of every sample; None without these columns."""
    present = [name for name in STATE if name in frame]
    if not present:
        return None
    if len(present) == 1:
        (missing,) = set(STATE) - set(present)
        raise InputError(path, missing, None, f"column missing; `{present[0]}` alone does not say which state it is")
    values = frame[list(STATE)].to_numpy(dtype=float)
    wrong = np.argwhere(~(np.isfinite(values) & (values == np.round(values))))
    if len(wrong):
        i, j = wrong[0]
        raise InputError(path, f"{STATE[j]} of {frame.index[i]}", values[i, j], "expected a whole number")
    return values


def _finite(path: Path, frame: pd.DataFrame) -> np.ndarray:
    values = frame.to_numpy(dtype=float)
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        i, j = bad[0]
        raise InputError(path, f"{frame.columns[j]} of {frame.index[i]}", values[i, j], "not a finite number")
    return values


def _limits(path: Path, inputs: tuple[str, ...]) -> np.ndarray | None:
    if not path.exists():
        return None
    limits = read_json(path, ("min", "max"))
    for bound in ("min", "max"):
        for name in inputs:
            value = limits[bound].get(name) if isinstance(limits[bound], dict) else None
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise InputError(path, f"{bound}.{name}", value, "expected a number for every column of params.csv")
    bounds = np.array([[limits["min"][name], limits["max"][name]] for name in inputs], dtype=float)
    if not (bounds[:, 0] < bounds[:, 1]).all():
        raise InputError(path, inputs[int(np.argmin(np.diff(bounds)))], None, "min is not below max")
    return bounds


def _further(path: Path, inputs: tuple[str, ...], frame: pd.DataFrame | None = None) -> pd.DataFrame:
    """Return the columns of the pilot's inputs of the samples beyond it, index `sample`; `frame` if it is read."""
    frame = _table(path) if frame is None else frame
    missing = [name for name in inputs if name not in frame]
    if missing:
        raise InputError(path, missing[0], None, "column missing; expected the columns of params.csv")
    return frame[list(inputs)]


def _check_finite(path: Path, q: pd.DataFrame, otherwise: str) -> None:
    lost = np.argwhere(~np.isfinite(q.to_numpy(dtype=float)))
    if len(lost):
        i, j = lost[0]
        remedy = f"no finite 0D output; run the 0D model at this sample, or {otherwise}"
        raise InputError(path, f"{q.columns[j]} of {q.index[i]}", None, remedy)


def _coarse(
    folder: Path, y: pd.DataFrame, q: pd.DataFrame, kept: pd.Index, inputs: tuple[str, ...]
) -> CoarseRuns | None:
    """Read the coarse level, if the folder has one; kept: the pilot's samples that count."""
    path, beyond = folder / "outputs_3d_coarse.csv", folder / "params_coarse.csv"
    if not path.exists():
        return None
    outputs, params = _table(path), _further(beyond, inputs)
    unknown = outputs.index.difference(y.index.union(params.index))
    if len(unknown):
        raise InputError(path, "sample", str(unknown[0]), "neither in params.csv nor in params_coarse.csv")
    twice = params.index.intersection(y.index)
    if len(twice):
        raise InputError(beyond, "sample", str(twice[0]), "also in params.csv; keep it there only")
    unknown = outputs.columns.difference(y.columns)
    if len(unknown):
        raise InputError(path, str(unknown[0]), None, "no such column in outputs_3d.csv")
    q_coarse = _table(folder / "outputs_0d_coarse.csv").reindex(params.index).reindex(columns=q.columns)
    _check_finite(folder / "outputs_0d_coarse.csv", q_coarse, "leave it out of params_coarse.csv")
    outputs = outputs.reindex(kept.append(params.index)).reset_index(drop=True)
    return CoarseRuns(outputs, _finite(beyond, params), q_coarse.reset_index(drop=True))


def _propagation(
    folder: Path, inputs: tuple[str, ...], limits: np.ndarray | None
) -> tuple[np.ndarray, tuple[str, ...], np.ndarray | None]:
    physical, normalised = folder / "params_propagation.csv", folder / "params_propagation_normalized.csv"
    if physical.exists():
        table = _table(physical)
        frame = _further(physical, inputs, table)
        return _finite(physical, frame), tuple(frame.index), _states(physical, table)
    if not normalised.exists():
        return np.empty((0, len(inputs))), (), None
    if limits is None:
        raise InputError(
            folder / "param_limits.json", None, None, "no such file; normalised propagation inputs need it"
        )
    with open(normalised, "rb") as file:
        empty = not any(line.strip() for line in file)
    if empty:
        raise InputError(normalised, None, None, "empty; draw inputs at which only the 0D model is run")
    try:
        values = np.loadtxt(normalised, delimiter=",", ndmin=2)
    except ValueError as error:
        raise InputError(normalised, None, None, f"expected numbers without a header ({error})") from None
    if values.shape[1] != len(inputs):
        raise InputError(normalised, None, values.shape[1], f"columns; expected the {len(inputs)} of params.csv")
    if not np.isfinite(values).all():
        raise InputError(normalised, None, None, "contains a value that is not a finite number")
    theta = limits[:, 0] + (values + 1) / 2 * (limits[:, 1] - limits[:, 0])
    return theta, tuple(f"propagation_{i:05d}" for i in range(len(theta))), None


def _propagation_outputs(
    folder: Path, theta: np.ndarray, samples: tuple[str, ...]
) -> tuple[np.ndarray, tuple[str, ...], pd.DataFrame, np.ndarray]:
    """Return the samples that have outputs, these, and θ of the samples whose 0D run failed."""
    path = folder / "outputs_0d_propagation.csv"
    frame = _table(path)
    unknown = frame.index.difference(pd.Index(samples))
    if len(unknown):
        raise InputError(
            path, "sample", str(unknown[0]), "not among the propagation inputs; write both from the same campaign"
        )
    wanted = pd.Index(samples)
    frame = frame if frame.index.equals(wanted) else frame.reindex(wanted)
    ended = np.ones(len(frame), dtype=bool)
    for _, values in frame.items():  # one column at a time: the table may be most of the memory
        if values.notna().any():
            ended &= np.isfinite(values.to_numpy(dtype=float))
    if ended.all():
        return theta, samples, frame.reset_index(drop=True), theta[~ended]
    kept = tuple(name for name, ran in zip(samples, ended, strict=True) if ran)
    return theta[ended], kept, frame[ended].reset_index(drop=True), theta[~ended]
