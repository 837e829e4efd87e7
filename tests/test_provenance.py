"""The digest of the code behind a result covers all that computes, and nothing else."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import coronaryuq
from coronaryuq.core import provenance

ROOT = Path(provenance.__file__).parents[1]


def test_the_closure_follows_imports_and_packages():
    found = set(provenance.closure("coronaryuq.core.records"))
    assert {"coronaryuq", "coronaryuq.core", "coronaryuq.core.records", "coronaryuq.core.errors"} <= found
    assert "coronaryuq.core.seeds" not in found


def test_imports_inside_functions_count_and_those_for_type_checking_do_not():
    assert "coronaryuq.core.records" in provenance.closure("coronaryuq.campaign.explain")
    assert "coronaryuq.core.io.tables" not in provenance.closure("coronaryuq.core.units")


def test_a_module_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="no module coronaryuq.nowhere"):
        provenance.closure("coronaryuq.nowhere")


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ('"""Other words."""\n\n\ndef f(x):\n    # why\n    return x + 1\n', True),
        ('def f(x):\n    """Return more."""\n\n    return (x + 1)\n', True),
        ("def f(x):\n    return x + 2\n", False),
        ("def f(x):\n    return 'x + 1'\n", False),
        ("def f(x=1):\n    return x + 1\n", False),
    ],
)
def test_only_what_computes_changes_the_digest(tmp_path, text, same):
    first, second = tmp_path / "first.py", tmp_path / "second.py"
    first.write_text('"""Words."""\n\ndef f(x):\n    """Return one more."""\n    return x + 1\n')
    second.write_text(text)
    assert (provenance.syntax_digest(first) == provenance.syntax_digest(second)) == same


def test_the_digest_covers_templates_beside_the_modules():
    templates = {path.name for path in provenance.data_files("coronaryuq.report.page")}
    assert {"template.html", "style.css"} <= templates


@pytest.mark.slow
def test_every_module_can_be_digested():
    for path in sorted(ROOT.rglob("*.py")):
        ast.parse(path.read_text())
        assert len(provenance.syntax_digest(path)) == 64


def test_digest_does_not_depend_on_key_order():
    assert provenance.digest({"a": 1, "b": [1, 2]}) == provenance.digest({"b": [1, 2], "a": 1})
    assert provenance.digest({"a": 1}) != provenance.digest({"a": 2})


def git(folder, *words):
    own = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    command = ["git", "-C", str(folder), "-c", "user.name=a", "-c", "user.email=a@b", *words]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=own).stdout.strip()


@pytest.fixture
def copy(tmp_path):
    """Return a function that says the code version of a copy of the package in a repository somewhere."""
    if shutil.which("git") is None:
        pytest.skip("needs git")

    def version(where, **environment):
        package = tmp_path / where / "src" / "coronaryuq"
        if not package.exists():
            (package / "core").mkdir(parents=True)
            for name in ("__init__.py", "core/__init__.py", "core/provenance.py"):
                shutil.copy(ROOT / name, package / name)
        code = "from coronaryuq.core.provenance import code_version; print(code_version())"
        own = os.environ | {"PYTHONPATH": str(package.parent)} | environment
        return subprocess.run([sys.executable, "-c", code], env=own, check=True, capture_output=True, text=True).stdout

    return version


@pytest.mark.parametrize("place", ["inside", "."], ids=["in a folder of it", "at its top"])
def test_another_repository_around_a_copy_is_not_the_projects(copy, tmp_path, place):
    git(tmp_path, "init", "-q")
    git(tmp_path, "commit", "-q", "--allow-empty", "-m", "x")
    assert copy(place).strip() == coronaryuq.__version__


def test_a_repository_that_the_environment_names_is_not_the_projects(copy, tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    copy("own")
    for folder in (own, other):
        folder.mkdir(exist_ok=True)
        git(folder, "init", "-q")
        git(folder, "add", "--all")
        git(folder, "commit", "-q", "--allow-empty", "-m", folder.name)
    told = copy("own", GIT_DIR=str(other / ".git"), GIT_WORK_TREE=str(other), GIT_INDEX_FILE=str(other / ".git/index"))
    assert git(own, "rev-parse", "--short=12", "HEAD") in told
