"""Fixtures for all tests."""

import os
from pathlib import Path

import hypothesis
import pytest
from threadpoolctl import threadpool_limits

# A first call may import a library, and other work may share the machine: no example is timed.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")


@pytest.fixture(scope="session", autouse=True)
def one_thread_of_linear_algebra():
    """Like a job of a campaign; the tests themselves run in parallel on all cores."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session", autouse=True)
def no_wait_for_the_disk():
    """No test loses power, and tests write files by the thousand: each waits milliseconds until it is on the disk."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="session")
def shared() -> Path:
    """Return the folder of real data beside the project; skip the test if it is absent."""
    folder = Path(__file__).parents[2] / "shared"
    if not (folder / "data").is_dir():
        pytest.skip("needs the real data in ../shared")
    return folder


@pytest.fixture(scope="session")
def stenosis_case(tmp_path_factory):
    """Folder of a case of the search with a hidden stenosis, and what was hidden."""
    from coronaryuq.bench.discrepancy.cases import Case
    from coronaryuq.bench.discrepancy.hidden_cases import open_loop
    from coronaryuq.bench.discrepancy.trial import hide

    folder = tmp_path_factory.mktemp("case")
    truth, _ = hide(Case(("quadratic_stenosis",), "medium", "nominal", 5), open_loop(), folder)
    return folder, truth
