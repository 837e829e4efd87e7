"""A copy of the workflow in a temporary folder, to ask what Snakemake would do there."""

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]


class Checkout:
    """Copy of the project's workflow, configuration and sources, with a small campaign named `tiny`."""

    def __init__(self, folder: Path):
        self.folder = folder
        for part in ("Snakefile", "workflow", "config", "src"):
            source = ROOT / part
            if source.is_dir():
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
            else:
                shutil.copy(source, folder / part)
        self.settings = {"name": "tiny", "samples": {"n_3d": 16, "n_0d": 64, "batch_3d": 8, "chunk_0d": 32}}

    def run(self, *arguments: str, settings: dict | None = None) -> subprocess.CompletedProcess:
        (self.folder / "tiny.yaml").write_text(yaml.safe_dump(self.settings if settings is None else settings))
        command = [sys.executable, "-m", "snakemake", "--configfile", "tiny.yaml", "--cores", "2", *arguments]
        environment = os.environ | {"PYTHONPATH": str(self.folder / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
        return subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True, timeout=300)

    def dry_run(self, *targets: str, settings: dict | None = None) -> Counter:
        """Jobs per rule that would run now."""
        done = self.run("--dry-run", *targets, settings=settings)
        assert done.returncode == 0, done.stdout + done.stderr
        return Counter(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", done.stdout + done.stderr, re.MULTILINE))

    def pretend_done(self) -> None:
        """Let every output exist and be recorded as made just now, from the inputs, code and parameters of now."""
        listed = self.run("--dry-run")
        outputs = re.findall(r"^    output: (.*)$", listed.stdout + listed.stderr, re.MULTILINE)
        for path in (self.folder / name for line in outputs for name in line.split(", ")):
            if path.suffix:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("")
            else:
                path.mkdir(parents=True, exist_ok=True)
        done = self.run("--touch")
        assert done.returncode == 0, done.stdout + done.stderr

    def edit(self, module: str) -> None:
        """Add a harmless line to a source file."""
        with open(self.folder / "src" / "coronaryuq" / module, "a") as file:
            file.write("\nEDITED = True\n")


@pytest.fixture
def checkout(tmp_path):
    return Checkout(tmp_path)
