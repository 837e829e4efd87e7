"""Benchmark `scale`: CPU time and memory of a table without networks for many propagation samples."""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.analysis.estimate_rows import analyse
from coronaryuq.estimation.estimators.design import make_design
from coronaryuq.estimation.estimators.folds import count
from coronaryuq.estimation.runs.table import Runs, read_rows, read_runs
from coronaryuq.estimation.settings import Settings

SEED = 20241117
SAMPLES, QUICK_SAMPLES = 1_000_000, 20_000
PILOT = ("params.csv", "outputs_3d.csv", "outputs_0d.csv", "param_limits.json")
COST = ("cpu_s", "cpu_s_parts", "peak_rss_mb", "wall_s")
MEASURED = "from coronaryuq.bench.estimation.scale import measure; measure(*__import__('sys').argv[1:])"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--data", metavar="FOLDER", help="folder of the published runs (required)")
    parser.add_argument("--rows", metavar="FILE", help="columns row, column_3d, column_0d (default: FOLDER/table1.csv)")
    parser.add_argument("--samples", type=int, metavar="N", help=f"propagation samples (default: {SAMPLES:,})")


def run(quick: bool = False, data: str | None = None, rows: str | None = None, samples: int | None = None) -> dict:
    """Estimate all rows with `samples` propagation samples in a process of its own, and return what that used.

    The samples follow a smooth law like the pilot's (`samples_like`) and are read from a file. `cpu_s` and
    `peak_rss_mb` are those of means and intervals (MC, MFMC, BLUE with a coarse level, crossfit-GP). Those under
    `beyond_the_mean` are of a second process that also estimates quantiles, zones of FFR, variance, Sobol indices and
    Shapley effects. `quick` uses 20,000 samples and the first row.
    """
    if data is None:
        raise InputError("bench scale", "--data", None, "name the folder of published runs")
    folder = Path(data).absolute()
    wanted = samples or (QUICK_SAMPLES if quick else SAMPLES)
    with tempfile.TemporaryDirectory() as scratch:
        for name in PILOT:
            if (folder / name).exists():
                shutil.copyfile(folder / name, Path(scratch, name))
        write_csv(Path(scratch, "params_propagation.csv"), samples_like(read_runs(folder), wanted))
        command = [sys.executable, "-c", MEASURED, scratch, str(rows or folder / "table1.csv"), "1" if quick else "0"]
        means, everything = (_measured([*command, beyond]) for beyond in ("0", "1"))
    return {"n_0d": wanted} | means | {"beyond_the_mean": {name: everything[name] for name in COST}}


def _measured(command: list[str]) -> dict:
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, encoding="utf-8")
    return json.loads(done.stdout.splitlines()[-1])


def samples_like(runs: Runs, number: int) -> pd.DataFrame:
    """Draw samples (number rows) from a normal law of the inputs' coordinates with the pilot's moments.

    An input with limits that the estimators may integrate over is uniform between these.
    """
    x, random = runs.coordinates(runs.theta), generator(SEED, "bench", "scale")
    drawn = random.multivariate_normal(x.mean(axis=0), np.cov(x, rowvar=False), size=number, method="eigh")
    theta = runs.from_coordinates(drawn)
    scaling = Settings().known_scaling
    if scaling in runs.inputs and runs.limits is not None:
        theta[:, runs.inputs.index(scaling)] = random.uniform(*runs.bounds(scaling), size=number)
    table = pd.DataFrame(theta, columns=list(runs.inputs))
    table.insert(0, "sample", [f"propagation_{k:07d}" for k in range(number)])
    return table


def measure(folder: str, rows_csv: str, first: str, beyond_mean: str) -> None:
    """Estimate the rows from the runs in a folder, and print CPU time by part and peak memory as JSON.

    first: "1" for the first row alone; beyond_mean: "1" for what is beyond the mean, too.
    """
    settings, clock, wall = Settings(autoencoder=False), [0.0, time.process_time()], time.perf_counter()
    runs, rows = read_runs(folder), read_rows(rows_csv)[: 1 if first == "1" else None]
    clock.append(time.process_time())
    design = make_design(runs, rows, count(len(runs), settings.folds), SEED, settings.known_scaling)
    clock.append(time.process_time())
    found = analyse(runs, rows, settings, SEED, design=design, beyond_mean=beyond_mean == "1")
    clock.append(time.process_time())
    lines = [
        {
            "row": row.row, "recommended": row.recommended, "mean": row.recommended_report.mean,
            "std": {name: report.std for name, report in row.estimators.items()},
            "predictions": row.estimators["crossfit-GP"].predictions,
        }
        for row in found
    ]  # fmt: skip
    parts = dict(zip(("imports", "reading", "emulators", "estimates"), np.diff(clock).tolist(), strict=True))
    cost = {"cpu_s": clock[-1], "cpu_s_parts": parts, "peak_rss_mb": _peak_mb(), "wall_s": time.perf_counter() - wall}
    print(json.dumps({"n_3d": len(runs), "rows": lines} | cost))


def _peak_mb() -> float:
    """Return the peak memory of this process; that of `getrusage` would begin with its parent's."""
    for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
        if line.startswith("VmHWM"):
            return round(int(line.split()[1]) / 1024, 1)
    return float("nan")
