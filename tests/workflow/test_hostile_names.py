"""Folders and files named to trick a shell: every command takes them as names."""

import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from coronaryuq.case.anatomy.tree import Tree
from support.checkout import Checkout

pytestmark = pytest.mark.workflow

NAME = """it's "one"; $(touch hacked) `touch hacked` & folder"""


def test_no_name_reaches_a_shell(tmp_path):
    from support.case_files import straight, write_case

    tree = Tree([straight("aorta", (0, 0, 0), (0, 0, 1), 2.0, (1.2, 1.2))])
    checkout = Checkout(tmp_path / NAME)
    write_case(checkout.folder / NAME, tree)
    checkout.settings["case"] = f"{NAME}/case.yaml"
    checkout.replace_jobs()
    done = checkout.run("results/tiny/posterior/length_1/chains.npz")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "posterior_chains" in (checkout.folder / "jobs_that_ran").read_text()
    assert not list(tmp_path.rglob("hacked")) and not Path("hacked").exists()


def test_braces_are_refused_in_one_line(tmp_path):
    checkout = Checkout(tmp_path / "my {x}")
    done = checkout.run("--dry-run")
    assert done.returncode == 2
    (line,) = (line for line in done.stderr.splitlines() if line.startswith("error:"))
    assert "my {x}/workflow: Snakemake takes braces for wildcards; rename the folder" in line


def test_a_python_in_a_folder_with_a_space_runs_jobs(tmp_path):
    """Snakemake starts scripts by the path of its own Python, unquoted."""
    checkout = Checkout(tmp_path / "my dir")
    python = checkout.folder / ".venv" / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(python.parents[1])], check=True)
    (own,) = (python.parents[1] / "lib").glob("python3*/site-packages")
    (own / "others.pth").write_text(sysconfig.get_paths()["purelib"])
    checkout.replace_jobs({"bundled_patient": "[pathlib.Path(output).write_text(sys.prefix) for output in outputs]"})
    started = checkout.command("results/tiny/patient/case.yaml")
    done = subprocess.run(**started | {"args": [str(python), *started["args"][1:]]}, capture_output=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (checkout.folder / "results/tiny/patient/case.yaml").read_text() == str(python.parents[1])
