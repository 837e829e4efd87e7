"""Folders and files named to trick a shell: every command takes them as names."""

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
