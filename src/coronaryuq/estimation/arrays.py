"""Estimates from plain arrays or data frames: `coronaryuq.estimate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from coronaryuq.core.errors import InputError
from coronaryuq.core.units import percent
from coronaryuq.estimation.analysis import tables
from coronaryuq.estimation.analysis.estimate_rows import estimate_row, estimates_of, prepare
from coronaryuq.estimation.estimators import joint
from coronaryuq.estimation.estimators.design import make_design
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.results import STATISTICAL, RowReport
from coronaryuq.estimation.runs.table import Row, Runs, States
from coronaryuq.estimation.settings import Settings

EVERY = ("",)
"""Prefix of every name: any 0D output may inform a control variate."""


@dataclass(frozen=True)
class Estimated:
    """Means of one or several quantities, each by its recommended estimator, and all others in `table()`.

    Attributes
    ----------
    names
        Names of the quantities.
    rows
        Reports of the quantities, with every estimator of each.
    covariance
        Variance of the error of the mean; for y (n, l) the joint covariance (l, l) of the errors of the l means.
    one
        Whether y was one quantity (n,): `mean`, `std` and `recommended` are then single values.
    """

    names: tuple[str, ...]
    rows: list[RowReport]
    covariance: Any
    one: bool

    @property
    def mean(self) -> Any:
        """Mean, or means (l,)."""
        return self._per_quantity([row.recommended_report.mean for row in self.rows])

    @property
    def std(self) -> Any:
        """Reported standard error of the mean, or of the means (l,)."""
        return self._per_quantity([row.recommended_report.std for row in self.rows])

    @property
    def interval(self) -> np.ndarray:
        """Lower and upper end of the calibrated interval of the mean, (2,) or (l, 2)."""
        ends = [row.recommended_report.calibrated for row in self.rows]
        every = np.array([[interval.low, interval.high] for interval in ends])
        return every[0] if self.one else every

    @property
    def recommended(self) -> Any:
        """Name of the recommended estimator, or a tuple of l names."""
        found = tuple(row.recommended for row in self.rows)
        return found[0] if self.one else found

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the runs and about the recommended estimators, each once."""
        found: dict[str, list[str]] = {}
        for name, row in zip(self.names, self.rows, strict=True):
            for warning in (*row.warnings, *row.recommended_report.warnings):
                found.setdefault(warning, []).append(name)
        every = len(self.names)
        return tuple(w if len(of) == every else f"{', '.join(of)}: {w}" for w, of in found.items())

    @property
    def budget(self) -> pd.DataFrame:
        """Variance of the mean by source, one line per quantity.

        `runs_3d`: finite number of runs of the expensive model; `propagation`: finite number of propagation samples;
        `chain`: what the samples' dependence on each other adds to both.
        """
        lines = [row.recommended_report.variance for row in self.rows]
        return pd.DataFrame(lines, index=list(self.names), columns=list(STATISTICAL))

    def table(self) -> pd.DataFrame:
        """Return every estimator of every quantity, one line each; columns as in `estimation/table.csv`."""
        table = tables.table(self.rows).drop(columns=["row", "label"])
        recommended = {row.column_3d: row.recommended for row in self.rows}
        table.insert(3, "recommended", table["column_3d"].map(recommended) == table["estimator"])
        return table

    def _per_quantity(self, values: list[float]) -> Any:
        return values[0] if self.one else np.array(values)

    def __repr__(self) -> str:
        lines = []
        for name, row in zip(self.names, self.rows, strict=True):
            best = row.recommended_report
            low, high, level = best.calibrated.low, best.calibrated.high, best.calibrated.level
            lines.append(
                f"{name}: {best.mean:.6g} ({percent(level)} interval {low:.6g} to {high:.6g}, {row.recommended})"
            )
        return "\n".join([*lines, *(f"warning: {warning}" for warning in self.warnings)])


def estimate(
    theta: ArrayLike | pd.DataFrame,
    y: ArrayLike | pd.DataFrame | pd.Series,
    q: ArrayLike | pd.DataFrame | pd.Series,
    theta_more: ArrayLike | pd.DataFrame,
    q_more: ArrayLike | pd.DataFrame | pd.Series | None = None,
    chains: tuple[ArrayLike, ArrayLike] | None = None,
    level: float = 0.95,
    seed: int = 1,
) -> Estimated:
    """Estimate the mean of an expensive model's outputs from few of its runs and many of a cheap model's.

    A data frame's columns give the names; y and q of the same name are a pair for MFMC. Otherwise columns at the same
    position are, if there are as many of them, and else every y is paired with the first q that is not constant. The
    estimator crossfit-GP uses all q. An input that is positive in every sample enters by its logarithm, any other
    one as it is.

    Parameters
    ----------
    theta
        Inputs (n, d) of the expensive model's runs; (n,) for one input.
    y
        Expensive model's outputs, (n,) or (n, l).
    q
        Cheap model's outputs at the same inputs, (n,) or (n, k).
    theta_more
        Inputs (m, d) of the propagation samples, drawn from the same distribution independently of `theta`.
    q_more
        Cheap model's outputs there, (m,) or (m, k); a row with a value that is not finite is a failed run. None: they
        are emulated.
    chains
        Where the inputs are states of Markov chains: the number of the chain and that of the draw, (n + m,) each, for
        the rows of `theta` and then of `theta_more`. The chains' own error is then part of the interval.
    level
        Confidence level of the interval, above 0.5 and below 1.
    seed
        Seed of folds and blocks.

    Returns
    -------
    Estimated
        Means with intervals, covariance and variance by source.

    Raises
    ------
    InputError
        If shapes or names do not agree, if a value is not finite, or if there are too few runs.
    """
    runs = _runs(theta, y, q, theta_more, q_more, chains)
    if not 0.5 < level < 1:
        raise InputError("estimate", "level", level, "expected a confidence level above 0.5 and below 1")
    settings = Settings(level=level, known_scaling=None, autoencoder=False)
    folds = count(len(runs), settings.folds)
    for name, number, least in (("y", len(runs), settings.min_3d), ("theta_more", len(runs.theta_more), 2 * folds)):
        if number < least:
            failed = 0 if runs.theta_more_failed is None or name == "y" else len(runs.theta_more_failed)
            without = f" in addition to {failed} whose q_more is not finite" if failed else ""
            raise InputError("estimate", name, number, f"rows{without}; at least {least} are needed")
    _check_distinct(runs, folds)
    rows = _pairs(list(runs.y), runs.q)
    design = make_design(runs, rows, folds, seed, families=EVERY)
    methods, findings = prepare(design, settings, seed, beyond_mean=False)
    reports = [estimate_row(row, methods, findings) for row in rows]
    recommended = [estimates_of(row, methods)[0][report.recommended] for row, report in zip(rows, reports, strict=True)]
    covariance = joint.covariance(recommended)
    one = np.ndim(y) == 1
    return Estimated(tuple(runs.y), reports, float(covariance[0, 0]) if one else covariance, one)


def _runs(theta: Any, y: Any, q: Any, theta_more: Any, q_more: Any, chains: Any) -> Runs:
    for name, values in (("y", y), ("q", q)):
        _check_order(name, values, theta, "theta")
    _check_order("q_more", q_more, theta_more, "theta_more")
    pilot, outputs, cheap = _frame(theta, "theta"), _frame(y, "y"), _frame(q, "q")
    for name, frame in (("y", outputs), ("q", cheap)):
        if len(frame) != len(pilot):
            raise InputError("estimate", name, len(frame), f"rows; theta has {len(pilot)}")
    for name, frame in (("theta", pilot), ("y", outputs), ("q", cheap)):
        _check_finite(name, frame, "leave this row out of theta, y and q")
    more = _like(_frame(theta_more, "theta_more", pilot.columns), pilot, "theta_more", "theta")
    _check_finite("theta_more", more, "leave this row out of theta_more" + ("" if q_more is None else " and q_more"))
    ran, beyond = np.ones(len(more), dtype=bool), None
    if q_more is not None:
        beyond = _like(_frame(q_more, "q_more", cheap.columns), cheap, "q_more", "q")
        if len(beyond) != len(more):
            raise InputError("estimate", "q_more", len(beyond), f"rows; theta_more has {len(more)}")
        ran = np.isfinite(beyond.to_numpy(float)).all(axis=1)
        beyond = beyond[ran].reset_index(drop=True)
    propagated = more.to_numpy(float)
    return Runs(
        Path("estimate"), tuple(pilot.columns), tuple(f"row {i}" for i in range(len(pilot))), pilot.to_numpy(float),
        outputs, cheap, propagated[ran], beyond, np.empty((0, pilot.shape[1])),
        states=_states(chains, len(pilot), ran), theta_more_failed=propagated[~ran],
    )  # fmt: skip


def _frame(values: Any, name: str, columns: Any = None) -> pd.DataFrame:
    """Return a table with an index from 0; arrays get the names `columns`, by default NAME or NAME_0, NAME_1, ..."""
    if isinstance(values, pd.Series):
        values = values.to_frame(values.name if values.name is not None else name)
    if isinstance(values, pd.DataFrame):
        frame = values.reset_index(drop=True).rename(columns=str)
        if not frame.columns.is_unique:
            raise InputError("estimate", name, frame.columns[frame.columns.duplicated()][0], "two columns of this name")
    else:
        array = np.ma.filled(np.ma.asarray(values, dtype=float), np.nan) if np.ma.isMA(values) else np.asarray(values)
        if array.ndim not in (1, 2):
            raise InputError("estimate", name, array.shape, "expected an array of one or two dimensions")
        array = array[:, None] if array.ndim == 1 else array
        names = [name] if np.ndim(values) == 1 else [f"{name}_{j}" for j in range(array.shape[1])]
        if columns is not None and len(columns) == array.shape[1]:
            names = list(columns)
        frame = pd.DataFrame(array, columns=names)
    if any(kind.kind == "c" for kind in map(np.dtype, frame.select_dtypes("complex").dtypes)):
        raise InputError("estimate", name, None, "expected real numbers; it is complex")
    try:
        return frame.astype(float)
    except (TypeError, ValueError) as error:
        raise InputError("estimate", name, None, f"expected numbers ({error})") from None


def _like(frame: pd.DataFrame, other: pd.DataFrame, name: str, like: str) -> pd.DataFrame:
    """Return `frame` with the columns of `other`."""
    missing = [column for column in other if column not in frame]
    if missing:
        raise InputError("estimate", name, missing[0], f"column missing; expected the {other.shape[1]} of {like}")
    return frame[list(other)]


def _check_finite(name: str, frame: pd.DataFrame, remedy: str) -> None:
    wrong = np.argwhere(~np.isfinite(frame.to_numpy(float)))
    if len(wrong):
        i, j = wrong[0]
        raise InputError("estimate", f"{name}, row {i}, {frame.columns[j]}", float(frame.iloc[i, j]), remedy)


def _check_order(name: str, values: Any, first: Any, of: str) -> None:
    """Raise InputError where two tables have the same labels of rows in different orders: rows are paired by place."""
    if not (isinstance(values, pd.DataFrame | pd.Series) and isinstance(first, pd.DataFrame | pd.Series)):
        return
    mine, its = values.index, first.index
    if len(mine) == len(its) and not mine.equals(its) and set(mine) == set(its):
        raise InputError("estimate", name, mine[0], f"rows are in another order than those of {of}; align the tables")


def _check_distinct(runs: Runs, least: int) -> None:
    """Raise InputError for fewer different inputs than there are folds, which keep equal ones together."""
    n, states = len(runs), runs.states
    places = None if states is None else np.column_stack([states.chain, states.draw])
    for name, inputs, part in (("theta", runs.theta, slice(n)), ("theta_more", runs.theta_more, slice(n, None))):
        distinct = len(np.unique(inputs, axis=0))
        if places is not None:
            distinct = min(distinct, len(np.unique(places[part], axis=0)))
        if distinct < least:
            remedy = f"different inputs among {len(inputs)}; at least {least} are needed"
            raise InputError("estimate", name, distinct, remedy)


def _states(chains: Any, n: int, ran: np.ndarray) -> States | None:
    """Return the states of the pilot and of the propagation samples that `ran` (m,)."""
    if chains is None:
        return None
    if not isinstance(chains, tuple | list) or len(chains) != 2:
        raise InputError("estimate", "chains", None, "expected two arrays: numbers of chains and of draws")
    kept = np.concatenate([np.ones(n, dtype=bool), ran])
    found = []
    for name, numbers in zip(("chain", "draw"), chains, strict=True):
        values = np.asarray(numbers, dtype=float)
        if values.shape != kept.shape:
            remedy = f"expected {len(kept)} numbers: of the {n} rows of theta, then of the {len(ran)} of theta_more"
            raise InputError("estimate", f"chains, {name}", values.shape, remedy)
        wrong = np.flatnonzero(~(np.isfinite(values) & (values == np.round(values))))
        if len(wrong):
            raise InputError("estimate", f"chains, {name} {wrong[0]}", float(values[wrong[0]]), "not a whole number")
        found.append(values[kept])
    return States(*found)


def _pairs(outputs: list[str], q: pd.DataFrame) -> list[Row]:
    """Return a row for each of the outputs, with the 0D output of its name or position, else the first that moves."""
    cheap, moves = list(q), np.ptp(q.to_numpy(float), axis=0) > 0
    first = cheap[int(moves.argmax())]
    at = dict(zip(outputs, cheap, strict=True)) if len(outputs) == len(cheap) else dict.fromkeys(outputs, first)
    return [Row(name, name, name if name in cheap else at[name], name) for name in outputs]
