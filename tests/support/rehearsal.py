"""The paper's campaign at its full fan-out, with recorded results in place of computations: run by hand.

    python -m support.rehearsal results/smoke FOLDER              all of it on this machine
    python -m support.rehearsal results/smoke FOLDER --slurm 20   up to 20 of its 3D jobs, on a SLURM of its own

500 3D jobs of one sample each, on SLURM with 96 tasks that `srun` really starts on declared cores; 2500 realisations,
24 chains, 10,000 0D runs per input set, 80 jobs of resampled inputs. What a job would compute is copied from a record,
made at the campaign's size from a finished smoke campaign (what that has not made, a figure say, is some file); runs
are gathered in earnest. Prints one JSON object.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from coronaryuq.core import records
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.posterior.samples import theta
from support import cluster
from support.checkout import ROOT, Checkout

IN_EARNEST = ("runs",)
NAME = "rehearsal"

COPY = """
    shell:
        "{launch}for f in {{output:q}}; do mkdir -p $(dirname $f);"
        " if [ -e {record}/$f ]; then cp -rT {record}/$f $f; else cp {record}/note.json $f; fi; done;"
        " echo done > {{log:q}}; {spent}mkdir -p results/{name}/provenance;"
        " cp {record}/note.json 'results/{name}/provenance/{{rule}}-{{wildcards}}.json'"
"""

SPENT = (
    "for p in $(grep -lsz ^SLURM_JOB_ID=$SLURM_JOB_ID$ /proc/[0-9]*/environ | cut -d/ -f3); do"
    " cat /proc/$p/stat; done > {record}/spent/$SLURM_JOB_ID 2> {record}/spent/lost || true; "
)
"""Records the CPU time of the processes that SLURM has started for a job: both Snakemakes."""


def record(smoke: Path, settings: dict, folder: Path) -> None:
    """Write results of the campaign at its full size, copied from a finished smoke campaign, to `folder`/results."""
    home = folder / "results" / NAME
    shutil.copytree(smoke, home)
    shutil.copy(next(smoke.glob("provenance/flow3d_batch*.json")), folder / "note.json")
    for part in ("provenance", "logs", ".lock", "samples", "flow3d/checkpoints"):
        path = home / part
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    draws = read_csv(smoke / "posterior" / "draws.csv")
    beds = [name for name in draws.columns if name not in ("chain", "generation", "log_density")]
    counts = {"pilot": settings["samples"]["n_3d"], "propagation": settings["samples"]["n_0d"]}
    tables = {name: theta(draws, beds, name, count, (0.7, 1.25), 1) for name, count in counts.items()}
    for name, table in tables.items():
        write_csv(home / "samples" / f"{name}.csv", table)
        runs = pd.read_parquet(smoke / "zerod" / f"{name}_0.parquet")
        size = settings["samples"]["chunk_0d"]
        for k, first in enumerate(range(0, len(table), size)):
            part = table["sample"].iloc[first : first + size]
            chunk = runs.iloc[np.arange(len(part)) % len(runs)].reset_index(drop=True)
            chunk.assign(sample=part.to_numpy()).to_parquet(home / "zerod" / f"{name}_{k}.parquet")
    held = records.read(smoke / "flow3d" / "batch_0.jsonl")
    for k, row in enumerate(tables["pilot"].to_dict("records")):
        one = held[k % len(held)]
        one.sample, one.inputs = row.pop("sample"), row
        records.write(home / "flow3d" / f"batch_{k}.jsonl", [one])
    _repeat(home / "flow3d", "fields_{}.zip", counts["pilot"], smoke / "flow3d" / "fields_1.zip")
    _repeat(home / "zerod", "resampled_{}.parquet", settings["samples"]["chunks_resampled"])
    chunks = -(-settings["perfusion"]["realisations"] // settings["samples"]["chunk_realisations"])
    _repeat(home / "perfusion", "chunk_{}.npz", chunks)


def _repeat(folder: Path, name: str, count: int, source: Path | None = None) -> None:
    source = source or folder / name.format(0)
    for k in range(count):
        if not (folder / name.format(k)).exists():
            shutil.copy(source, folder / name.format(k))


def copying(checkout: Checkout, folder: Path, slurm: bool) -> None:
    """Replace what the rules run by copies of the record."""
    workflow = checkout.folder / "workflow"
    for path in (workflow / "rules").glob("*.smk"):
        rules = re.split(r"^(?=(?:rule|checkpoint) \w+:)", path.read_text(), flags=re.MULTILINE)
        path.write_text("".join(_copying(rule, folder, slurm) for rule in rules))
    (workflow / "scripts" / "chains.py").write_text(
        "import os, shutil, sys\n"
        "(to,) = [word.partition('=')[2] for word in sys.argv if word.startswith('out_npz=')]\n"
        "(cost,) = [word.partition('=')[2] for word in sys.argv if word.startswith('cost=')]\n"
        "if os.environ.get('PMI_RANK', os.environ.get('SLURM_PROCID', '0')) == '0':\n"
        f"    for file in (to, cost):\n        shutil.copy({folder.as_posix()!r} + '/' + file, file)\n"
    )


def _copying(rule: str, folder: Path, slurm: bool) -> str:
    """Return the text of a rule that copies its outputs from the record."""
    name = rule.partition(":")[0].split()[-1] if rule.startswith(("rule", "checkpoint")) else ""
    if name in IN_EARNEST:
        return rule
    launch, spent = "", ""
    if name == "flow3d_batch":
        launch = "{resources.mpi} -n {resources.tasks} true; "
        spent = SPENT.format(record=folder.as_posix()) if slurm else ""
    text = COPY.format(record=folder.as_posix(), name=NAME, launch=launch, spent=spent)
    rule = rule.replace('source_path("../scripts/stage.py")', 'source_path("../scripts/chains.py")')
    return rule.replace('\n    script:\n        "../scripts/stage.py"\n', text)


def rehearse(smoke: Path, folder: Path, slurm: int | None, cpus: int) -> dict:
    settings = yaml.safe_load((ROOT / "config" / "paper.yaml").read_text())
    settings |= {"name": NAME, "backend": "svsolver"}
    del settings["paper_data"]
    settings["samples"] |= {"batch_3d": 1, "n_3d": 500, "chunks_resampled": 80}
    settings["flow3d"]["mesh_study"] = 0
    record(smoke, settings, folder)
    checkout = Checkout(folder / "campaign")
    planned = _run(checkout.command("--dry-run", "--quiet", "all", "--scheduler", "greedy", settings=settings))
    jobs = checkout.dry_run("--scheduler", "greedy", settings=settings)
    copying(checkout, folder, slurm is not None)
    if slurm:
        (folder / "spent").mkdir()
        with cluster.cluster(folder / "slurm", cpus=cpus, memory_mb=4_000_000):
            batches = [f"results/{NAME}/flow3d/batch_{k}.jsonl" for k in range(slurm)]
            done = _run(checkout.command("--profile", str(_site(folder)), "--", *batches, settings=settings))
            listed = subprocess.run(["scontrol", "--oneliner", "show", "jobs"], capture_output=True, text=True).stdout
        more = _queue(listed) | _spent(folder / "spent")
    else:
        profile = ROOT / "workflow" / "profiles" / "default"
        done = _run(checkout.command("--profile", str(profile), "--cores", "1", settings=settings))
        gathered = (checkout.folder / "results" / NAME / "runs" / "outputs_3d.csv").read_text().splitlines()
        more = {"rows_gathered": len(gathered) - 1}
    home = checkout.folder / "results" / NAME
    files = [path for path in home.rglob("*") if path.is_file()]
    return {
        "jobs": sum(jobs.values()),
        "jobs_3d": jobs["flow3d_batch"],
        "dry_run_wall_s": round(planned["wall_s"], 1),
        "dry_run_cpu_s": round(planned["own_cpu_s"], 1),
        "wall_s": round(done["wall_s"]),
        "snakemake_own_cpu_s": round(done["own_cpu_s"], 1),
        "files": len(files),
        "files_of_snakemake": sum(path.is_file() for path in (checkout.folder / ".snakemake").rglob("*")),
        "megabytes": round(sum(path.stat().st_size for path in files) / 1e6, 1),
        **more,
    }


def _queue(listed: str) -> dict:
    """Return what SLURM reports of its jobs: how many, how fast they were submitted, how long they waited and ran."""
    jobs = [dict(word.split("=", 1) for word in line.split() if "=" in word) for line in listed.splitlines()]
    jobs = [job for job in jobs if job["JobState"] == "COMPLETED"]
    submitted, started, ended = (
        np.array([np.datetime64(job[name]) for job in jobs]).astype(float)
        for name in ("SubmitTime", "StartTime", "EndTime")
    )
    large = np.array([job["NumTasks"] == "96" for job in jobs])
    at_once = [int(((started[large] <= t) & (ended[large] > t)).sum()) for t in started[large]]
    return {
        "slurm_jobs_completed": len(jobs),
        "of_96_tasks": int(large.sum()),
        "of_96_tasks_at_once": max(at_once),
        "submitted_within_s": float(np.ptp(submitted[large])),
        "ran_s_median": float(np.median((ended - started)[large])),
        "first_start_to_last_end_s": float(ended[large].max() - started[large].min()),
    }


def _spent(folder: Path) -> dict:
    """Return the CPU time (s) of the processes that SLURM had started for a job when its work began."""
    spent = []
    for path in folder.glob("[0-9]*"):
        rows = [line.rpartition(")")[2].split() for line in path.read_text().splitlines()]
        spent.append(sum(int(row[11]) + int(row[12]) for row in rows) / 100)
    return {"cpu_s_of_a_job_median": round(float(np.median(spent)), 2)} if spent else {}


def _site(folder: Path) -> Path:
    """Write the profile `slurm` with 96 tasks per 3D job; return its folder."""
    profile = yaml.safe_load((ROOT / "workflow" / "profiles" / "slurm" / "config.yaml").read_text())
    profile["set-resources"]["flow3d_batch"] |= {"mpi": "srun", "tasks": 96}
    profile |= {"latency-wait": 20, "slurm-init-seconds-before-status-checks": 1}
    (folder / "site").mkdir()
    (folder / "site" / "config.yaml").write_text(yaml.safe_dump(profile))
    return folder / "site"


def _run(command: dict) -> dict:
    """Run Snakemake; return its wall time and the CPU time of its own process, without its jobs."""
    started, own = time.monotonic(), 0.0
    with subprocess.Popen(**command, stdout=sys.stderr, stderr=sys.stderr) as process:
        while process.poll() is None:
            try:
                spent = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
                own = max(own, sum(map(int, spent)) / 100)
            except (OSError, ValueError):
                pass
            time.sleep(0.2)
    if process.returncode:
        raise SystemExit(f"snakemake ended with code {process.returncode}")
    return {"wall_s": time.monotonic() - started, "own_cpu_s": own}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("smoke", type=Path, help="results of a finished smoke campaign")
    parser.add_argument("folder", type=Path, help="where to rehearse; must not exist")
    parser.add_argument("--slurm", type=int, metavar="N", help="up to that many 3D jobs, on a SLURM started for it")
    parser.add_argument("--cpus", type=int, default=960, help="declared cores of each of SLURM's two nodes")
    given = parser.parse_args()
    given.folder.mkdir(parents=True)
    print(json.dumps(rehearse(given.smoke.resolve(), given.folder.resolve(), given.slurm, given.cpus), indent=1))
