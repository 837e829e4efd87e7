"""`coronaryuq doctor` checks the folders that environment variables name."""

import json
import subprocess
import sys

import pytest

from coronaryuq.cli.doctor import EXTERNAL, Finding, examine
from coronaryuq.core import numba_cache
from coronaryuq.zerod.svzerodsolver import program

CHECKS = {"SNAKEMAKE_OUTPUT_CACHE": "cache", numba_cache.VARIABLE: "kernels", "TMPDIR": "scratch"}


@pytest.fixture(autouse=True)
def no_other_checks(monkeypatch):
    """Leave out the checks that start processes."""
    monkeypatch.setattr("coronaryuq.cli.doctor.check_libraries", lambda: ())
    monkeypatch.setattr("coronaryuq.cli.doctor.check_rendering", lambda: Finding("3D rendering", True, "left out"))
    for name in ("check_mpi", "check_job", "check_scheduler"):
        monkeypatch.setattr(f"coronaryuq.cli.doctor.{name}", lambda: ())


def finding(what):
    (found,) = (each for each in examine() if each.what == what)
    return found


@pytest.mark.parametrize("variable", CHECKS)
def test_a_folder_that_cannot_be_written_is_named(variable, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    nowhere = tmp_path / "file" / "folder"
    monkeypatch.setenv(variable, str(nowhere))
    monkeypatch.setattr("tempfile.tempdir", str(nowhere) if variable == "TMPDIR" else None)
    found = finding(CHECKS[variable])
    assert not found.sound and str(nowhere) in found.detail


@pytest.mark.parametrize("variable", CHECKS)
def test_a_writable_folder_is_named(variable, tmp_path, monkeypatch):
    monkeypatch.setenv(variable, str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path) if variable == "TMPDIR" else None)
    found = finding(CHECKS[variable])
    assert str(tmp_path) in found.detail and (found.sound or "need 2 GB" in found.detail)
    assert list(tmp_path.iterdir()) == []


def test_without_any_folder_for_kernels_the_variable_to_set_is_named(monkeypatch):
    monkeypatch.delenv(numba_cache.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    monkeypatch.setattr("tempfile.tempdir", "/proc/nowhere")
    found = finding("kernels")
    assert not found.sound and f"set {numba_cache.VARIABLE}" in found.detail


@pytest.mark.parametrize("program", EXTERNAL)
def test_an_installed_program_without_any_scratch_folder_fails_its_check_only(program, tmp_path, monkeypatch):
    (tmp_path / program).write_text("#!/bin/sh\n")
    (tmp_path / program).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", "/proc/nowhere")
    found = {each.what: each for each in examine()}
    assert not found[program].sound and "/proc/nowhere" in found[program].detail
    assert not found["scratch"].sound and found["python"].sound
    assert set(EXTERNAL) <= set(found)


def test_a_folder_that_cannot_be_written_fails_the_checks_that_need_it(tmp_path, monkeypatch):
    def refuse(*_, **settings):
        raise PermissionError(13, "Permission denied", settings.get("dir") or str(tmp_path))

    monkeypatch.setattr("tempfile.TemporaryDirectory", refuse)
    found = finding("locks")
    assert not found.sound and "Permission denied" in found.detail


@pytest.mark.slow
def test_the_json_has_every_check_and_the_verdict():
    command = [sys.executable, "-m", "coronaryuq.cli.main", "doctor", "--environment", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    told = json.loads(done.stdout)
    checks = {check["what"]: check for check in told["checks"]}
    assert {"python", "numpy", "pydantic", "3D rendering"} <= set(checks)
    assert all(check["detail"] for check in checks.values())
    assert told["sound"] == all(check["sound"] for check in checks.values()) == (done.returncode == 0)


@pytest.mark.parametrize("installed", [None, "svzerodsolver", "svzerod"])
def test_svzerodsolver_is_found_as_module_or_program_and_may_be_absent(monkeypatch, installed):
    if installed == "svzerod":
        pytest.importorskip("svzerod")
    monkeypatch.setattr(program, "installed", lambda: installed)
    found = finding("svZeroDSolver")
    assert found.sound
    assert ("pip install svzerod" in found.detail) == (installed is None)
    assert found.detail.startswith("module svzerod ") == (installed == "svzerod")
