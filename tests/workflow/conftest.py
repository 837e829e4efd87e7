"""Fixtures of the workflow's tests."""

import pytest

from support import smoke
from support.checkout import Checkout


@pytest.fixture
def checkout(tmp_path):
    """A copy of the workflow in a temporary folder."""
    return Checkout(tmp_path)


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Results of the smoke campaign, run once for all tests of a session."""
    return smoke.campaign(tmp_path_factory.mktemp("smoke"))
