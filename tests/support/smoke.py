"""The smoke campaign, as a user runs it, and what must be the same whenever and wherever it runs."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / "workflow"

OTHER_PORTIONS = "samples: {batch_3d: 5, chunk_0d: 70, chunks_resampled: 3, chunk_realisations: 70}\n"
"""As an additional configuration: the same samples, cut into other jobs."""

SMALLER = """
samples: {n_3d: 20, n_0d: 100, chunk_0d: 50, chunks_resampled: 2, chunk_realisations: 30}
perfusion: {realisations: 60}
calibration: {candidates: 4, starts: 1, rounds: 1, evaluations_per_parameter: 2, final_nelder_mead: 0}
posterior: {dream: {generations: 500}, independence: {draws: 40}, rhat_limit: 9.0, ess_limit: 1}
estimation: {steps: [30, 20], curve_nodes: 9, folds: 2}
"""
"""As an additional configuration: every stage still, with less to do in it."""

MEASURED = ("budget.png", "budget.svg")
"""Figures that tell what runs have cost here, which is measured anew every time."""
COSTS = {*MEASURED, "budget.json", "failures.json", "report.html", ".lock"}
"""Files that hold measured costs."""
APART = {"logs", "costs", "provenance", "chains", "checkpoints"}


def command(folder: Path, *arguments: str, profile: Path | None = None, more: tuple[str, ...] = ()) -> list[str]:
    """Snakemake on `config/smoke.yaml` in a folder. more: texts of configurations that change some of it."""
    changes = [folder / f"changes_{number}.yaml" for number in range(len(more))]
    for path, text in zip(changes, more, strict=True):
        path.write_text(text)
    return [
        sys.executable, "-m", "snakemake", "--snakefile", str(WORKFLOW / "Snakefile"), "--directory", str(folder),
        "--workflow-profile", str(profile or WORKFLOW / "profiles" / "default"),
        "--configfile", str(ROOT / "config" / "smoke.yaml"), *map(str, changes), *arguments,
    ]  # fmt: skip


def campaign(folder: Path, *arguments: str, profile: Path | None = None, more: tuple[str, ...] = ()) -> Path:
    """Run it to its end; return its results."""
    whole = command(folder, *arguments, profile=profile, more=more)
    done = subprocess.run(whole, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return folder / "results" / "smoke"


def differences(one: Path, other: Path) -> list[str]:
    """Tables and figures of a campaign that are not the same bytes in another."""
    tables = ["perfusion/targets.json", "posterior/draws.csv", "estimation/table.csv", "estimation/pairs.csv"]
    tables += [f"runs/{path.name}" for path in sorted((one / "runs").glob("*.csv"))]
    figures = [f"figures/{path.name}" for path in sorted(one.glob("figures/*.*")) if path.name not in MEASURED]
    return [name for name in (*tables, *figures) if (one / name).read_bytes() != (other / name).read_bytes()]


def differing(one: Path, other: Path) -> list[str]:
    """Files that are missing in another campaign or not the same bytes, those apart that hold measured costs."""
    paths = {path.relative_to(one) for path in one.rglob("*") if path.is_file() and path.name not in COSTS}
    compared = [path for path in paths if not APART & set(path.parts) and path.suffix not in (".parquet", ".jsonl")]
    return [
        str(path)
        for path in sorted(compared)
        if not (other / path).exists() or (one / path).read_bytes() != (other / path).read_bytes()
    ]
