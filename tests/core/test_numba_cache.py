"""Compiled kernels of one version of the sources are never used for another."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import coronaryuq
from coronaryuq.core.numba_cache import VARIABLE, choose_folder


def folder_of(package, monkeypatch, home):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    choose_folder(package)
    return os.environ.get(VARIABLE)


def run(code, home):
    environment = {**os.environ, "XDG_CACHE_HOME": str(home)}
    environment.pop(VARIABLE, None)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


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


def test_the_users_choice_is_kept(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "/somewhere")
    choose_folder(tmp_path)
    assert os.environ[VARIABLE] == "/somewhere"


def test_importing_the_package_alone_makes_no_folder(tmp_path):
    assert run(f"import os, coronaryuq; print({VARIABLE!r} in os.environ)", tmp_path) == "False"
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_kernels_are_compiled_into_the_folder_even_if_numba_was_imported_first(tmp_path):
    code = "import numba; from coronaryuq.zerod.solver import kernels; print(numba.config.CACHE_DIR)"
    folder = run(code, tmp_path)
    assert folder.startswith(f"{tmp_path}/coronaryuq/kernels-") and Path(folder).is_dir()


@pytest.mark.slow
def test_modules_with_kernels_import_numba_from_core_jit():
    """Importing numba.extending or numba.types directly is fine: they cache nothing."""
    root = Path(coronaryuq.__file__).parent
    decorators = {"njit", "jit", "vectorize", "guvectorize"}
    for path in root.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = {alias.name for alias in node.names} if isinstance(node, ast.Import | ast.ImportFrom) else set()
            direct = "numba" in names if isinstance(node, ast.Import) else False
            direct |= isinstance(node, ast.ImportFrom) and node.module == "numba" and bool(decorators & names)
            assert not direct or path == root / "core" / "jit.py", path


def test_a_read_only_home_does_not_stop_anything():
    assert "kernels-" in run(f"import os, coronaryuq.core.jit; print(os.environ[{VARIABLE!r}])", "/proc/nowhere")
