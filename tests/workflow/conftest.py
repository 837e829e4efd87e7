"""Fixtures of the workflow's tests."""

import pytest

from checkout import Checkout


@pytest.fixture
def checkout(tmp_path):
    """A copy of the workflow in a temporary folder."""
    return Checkout(tmp_path)
