"""What `coronaryuq doctor` says of the folders that variables name: one that serves, one that does not, none."""

import pytest

from coronaryuq.cli import doctor
from coronaryuq.core import numba_cache

VARIABLES = {"SNAKEMAKE_OUTPUT_CACHE": doctor._cache, numba_cache.VARIABLE: doctor._kernels, "TMPDIR": doctor._scratch}


@pytest.mark.parametrize("variable", VARIABLES)
def test_a_folder_that_cannot_be_written_is_named(variable, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    nowhere = tmp_path / "file" / "folder"
    monkeypatch.setenv(variable, str(nowhere))
    monkeypatch.setattr("tempfile.tempdir", str(nowhere) if variable == "TMPDIR" else None)
    found = VARIABLES[variable]()
    assert not found.sound and str(nowhere) in found.detail


@pytest.mark.parametrize("variable", VARIABLES)
def test_a_folder_that_serves_is_named(variable, tmp_path, monkeypatch):
    monkeypatch.setenv(variable, str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path) if variable == "TMPDIR" else None)
    found = VARIABLES[variable]()
    assert str(tmp_path) in found.detail and (found.sound or "wanted 2 GB" in found.detail)
    assert list(tmp_path.iterdir()) == []


def test_without_a_folder_for_kernels_it_says_what_to_set(monkeypatch):
    monkeypatch.delenv(numba_cache.VARIABLE, raising=False)
    assert f"set {numba_cache.VARIABLE}" in doctor._kernels().detail
