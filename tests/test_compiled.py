"""Compiled kernels of one version of the sources are never used for another."""

import os
import subprocess
import sys

from coronaryuq.core.numba_cache import VARIABLE, keep_apart


def folder_of(package, monkeypatch, home):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    keep_apart(package)
    return os.environ.get(VARIABLE)


def test_an_edit_of_any_kernel_file_changes_the_folder(tmp_path, monkeypatch):
    package = tmp_path / "package"
    package.mkdir()
    (package / "lanes.py").write_text("import numba\n")
    (package / "words.py").write_text("text = 1\n")
    first = folder_of(package, monkeypatch, tmp_path)
    (package / "words.py").write_text("text = 2\n")
    assert folder_of(package, monkeypatch, tmp_path) == first
    (package / "lanes.py").write_text("import numba\nx = 1\n")
    assert folder_of(package, monkeypatch, tmp_path) != first


def test_the_users_choice_stands(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "/somewhere")
    keep_apart(tmp_path)
    assert os.environ[VARIABLE] == "/somewhere"


def test_a_read_only_home_does_not_stop_anything(tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": "/proc/nowhere"}
    environment.pop(VARIABLE, None)
    code = "import os, coronaryuq; print(os.environ['NUMBA_CACHE_DIR'])"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and "kernels-" in done.stdout
