"""Folders that only this user can write to, whatever the environment says of homes and temporary folders."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import coronaryuq
from coronaryuq.core import private_folders
from coronaryuq.core.numba_cache import VARIABLE
from support.other_user import as_user

SOURCES = Path(coronaryuq.__file__).parents[1]
CHOOSE = f"""
import os
from coronaryuq.core import numba_cache, private_folders
numba_cache.choose_folder()
folder = os.environ.get({VARIABLE!r}, "")
print(folder, private_folders.is_safe(__import__("pathlib").Path(folder)), os.stat(folder).st_uid if folder else None)
"""
ME, OTHER = 12345, 54321


@pytest.fixture
def shared(tmp_path_factory):
    """A temporary folder as all users share it."""
    folder = tmp_path_factory.mktemp("shared")
    for path in (folder, *folder.parents[:2]):
        path.chmod(0o755)
    folder.chmod(0o1777)
    return folder


def chosen(uid, shared, umask=0o022, **environment):
    """Return the folder of kernels that this user takes, whether it is safe, and its owner."""
    own = {"PATH": os.environ["PATH"], "TMPDIR": str(shared), "PYTHONPATH": str(SOURCES), **environment}
    command = [*as_user(uid), sys.executable, "-c", CHOOSE]
    done = subprocess.run(command, env=own, capture_output=True, text=True, umask=umask, cwd="/")
    assert done.returncode == 0, done.stderr
    folder, safe, owner = done.stdout.split()
    return Path(folder), safe == "True", int(owner)


@pytest.mark.parametrize(
    "environment",
    [{}, {"HOME": "/"}, {"HOME": ""}, {"HOME": "/proc/nowhere"}, {"HOME": "/root"}, {"XDG_CACHE_HOME": "relative"}],
    ids=["no HOME", "HOME=/", "empty", "read-only", "another's home", "relative cache"],
)
@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_without_a_home_kernels_are_kept_in_a_private_temporary_folder(shared, environment, umask):
    folder, safe, owner = chosen(ME, shared, umask, **environment)
    assert safe and owner == ME and shared in folder.parents
    assert chosen(ME, shared, umask, **environment)[0] == folder, "the second process finds what the first compiled"


@pytest.mark.parametrize("mode", [0o700, 0o777])
def test_a_folder_that_another_user_made_first_is_never_taken(shared, mode):
    there = shared / f"coronaryuq-{ME}"
    subprocess.run([*as_user(OTHER), "mkdir", "-m", oct(mode)[2:], str(there)], check=True)
    folder, safe, owner = chosen(ME, shared)
    assert safe and owner == ME and there not in folder.parents
    assert chosen(ME, shared)[0] == folder


def test_a_link_to_another_users_folder_is_never_followed(shared):
    (shared / "trap").mkdir()
    os.chown(shared / "trap", OTHER, OTHER)
    subprocess.run([*as_user(OTHER), "ln", "-s", "trap", str(shared / f"coronaryuq-{ME}")], check=True)
    folder, safe, owner = chosen(ME, shared)
    assert safe and owner == ME and folder.resolve() == folder


def test_kernels_that_others_could_write_are_not_taken(shared):
    folder, _, _ = chosen(ME, shared)
    folder.chmod(0o777)
    again, safe, _ = chosen(ME, shared)
    assert safe and again != folder


def test_a_shared_cache_folder_is_not_taken(shared):
    (shared / "cache").mkdir()
    (shared / "cache").chmod(0o777)
    folder, safe, _ = chosen(ME, shared, XDG_CACHE_HOME=str(shared / "cache"))
    assert safe and shared / "cache" not in folder.parents


@pytest.mark.parametrize(("uid", "mode", "taken"), [(ME, 0o700, True), (ME, 0o777, False), (OTHER, 0o755, False)])
def test_a_folder_that_the_user_names_is_taken_if_nobody_else_can_write_there(shared, uid, mode, taken):
    named = shared / "kernels"
    named.mkdir()
    named.chmod(mode)
    os.chown(named, uid, uid)
    folder, _, _ = chosen(ME, shared, **{VARIABLE: str(named)})
    assert (folder == named) == taken


def test_two_users_of_one_temporary_folder_do_not_meet(shared):
    assert chosen(ME, shared)[0].parent != chosen(OTHER, shared)[0].parent


@pytest.mark.parametrize("missing", ["HOME", "XDG_CACHE_HOME"])
def test_a_home_that_takes_files_is_left_alone(tmp_path, monkeypatch, missing):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if missing == "XDG_CACHE_HOME":
        monkeypatch.delenv(missing)
    before = dict(os.environ)
    private_folders.complete_environment()
    assert dict(os.environ) == before
