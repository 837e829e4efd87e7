"""Fixtures of the workflow's tests."""

import os
import shutil

import pytest
from filelock import FileLock

from support import smoke
from support.checkout import Checkout


@pytest.fixture
def checkout(tmp_path):
    """A copy of the workflow in a temporary folder."""
    return Checkout(tmp_path)


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Results of the smoke campaign, which is run once for all workers; each has a copy, which its tests may change."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return smoke.campaign(tmp_path_factory.mktemp("smoke"))
    common = tmp_path_factory.getbasetemp().parent / "smoke"
    with FileLock(f"{common}.lock"):
        if not common.exists():
            made = tmp_path_factory.mktemp("made")
            smoke.campaign(made)
            made.rename(common)
    return shutil.copytree(common, tmp_path_factory.mktemp("own") / "smoke") / "results" / "smoke"
