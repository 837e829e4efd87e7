"""A copy of the workflow in a temporary folder, to ask what Snakemake would do there."""

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
EMPTY_OUTPUTS = """
import os, pathlib, sys
with open(os.environ["JOBS_THAT_RAN"], "a") as jobs:
    jobs.write((snakemake.rule if "snakemake" in globals() else "posterior_chains") + chr(10))
if "snakemake" in globals():
    outputs = list(snakemake.output)
else:
    outputs = [word.split("=", 1)[1] for word in sys.argv if word.startswith("chains=")]
for output in map(pathlib.Path, outputs):
    if output.suffix:
        output.write_text("")
    else:
        output.mkdir(exist_ok=True)
"""


def scripts_at_work(folder: Path, name: str) -> list[int]:
    """Python processes that run a script for a campaign in a folder, MPI ranks and jobs of SLURM included."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            line = (process / "cmdline").read_bytes().decode(errors="replace")
            python = Path(os.readlink(process / "exe")).name.startswith("python")
        except OSError:
            continue
        if python and str(folder) in line and f"{name}.py" in line:
            found.append(int(process.name))
    return sorted(found)


class Checkout:
    """Copy of the project's workflow, configuration and sources, with a small campaign named `tiny`."""

    def __init__(self, folder: Path, cache: Path | None = None):
        self.folder, self.cache = folder, cache
        folder.mkdir(parents=True, exist_ok=True)
        for part in ("Snakefile", "workflow", "config", "src"):
            source = ROOT / part
            if source.is_dir():
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
            else:
                shutil.copy(source, folder / part)
        self.settings = {"name": "tiny", "samples": {"n_3d": 16, "n_0d": 64, "batch_3d": 8, "chunk_0d": 32}}

    def command(self, *arguments: str, settings: dict | None = None) -> dict:
        """Arguments of `subprocess.Popen` for Snakemake in this folder."""
        (self.folder / "tiny.yaml").write_text(yaml.safe_dump(self.settings if settings is None else settings))
        command = [sys.executable, "-m", "snakemake", "--configfile", "tiny.yaml", "--cores", "2", *arguments]
        environment = os.environ | {"PYTHONPATH": str(self.folder / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
        environment["JOBS_THAT_RAN"] = str(self.folder / "jobs_that_ran")
        if self.cache is not None:
            environment["SNAKEMAKE_OUTPUT_CACHE"] = str(self.cache)
            command.insert(3, "--cache")
        return {"args": command, "cwd": self.folder, "env": environment, "text": True}

    def run(self, *arguments: str, settings: dict | None = None) -> subprocess.CompletedProcess:
        return subprocess.run(**self.command(*arguments, settings=settings), capture_output=True, timeout=1200)

    def dry_run(self, *targets: str, settings: dict | None = None) -> Counter:
        """Jobs per rule that would run now."""
        done = self.run("--dry-run", *targets, settings=settings)
        assert done.returncode == 0, done.stdout + done.stderr
        return Counter(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", done.stdout + done.stderr, re.MULTILINE))

    def pretend_done(self, own: dict[str, str] | None = None) -> Counter:
        """Run the campaign with scripts that only make empty outputs, so that Snakemake's own records are real.

        own: scripts that do something else. Returns the jobs that ran, per rule: those whose results came from a cache
        are not among them.
        """
        for path in (self.folder / "workflow" / "scripts").glob("*.py"):
            path.write_text((own or {}).get(path.name, EMPTY_OUTPUTS))
        done = self.run()
        assert done.returncode == 0, done.stdout + done.stderr
        return Counter((self.folder / "jobs_that_ran").read_text().split())

    def small_case(self) -> str:
        """Write a case of five vessels beside the workflow; its path, as the configuration names it."""
        from support.case_files import small_tree, write_case

        write_case(self.folder / "given", small_tree())
        return "given/case.yaml"

    def edit(self, module: str) -> None:
        """Add a harmless line to a source file."""
        with open(self.folder / "src" / "coronaryuq" / module, "a") as file:
            file.write("\nEDITED = True\n")
