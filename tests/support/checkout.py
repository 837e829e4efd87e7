"""Copy of the workflow in a temporary folder, to ask what Snakemake would do there."""

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import yaml

from support.warm_snakemake import snakemake

ROOT = Path(__file__).parents[2]
EMPTY_OUTPUTS = """
import os, pathlib, sys
rule = snakemake.rule if "snakemake" in globals() else sys.argv[sys.argv.index("--name") + 1]
with open(os.environ["JOBS_THAT_RAN"], "a") as jobs:
    jobs.write(rule + chr(10))
if "snakemake" in globals():
    outputs = list(snakemake.output)
else:
    words = sys.argv[sys.argv.index("--output") + 1 : sys.argv.index("--params")]
    outputs = [word.split("=", 1)[1] for word in words]
for output in map(pathlib.Path, outputs):
    if output.suffix:
        output.write_text("")
    else:
        output.mkdir(exist_ok=True)
"""
"""In place of stage.py: notes the rule and makes its outputs, empty."""


def jobs_at_work(folder: Path, rule: str) -> list[int]:
    """Return the Python processes that run jobs of a rule for a campaign in a folder, MPI ranks and SLURM jobs too."""
    processes = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            line = (path / "cmdline").read_bytes().decode(errors="replace").split("\0")
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            python = Path(os.readlink(path / "exe")).name.startswith("python")
        except OSError:
            continue
        processes[int(path.name)] = (parent, line, python)

    def of_rule(pid: int) -> bool:
        """Whether the process, or one that started it, was told to run the rule."""
        while pid in processes:
            parent, line, _ = processes[pid]
            if rule in line or any(word.startswith(f"{rule}:") for word in line):
                return True
            pid = parent
        return False

    found = []
    for pid, (_, line, python) in processes.items():
        script = python and any(word.endswith("stage.py") for word in line) and str(folder) in " ".join(line)
        if script and of_rule(pid):
            found.append(pid)
    return sorted(found)


class Checkout:
    """Copy of the project's workflow and sources, with a small campaign named `tiny`, without mesh study and losses."""

    def __init__(self, folder: Path, cache: Path | None = None):
        self.folder, self.cache, self.source, self.edited = folder, cache, folder / "src" / "coronaryuq", False
        folder.mkdir(parents=True, exist_ok=True)
        for part in ("workflow", "config", "src"):
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
        for name in ("LICENSE", "CITATION.cff"):
            shutil.copy(ROOT / name, folder)
        samples = {"n_3d": 16, "n_0d": 64, "batch_3d": 8, "chunk_0d": 32}
        self.settings = {"name": "tiny", "samples": samples, "flow3d": {"mesh_study": 0}, "losses": {"runs_3d": 0}}

    def command(self, *arguments: str, settings: dict | None = None) -> dict:
        """Arguments of `subprocess.Popen` for Snakemake in this folder."""
        (self.folder / "tiny.yaml").write_text(yaml.safe_dump(self.settings if settings is None else settings))
        command = [sys.executable, "-m", "snakemake", "--configfile", "tiny.yaml", "--cores", "2"]
        command += ["--workflow-profile", "none", *arguments]
        environment = os.environ | {"PYTHONPATH": str(self.folder / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
        environment["JOBS_THAT_RAN"] = str(self.folder / "jobs_that_ran")
        if self.cache is not None:
            environment["SNAKEMAKE_OUTPUT_CACHE"] = str(self.cache)
            command.insert(3, "--cache")
        return {"args": command, "cwd": self.folder, "env": environment, "text": True}

    def run(self, *arguments: str, settings: dict | None = None) -> subprocess.CompletedProcess:
        command = self.command(*arguments, settings=settings)
        if self.edited:
            return subprocess.run(**command, capture_output=True, timeout=1200)
        return snakemake(command["args"][3:], command["cwd"], command["env"])

    def dry_run(self, *targets: str, settings: dict | None = None) -> Counter:
        """Jobs per rule that would run now."""
        done = self.run("--dry-run", *targets, settings=settings)
        assert done.returncode == 0, done.stdout + done.stderr
        return Counter(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", done.stdout + done.stderr, re.MULTILINE))

    def pretend_done(self, *targets: str, own: dict[str, str] | None = None) -> Counter:
        """Run the campaign with jobs that only make empty outputs, so that Snakemake's own records are real.

        own: scripts of rules that do something else. Returns the jobs that ran, per rule, without those whose results
        came from a cache.
        """
        self.replace_jobs(own)
        done = self.run(*targets)
        assert done.returncode == 0, done.stdout + done.stderr
        return Counter((self.folder / "jobs_that_ran").read_text().split())

    def replace_jobs(self, own: dict[str, str] | None = None) -> None:
        """Replace the script of all jobs by one that makes empty outputs, or by that of `own` for some rules."""
        script = EMPTY_OUTPUTS
        for rule, text in (own or {}).items():
            script += f"if rule == {rule!r}:\n    exec({text!r})\n"
        (self.folder / "workflow" / "scripts" / "stage.py").write_text(script)

    def small_case(self) -> str:
        """Write a case of five vessels beside the workflow; its path, as the configuration names it."""
        from support.case_files import small_tree, write_case

        write_case(self.folder / "given", small_tree())
        return "given/case.yaml"

    def edit(self, module: str, line: str = "EDITED = True") -> None:
        """Add a line to a source file."""
        self.edited = True
        with open(self.source / module, "a") as file:
            file.write(f"\n{line}\n")

    def restore(self, *modules: str) -> None:
        """Undo all edits, which are those of the given source files."""
        for module in modules:
            shutil.copy2(ROOT / "src" / "coronaryuq" / module, self.source / module)
        self.edited = False
