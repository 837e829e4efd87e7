"""Fixtures that every test may use."""

from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits


@pytest.fixture(scope="session", autouse=True)
def one_thread_of_linear_algebra():
    """As many as a job of the campaign has: the tests themselves run side by side on all cores."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder with real data beside the project; tests that need it are skipped where it is absent."""
    folder = Path(__file__).parents[2] / "shared"
    if not (folder / "data").is_dir():
        pytest.skip("needs the real data in ../shared, which is not there")
    return folder
