"""Valid inputs, and a copy of them to corrupt."""

import shutil
from pathlib import Path

import pytest

from support.sound_inputs import write_sound_inputs


@pytest.fixture(scope="session")
def valid(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("valid")
    write_sound_inputs(folder)
    return folder


@pytest.fixture
def corrupted(valid, tmp_path) -> Path:
    """Return the folder of a copy to corrupt."""
    return Path(shutil.copytree(valid, tmp_path / "given"))
