"""Gathers a campaign's runs into the published-runs format, a folder that the estimators and anybody else can read."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.case_json import read_case
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import read_csv, read_parquet, write_csv

BOOKKEEPING = ("status", "reason", "cpu_s", "cycles", "cycle_error", "refinement")
"""Columns of 0D runs that are no outputs."""

ROWS = (
    ("osi_flow", "max OSI", "mean flow", "osi_max_{}", "mean_flow:{outlet}"),
    ("tawss_flow", "min TAWSS", "mean flow", "tawss_min_{}", "mean_flow:{outlet}"),
    ("ffr_ffr", "FFR", "FFR", "ffr_{}", "ffr_{}"),
    ("ffr_flow", "FFR", "mean flow", "ffr_{}", "mean_flow:{outlet}"),
)
"""The paper's table: name, 3D and 0D quantity, and their columns for one branch (Table 1)."""


def gather(
    case_json: str | Path,
    pilot_csv: str | Path,
    propagation_csv: str | Path,
    flow3d: Sequence[str | Path],
    zerod_pilot: Sequence[str | Path],
    zerod_propagation: Sequence[str | Path],
    limits: dict[str, tuple[float, float]],
    min_3d: int,
    out: str | Path,
    counts: dict[str, int] | None = None,
    coarse: Sequence[str | Path] = (),
    runs_per_fine: int = 0,
) -> None:
    """Write `params.csv`, `outputs_3d.csv`, `outputs_0d.csv`, `params_propagation.csv`, `outputs_0d_propagation.csv`,
    `param_limits.json`, `rows.csv` and `failures.json` into `out`, for a coarse 3D level `params_coarse.csv`,
    `outputs_3d_coarse.csv` and `outputs_0d_coarse.csv` too.

    A pilot sample whose 3D run failed stays in `params.csv` without outputs, so that the estimators can ask whether
    failures depend on θ. A sample whose 0D run failed is left out. Raises InputError if fewer than `min_3d` 3D runs
    ended well, with the commonest reason. limits: bounds of θ by column, "r" standing for every bed. counts: {n_3d,
    n_0d}, how many of the first samples count; all where it is None. coarse: records of a coarse 3D level, which ran
    the first `runs_per_fine` · n_3d samples of the pilot's table: those beyond the pilot go into `params_coarse.csv`.
    """
    out = Path(out)
    pilot, beyond, propagation = _portions(pilot_csv, propagation_csv, counts, runs_per_fine)
    runs = _records("3D", flow3d, pilot)
    cheap = _zerod(zerod_pilot, pilot)
    beside = _zerod(zerod_pilot, beyond)
    more = _zerod(zerod_propagation, propagation)
    _enough(flow3d[0], runs, min_3d)
    kept = pilot[pilot["sample"].isin(cheap.ended["sample"])]
    outputs_3d = _ended(runs)
    write_csv(out / "params.csv", kept)
    write_csv(out / "outputs_3d.csv", outputs_3d[outputs_3d["sample"].isin(kept["sample"])])
    write_csv(out / "outputs_0d.csv", cheap.ended)
    write_csv(out / "params_propagation.csv", propagation[propagation["sample"].isin(more.ended["sample"])])
    write_csv(out / "outputs_0d_propagation.csv", more.ended)
    second = _coarse(coarse, pd.concat([pilot, beyond])) if runs_per_fine else []
    _write_coarse(out, second, outputs_3d.columns, kept, beyond, beside.ended)
    columns = [name for name in pilot.columns if name != "sample"]
    bounds = {name: limits.get(name, limits["r"]) for name in columns}
    ends = (("min", 0), ("max", 1))
    write_json(out / "param_limits.json", {end: {name: bounds[name][k] for name in columns} for end, k in ends})
    write_csv(out / "rows.csv", rows(read_case(case_json, "stenoses.name", "stenoses.outlet"), cheap.ended.columns))
    write_json(out / "failures.json", _failures(runs, (cheap, beside, more), second))


@dataclass(frozen=True)
class _Cheap:
    """0D runs of one set: how many were wanted, outputs of those that ended well, the failed ones, their CPU time."""

    wanted: int
    ended: pd.DataFrame
    failed: pd.DataFrame
    cpu_s: float


def _portions(
    pilot_csv: str | Path, propagation_csv: str | Path, counts: dict[str, int] | None, runs_per_fine: int
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Inputs of the pilot, of the coarse level's samples beyond it, and of propagation."""
    table, propagation = read_csv(pilot_csv, ("sample",)), read_csv(propagation_csv, ("sample",))
    n_3d = len(table) // max(1, runs_per_fine)
    if counts is not None:
        n_3d, propagation = counts["n_3d"], propagation.iloc[: counts["n_0d"]]
    return table.iloc[:n_3d], table.iloc[n_3d : max(1, runs_per_fine) * n_3d], propagation


def _enough(path: str | Path, runs: list[records.Record], least: int) -> None:
    failed = [record for record in runs if not record.ok]
    if len(runs) - len(failed) < least:
        reasons = pd.Series([record.reason for record in failed])
        most = reasons.value_counts().index[0] if len(reasons) else "too few samples asked for"
        said = f"{len(runs) - len(failed)} of {len(runs)}"
        raise InputError(path, "3D runs that ended well", said, f"at least {least} are needed; most often: {most}")


def _ended(runs: list[records.Record], columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Outputs of the runs that ended well, one row each."""
    return pd.DataFrame([{"sample": r.sample, **r.outputs} for r in runs if r.ok], columns=columns)


def _write_coarse(
    out: Path,
    second: list[records.Record],
    columns: Sequence[str],
    kept: pd.DataFrame,
    beyond: pd.DataFrame,
    beside: pd.DataFrame,
) -> None:
    """Files of a coarse level; without one, those of an earlier run with one are removed."""
    if not second:
        for name in ("params_coarse.csv", "outputs_0d_coarse.csv", "outputs_3d_coarse.csv"):
            (out / name).unlink(missing_ok=True)
        return
    ended = _ended(second, columns)
    paired = ended["sample"].isin(kept["sample"]) | ended["sample"].isin(beside["sample"])
    write_csv(out / "params_coarse.csv", beyond[beyond["sample"].isin(beside["sample"])])
    write_csv(out / "outputs_0d_coarse.csv", beside)
    write_csv(out / "outputs_3d_coarse.csv", ended[paired])


def _failures(runs: list[records.Record], zerod: tuple[_Cheap, _Cheap, _Cheap], second: list[records.Record]) -> dict:
    """What `failures.json` holds: runs, the failed ones and cost of the 3D level, the 0D model and the coarse level."""
    pilot, beside, propagation = zerod
    failed = pd.concat([one.failed for one in zerod])[["sample", "reason"]]
    return {
        "flow3d": {"runs": len(runs), "failed": _told(runs)},
        "zerod": {"runs": sum(one.wanted for one in zerod), "failed": failed.to_dict("records")},
        "coarse": {"runs": len(second), "failed": _told(second)},
        "cost": {
            "flow3d_cpu_s": float(sum(r.cost.get("cpu_s", 0.0) for r in runs)),
            "zerod_cpu_s": pilot.cpu_s + beside.cpu_s + propagation.cpu_s,
            "coarse_cpu_s": float(sum(r.cost.get("cpu_s", 0.0) for r in second)),
        },
    }


def _told(runs: list[records.Record]) -> list[dict]:
    return [{"sample": r.sample, "reason": r.reason, "inputs": r.inputs} for r in runs if not r.ok]


def rows(case: dict, columns_0d: Sequence[str]) -> pd.DataFrame:
    """The paper's table for this case: one row per quantity and stenosis, in its order."""
    lines = []
    for name, qoi_3d, qoi_0d, column_3d, column_0d in ROWS:
        for stenosis in case["stenoses"]:
            branch = stenosis["name"].lower()
            outlet = next((c.split(":", 1)[1] for c in columns_0d if c.endswith(f":{stenosis['outlet']}")), None)
            lines.append(
                {
                    "row": f"{name}_{branch}",
                    "qoi_3d": qoi_3d,
                    "qoi_0d": qoi_0d,
                    "branch": stenosis["name"],
                    "column_3d": column_3d.format(branch),
                    "column_0d": column_0d.format(branch, outlet=outlet),
                }
            )
    return pd.DataFrame(lines)


def measured_cost_ratio(failures_json: str | Path) -> float | None:
    """Cost of a 0D run in 3D runs from `failures.json`; None where the runs do not tell."""
    held = read_json(failures_json)
    high = held["cost"]["flow3d_cpu_s"] / max(held["flow3d"]["runs"], 1)
    low = held["cost"]["zerod_cpu_s"] / max(held["zerod"]["runs"], 1)
    return low / high if high > 0 and 0 < low < high else None


def coarse_cost(failures_json: str | Path) -> dict | None:
    """{runs, failed, coarse_cpu_s, fine_cpu_s}, costs per run, of a coarse level; None without one or where they do not
    tell.
    """
    held = read_json(failures_json)
    coarse, fine, cost = held.get("coarse", {"runs": 0}), held["flow3d"], held["cost"]
    if not coarse["runs"] or not fine["runs"] or not min(cost["flow3d_cpu_s"], cost["coarse_cpu_s"]) > 0:
        return None
    return {
        "runs": coarse["runs"],
        "failed": len(coarse["failed"]),
        "coarse_cpu_s": cost["coarse_cpu_s"] / coarse["runs"],
        "fine_cpu_s": cost["flow3d_cpu_s"] / fine["runs"],
    }


def _coarse(paths: Sequence[str | Path], table: pd.DataFrame) -> list[records.Record]:
    """Records of a coarse level at every sample of a table, in its order."""
    place = {sample: k for k, sample in enumerate(table["sample"])}
    return sorted(_records("coarse 3D", paths, table), key=lambda record: place[record.sample])


def _records(kind: str, paths: Sequence[str | Path], table: pd.DataFrame) -> list[records.Record]:
    """Records of every sample of a table, in the order of the files."""
    wanted = set(table["sample"])
    found = [record for path in paths for record in records.read(path) if record.sample in wanted]
    _complete(kind, table["sample"], [record.sample for record in found], paths)
    return found


def _zerod(paths: Sequence[str | Path], inputs: pd.DataFrame) -> _Cheap:
    samples = inputs["sample"]
    table = pd.concat([read_parquet(path, ("sample", "status", "reason")) for path in paths], ignore_index=True)
    table = table[table["sample"].isin(samples)]
    ok = table["status"] == records.OK
    ended, failed = table[ok].drop(columns=[c for c in BOOKKEEPING if c in table]), table[~ok]
    _complete("0D", samples, [*ended["sample"], *failed["sample"]], paths)
    return _Cheap(len(inputs), ended, failed, _cost(paths, samples))


def _cost(paths: Sequence[str | Path], samples: Sequence[str]) -> float:
    tables = (read_parquet(path, ("sample", "cpu_s")) for path in paths)
    return float(np.sum([t.loc[t["sample"].isin(samples), "cpu_s"].sum() for t in tables]))


def _complete(kind: str, wanted: pd.Series, found: list[str], paths: Sequence[str | Path]) -> None:
    missing = sorted(set(wanted) - set(found))
    if missing or len(found) != len(set(found)):
        what = missing[0] if missing else "a sample"
        remedy = f"has no {kind} run; delete the files of this set and run again" if missing else "has two runs"
        raise InputError(Path(paths[0]).parent, "sample", what, remedy)
