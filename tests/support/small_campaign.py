"""A small campaign's files: a pilot, a propagation sample, their 3D and 0D runs, with some of them failed."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.core.records import Record, write
from coronaryuq.estimation.runs.gather import RunFiles
from support.case_files import write_case_json

STENOSES = ({"name": "LAD", "outlet": "BC_lca1"}, {"name": "RCA", "outlet": "BC_rca1"})
LIMITS = {"r": (0.5, 2.0), "R_cor_scaling": (0.7, 1.25)}
PILOT, PROPAGATION = 12, 20


def theta(name: str, count: int) -> pd.DataFrame:
    random = np.random.default_rng(len(name))
    columns = {bed: random.uniform(0.5, 2, count) for bed in ("BC_lca1", "BC_rca1")}
    samples = [f"{name}_{k:05d}" for k in range(count)]
    return pd.DataFrame({"sample": samples, **columns, "R_cor_scaling": random.uniform(0.7, 1.25, count)})


def zerod(table: pd.DataFrame, failed=(), cpu_s: float = 0.5) -> pd.DataFrame:
    frame = pd.DataFrame({"sample": table["sample"], "status": "ok", "reason": "", "cpu_s": cpu_s})
    for column in ("mean_flow:lca1:BC_lca1", "mean_flow:rca1:BC_rca1", "ffr_lad", "ffr_rca"):
        frame[column] = 1 / table["R_cor_scaling"]
    frame.loc[frame["sample"].isin(failed), ["status", "reason"]] = "failed", "no convergence"
    return frame


PAPERS = ("ffr", "osi_max", "tawss_min")
AVERAGES = ("tawss_patch_min", "low_shear_area", "osi_patch_max")


def record(row: pd.Series, failed, quantities=PAPERS) -> Record:
    inputs = {name: float(row[name]) for name in ("BC_lca1", "BC_rca1", "R_cor_scaling")}
    if row["sample"] in failed:
        return Record.failed(row["sample"], inputs, "blew up", cost={"cpu_s": 2.0})
    names = [f"{q}_{b}" for q in quantities for b in ("lad", "rca")]
    return Record(row["sample"], inputs, dict.fromkeys(names, inputs["BC_lca1"]), cost={"cpu_s": 2.0})


def write_campaign(
    folder: Path, failed_3d=(), failed_0d=(), lost=(), runs_per_fine: int = 0, failed_coarse=(), quantities=PAPERS
) -> RunFiles:
    """Write the files, with the named samples failed, and those in `lost` without a 3D run."""
    table, propagation = theta("pilot", PILOT * max(1, runs_per_fine)), theta("propagation", PROPAGATION)
    outlets = [{"name": name, "bc": f"BC_{name}", "vessel": name} for name in ("lca1", "rca1")]
    write_case_json(folder / "case.json", stenoses=STENOSES, outlets=outlets)
    write_csv(folder / "pilot.csv", table)
    write_csv(folder / "propagation.csv", propagation)
    batches = []
    for first in range(0, PILOT, 4):
        rows = [row for _, row in table.iloc[first : first + 4].iterrows() if row["sample"] not in lost]
        batches.append(folder / f"batch_{first // 4}.jsonl")
        write(batches[-1], [record(row, failed_3d, quantities) for row in rows])
    coarse = [folder / "coarse_0.jsonl"] if runs_per_fine else []
    for path in coarse:
        write(path, [record(row, failed_coarse) for _, row in table.iloc[::-1].iterrows()])
    write_zerod(folder, failed_0d)
    return RunFiles(
        folder / "case.json", folder / "pilot.csv", folder / "propagation.csv", batches,
        [folder / "pilot_0.parquet"], [folder / "propagation_0.parquet"], coarse, runs_per_fine,
    )  # fmt: skip


def write_zerod(folder: Path, failed=(), cpu_s: float = 0.5) -> None:
    for name in ("pilot", "propagation"):
        zerod(read_csv(folder / f"{name}.csv"), failed, cpu_s).to_parquet(folder / f"{name}_0.parquet")
