"""The sound inputs, and a copy of them to spoil."""

import shutil
from pathlib import Path

import pytest

from support.sound_inputs import write_sound_inputs


@pytest.fixture(scope="session")
def sound(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sound")
    write_sound_inputs(folder)
    return folder


@pytest.fixture
def spoiled(sound, tmp_path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(sound, tmp_path / "given"))
