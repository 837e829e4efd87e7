"""Gather a campaign's runs into the published-runs format, a folder that the estimators and anybody else can read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd

from coronaryuq.case.case_json import Branch, CaseSummary, read_case
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import read_csv, read_parquet, write_csv
from coronaryuq.estimation.results import Counts

BOOKKEEPING = ("status", "reason", "cpu_s", "cycles", "cycle_error", "refinement")
"""Columns of 0D runs that are not outputs."""

COARSE_FILES = ("params_coarse.csv", "outputs_0d_coarse.csv", "outputs_3d_coarse.csv")


@dataclass(frozen=True)
class Quantity:
    """A kind of row: what is estimated at every stenosis.

    Parameters
    ----------
    row
        Name of its rows, without the branch.
    qoi_3d, qoi_0d
        3D and 0D quantity, for the label.
    column_3d, column_0d
        Their columns; {} stands for the branch, {outlet} for its outlet.
    networks
        Whether MFMC-AE is trained for it.
    optional
        Leave the row out where the runs do not have its columns.
    warning
        What a reader has to know about the quantity itself.
    shared
        Whether control variates of other rows see its 0D output.
    of_artery
        Whether it is one of each artery, and not of each stenosis.
    """

    row: str
    qoi_3d: str
    qoi_0d: str
    column_3d: str
    column_0d: str
    networks: bool = True
    optional: bool = False
    warning: str = ""
    shared: bool = True
    of_artery: bool = False

    def of(self, branch: str, outlet: str, columns_0d: Sequence[str]) -> dict[str, str]:
        """Return the row of one branch, a line of `rows.csv`; outlet: boundary condition of its flow."""
        place = next((name.split(":", 1)[1] for name in columns_0d if name.endswith(f":{outlet}")), None)
        return {
            "row": f"{self.row}_{branch.lower()}", "qoi_3d": self.qoi_3d, "qoi_0d": self.qoi_0d, "branch": branch,
            "column_3d": self.column_3d.format(branch.lower()),
            "column_0d": self.column_0d.format(branch.lower(), outlet=place),
            "networks": "yes" if self.networks else "no", "shared": "yes" if self.shared else "no",
            "warning": self.warning,
        }  # fmt: skip


FLOW = ("mean flow", "mean_flow:{outlet}")
EXTREME = "extreme: {} has settled on no mesh tried (shown for comparison with the paper; prefer {})"


def _average(row: str, qoi_3d: str, column_3d: str) -> Quantity:
    """Return a quantity that the paper does not have, so that its networks would have nothing to be compared with."""
    return Quantity(row, qoi_3d, FLOW[0], column_3d, FLOW[1], networks=False, optional=True)


def _pressure(name: str, words: str, of_artery: bool = False) -> Quantity:
    """Return a quantity that is read off the same pressures in 3D and 0D.

    What its 0D output says of other rows, FFR and mean flows say already.
    """
    columns = f"{name}_{{}}", f"{name}_{{}}"
    return Quantity(
        name, words, words, *columns, networks=False, optional=True, shared=False, of_artery=of_artery
    )  # fmt: skip


QUANTITIES = (
    Quantity("ffr_ffr", "FFR", "FFR", "ffr_{}", "ffr_{}"),
    Quantity("ffr_flow", "FFR", FLOW[0], "ffr_{}", FLOW[1]),
    _pressure("lowest_ffr", "lowest FFR", of_artery=True),
    _pressure("pressure_drop", "pressure drop"),
    _average("tawss_patch_flow", "patch-min TAWSS", "tawss_patch_min_{}"),
    _average("low_shear_flow", "low-shear area", "low_shear_area_{}"),
    _average("osi_patch_flow", "patch-max OSI", "osi_patch_max_{}"),
    Quantity("osi_flow", "max OSI", FLOW[0], "osi_max_{}", FLOW[1], warning=EXTREME.format("max OSI", "patch-max OSI")),
    Quantity(
        "tawss_flow",
        "min TAWSS",
        FLOW[0],
        "tawss_min_{}",
        FLOW[1],
        warning=EXTREME.format("min TAWSS", "patch-min TAWSS"),
    ),
)
"""FFR, pressures and averages over a part of the wall, then extremes; those with networks are the paper's (Table 1)."""


@dataclass(frozen=True)
class RunFiles:
    """Files of one campaign from which its runs are gathered.

    Parameters
    ----------
    case
        `case.json`.
    pilot, propagation
        Tables of θ (CSV).
    records
        Records of the 3D runs, one file per batch.
    zerod_pilot, zerod_propagation
        Outputs of the 0D runs at both tables (Parquet), one file per chunk.
    coarse
        Records of a coarse 3D level, if there is one.
    runs_per_fine
        Coarse 3D runs per fine one; the coarse level runs the first `runs_per_fine` · n_3d samples of `pilot`.
        0 without a coarse level.
    """

    case: str | Path
    pilot: str | Path
    propagation: str | Path
    records: Sequence[str | Path]
    zerod_pilot: Sequence[str | Path]
    zerod_propagation: Sequence[str | Path]
    coarse: Sequence[str | Path] = ()
    runs_per_fine: int = 0

    @classmethod
    def of(cls, paths: Mapping[str, Any], runs_per_fine: int) -> "RunFiles":
        """Take the fields from a job's inputs, which have the same names."""
        names = [field.name for field in fields(cls) if field.name != "runs_per_fine"]
        return cls(**{name: paths[name] for name in names}, runs_per_fine=runs_per_fine)


def gather(
    inputs: RunFiles,
    limits: dict[str, tuple[float, float]],
    min_3d: int,
    out: str | Path,
    counts: Counts | None = None,
) -> None:
    """Write a campaign's runs in the published-runs format (docs/reference/formats.md) into the folder `out`.

    A pilot sample whose 3D run failed stays in `params.csv` without outputs, so that the estimators can ask whether
    failures depend on θ. A sample whose 0D run failed is left out.

    Parameters
    ----------
    inputs
        Files of the campaign.
    limits
        Bounds of θ by column; "r" stands for every bed. Of a column without any, bounds that hold all samples are
        written.
    min_3d
        Fewest 3D runs that have to have succeeded.
    out
        Folder to write to.
    counts
        How many of the first samples to take; all of them if None.

    Raises
    ------
    InputError
        If fewer than `min_3d` 3D runs succeeded (with the most frequent reason), or if a sample has no run, or two.
    """
    out = Path(out)
    pilot, beyond, propagation = _tables(inputs, counts)
    fine = _records("3D", inputs.records, pilot)
    zerod = _zerod(inputs.zerod_pilot, pilot)
    zerod_beyond = _zerod(inputs.zerod_pilot, beyond)
    zerod_more = _zerod(inputs.zerod_propagation, propagation)
    _check_number(inputs.records[0], fine, min_3d)
    kept = pilot[pilot["sample"].isin(zerod.outputs["sample"])]
    outputs_3d = _outputs(fine)
    write_csv(out / "params.csv", kept)
    write_csv(out / "outputs_3d.csv", outputs_3d[outputs_3d["sample"].isin(kept["sample"])])
    write_csv(out / "outputs_0d.csv", zerod.outputs)
    write_csv(out / "params_propagation.csv", propagation[propagation["sample"].isin(zerod_more.outputs["sample"])])
    write_csv(out / "outputs_0d_propagation.csv", zerod_more.outputs)
    coarse = _coarse(inputs.coarse, pd.concat([pilot, beyond])) if inputs.runs_per_fine else []
    if coarse:
        both = [*kept["sample"], *zerod_beyond.outputs["sample"]]
        outputs_coarse = _outputs(coarse, outputs_3d.columns)
        write_csv(out / "params_coarse.csv", beyond[beyond["sample"].isin(zerod_beyond.outputs["sample"])])
        write_csv(out / "outputs_0d_coarse.csv", zerod_beyond.outputs)
        write_csv(out / "outputs_3d_coarse.csv", outputs_coarse[outputs_coarse["sample"].isin(both)])
    else:
        for name in COARSE_FILES:  # of an earlier campaign that had a coarse level
            (out / name).unlink(missing_ok=True)
    columns = [name for name in pilot.columns if name not in ("sample", *records.STATE)]
    beds = {outlet.bc for outlet in read_case(inputs.case).outlets}
    bounds = {name: limits["r"] for name in columns if name in beds and "r" in limits} | limits
    bounds |= {name: _range(pilot[name], propagation[name]) for name in columns if name not in bounds}
    ends = (("min", 0), ("max", 1))
    write_json(out / "param_limits.json", {end: {name: bounds[name][k] for name in columns} for end, k in ends})
    write_csv(out / "rows.csv", rows(read_case(inputs.case), list(outputs_3d), list(zerod.outputs)))
    write_json(out / "failures.json", _failures(fine, (zerod, zerod_beyond, zerod_more), coarse))


def _range(*samples: pd.Series) -> tuple[float, float]:
    """Return bounds that hold all samples of an unbounded input, with a tenth of their range on each side."""
    values = np.concatenate([part.to_numpy(dtype=float) for part in samples])
    low, high = float(values.min()), float(values.max())
    margin = 0.1 * (high - low) or 0.1 * max(abs(low), 1.0)
    return low - margin, high + margin


@dataclass(frozen=True)
class _ZeroDRuns:
    """0D runs of one set: how many were wanted, outputs of those that succeeded, the failed ones, their CPU time."""

    wanted: int
    outputs: pd.DataFrame
    failed: pd.DataFrame
    cpu_s: float


def _tables(inputs: RunFiles, counts: Counts | None) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Read the inputs of the pilot, of the coarse level's samples beyond it, and of propagation."""
    table, propagation = read_csv(inputs.pilot, ("sample",)), read_csv(inputs.propagation, ("sample",))
    per_fine = max(1, inputs.runs_per_fine)
    n_3d = len(table) // per_fine
    if counts is not None:
        n_3d, propagation = counts.n_3d, propagation.iloc[: counts.n_0d]
    return table.iloc[:n_3d], table.iloc[n_3d : per_fine * n_3d], propagation


def _check_number(path: str | Path, runs: list[records.Record], least: int) -> None:
    failed = [record for record in runs if not record.ok]
    if len(runs) - len(failed) < least:
        reasons = pd.Series([record.reason for record in failed])
        most = reasons.value_counts().index[0] if len(reasons) else "too few samples requested"
        found = f"{len(runs) - len(failed)} of {len(runs)}"
        raise InputError(
            path, "successful 3D runs", found, f"at least {least} are needed; most frequent reason: {most}"
        )


def _outputs(runs: list[records.Record], columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Return the outputs of the runs that succeeded, one row each."""
    return pd.DataFrame([{"sample": r.sample, **r.outputs} for r in runs if r.ok], columns=columns)


def _failures(fine: list[records.Record], zerod: Sequence[_ZeroDRuns], coarse: list[records.Record]) -> dict[str, Any]:
    """Contents of `failures.json`: runs, failed ones and cost of the 3D level, the 0D model and the coarse level."""
    failed = pd.concat([runs.failed for runs in zerod])[["sample", "reason"]]
    pilot, beyond, propagation = (runs.cpu_s for runs in zerod)
    return {
        "flow3d": {"runs": len(fine), "failed": _failed(fine)},
        "zerod": {"runs": sum(runs.wanted for runs in zerod), "failed": failed.to_dict("records")},
        "coarse": {"runs": len(coarse), "failed": _failed(coarse)},
        "cost": {
            "flow3d_cpu_s": float(sum(r.cost.get("cpu_s", 0.0) for r in fine)),
            "zerod_cpu_s": pilot + beyond + propagation,
            "coarse_cpu_s": float(sum(r.cost.get("cpu_s", 0.0) for r in coarse)),
        },
    }


def _failed(runs: list[records.Record]) -> list[dict[str, Any]]:
    return [{"sample": r.sample, "reason": r.reason, "inputs": r.inputs} for r in runs if not r.ok]


def rows(case: CaseSummary, columns_3d: Sequence[str], columns_0d: Sequence[str]) -> pd.DataFrame:
    """Return the rows to estimate for this case: one per quantity and stenosis or artery, extremes last."""
    stenoses = {stenosis.name: stenosis.outlet for stenosis in case.stenoses}
    arteries = dict.fromkeys(get_args(Branch), "")
    found = [
        (quantity, quantity.of(name, outlet, columns_0d))
        for quantity in QUANTITIES
        for name, outlet in (arteries if quantity.of_artery else stenoses).items()
    ]
    return pd.DataFrame(
        [
            row
            for quantity, row in found
            if not quantity.optional or (row["column_3d"] in columns_3d and row["column_0d"] in columns_0d)
        ]
    )


def measured_cost_ratio(failures_json: str | Path) -> float | None:
    """Return the cost of a 0D run in 3D runs from `failures.json`; None if it cannot be told from the runs."""
    failures = read_json(failures_json)
    high = failures["cost"]["flow3d_cpu_s"] / max(failures["flow3d"]["runs"], 1)
    low = failures["cost"]["zerod_cpu_s"] / max(failures["zerod"]["runs"], 1)
    return low / high if high > 0 and 0 < low < high else None


@dataclass(frozen=True)
class CoarseCost:
    """Runs of a coarse 3D level, the failed ones among them, and CPU seconds per coarse and per fine run."""

    runs: int
    failed: int
    coarse_cpu_s: float
    fine_cpu_s: float


def coarse_cost(failures_json: str | Path) -> CoarseCost | None:
    """Read the cost of a coarse level from `failures.json`; None without one or if its cost is not known."""
    failures = read_json(failures_json)
    coarse, fine, cost = failures.get("coarse", {"runs": 0}), failures["flow3d"], failures["cost"]
    if not coarse["runs"] or not fine["runs"] or not min(cost["flow3d_cpu_s"], cost["coarse_cpu_s"]) > 0:
        return None
    per_coarse, per_fine = cost["coarse_cpu_s"] / coarse["runs"], cost["flow3d_cpu_s"] / fine["runs"]
    return CoarseCost(coarse["runs"], len(coarse["failed"]), per_coarse, per_fine)


def _coarse(paths: Sequence[str | Path], table: pd.DataFrame) -> list[records.Record]:
    """Read the coarse level's records of every sample of a table, in its order."""
    place = {sample: k for k, sample in enumerate(table["sample"])}
    return sorted(_records("coarse 3D", paths, table), key=lambda record: place[record.sample])


def _records(kind: str, paths: Sequence[str | Path], table: pd.DataFrame) -> list[records.Record]:
    """Read the records of every sample of a table, in the order of the files."""
    wanted = set(table["sample"])
    runs = [record for path in paths for record in records.read(path) if record.sample in wanted]
    _check_complete(kind, table["sample"], [record.sample for record in runs], paths)
    return runs


def _zerod(paths: Sequence[str | Path], inputs: pd.DataFrame) -> _ZeroDRuns:
    samples = inputs["sample"]
    table = pd.concat([read_parquet(path, ("sample", "status", "reason")) for path in paths], ignore_index=True)
    table = table[table["sample"].isin(samples)]
    ok = table["status"] == records.OK
    outputs, failed = table[ok].drop(columns=[c for c in BOOKKEEPING if c in table]), table[~ok]
    _check_complete("0D", samples, [*outputs["sample"], *failed["sample"]], paths)
    return _ZeroDRuns(len(inputs), outputs, failed, _cpu_seconds(paths, samples))


def _cpu_seconds(paths: Sequence[str | Path], samples: pd.Series) -> float:
    tables = (read_parquet(path, ("sample", "cpu_s")) for path in paths)
    return float(np.sum([t.loc[t["sample"].isin(samples), "cpu_s"].sum() for t in tables]))


def _check_complete(kind: str, wanted: pd.Series, found: list[str], paths: Sequence[str | Path]) -> None:
    missing = sorted(set(wanted) - set(found))
    if missing or len(found) != len(set(found)):
        sample = missing[0] if missing else "a sample"
        remedy = f"has no {kind} run; delete the files of this set and run again" if missing else "has two runs"
        raise InputError(Path(paths[0]).parent, "sample", sample, remedy)
