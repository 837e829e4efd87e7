"""Surroundings and files that stopped a command with a traceback, or for ever: one line, or no fault at all."""

import os
import shutil
import subprocess
import sys

import pytest

from support.case_files import small_tree, write_case
from support.checkout import ROOT


@pytest.fixture
def case(tmp_path):
    return write_case(tmp_path / "case", small_tree())


def command(*words, cwd=None, program=(sys.executable, "-m", "coronaryuq.cli.main"), **environment):
    """Run a command of coronaryuq."""
    given = os.environ | {"PYTHONPATH": str(ROOT / "src")} | environment
    return subprocess.run([*program, *map(str, words)], cwd=cwd, env=given, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("count", ["-1", "many", *(pytest.param(other, marks=pytest.mark.long) for other in ("0", ""))])
def test_a_number_of_numba_threads_that_is_none_is_not_believed(case, count):
    done = command("check", case, NUMBA_NUM_THREADS=count)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr


def test_a_deleted_current_folder_is_one_line(case, tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    inside = ("sh", "-c", f'cd "{gone}" && rmdir "{gone}" && exec "{sys.executable}" -m coronaryuq.cli.main "$@"', "sh")
    done = command("check", case, program=inside)
    assert done.returncode == 2 and done.stderr == "error: current folder: was deleted; change to another one (cd)\n"


def test_a_named_pipe_is_refused_instead_of_waited_for(case):
    pipe = case.with_name("pipe.yaml")
    os.mkfifo(pipe)
    done = command("check", pipe)
    assert done.returncode == 2 and done.stderr.startswith(f"error: {pipe}: is a named pipe"), done.stderr


@pytest.mark.parametrize("made", [os.mkfifo, lambda path: path.symlink_to(path.name)], ids=["pipe", "link to itself"])
def test_a_table_that_is_no_regular_file_is_not_said_to_be_absent(case, made):
    table = case.with_name("targets.csv")
    table.unlink()
    made(table)
    done = command("check", case)
    assert done.returncode == 2 and done.stderr.startswith(f"error: {table}: is no regular file"), done.stderr


def test_a_relative_home_leaves_nothing_in_the_current_folder(case, tmp_path):
    here = tmp_path / "here"
    here.mkdir()
    done = command("check", case, cwd=here, HOME="relative", XDG_CACHE_HOME="", XDG_CONFIG_HOME="", MPLCONFIGDIR="")
    assert done.returncode == 0 and list(here.iterdir()) == [], done.stderr


def test_a_path_without_a_shell_is_one_line(tmp_path):
    done = command("run", "smoke", cwd=tmp_path, PATH="/nonexistent")
    assert done.returncode == 2 and done.stderr.startswith("error: environment: PATH = '/nonexistent': has no bash")
    assert done.stderr.count("\n") == 1 and list(tmp_path.iterdir()) == []


def test_a_link_to_a_case_is_read_in_the_links_own_folder(case, tmp_path):
    """Files lie beside the link; where they lie beside its target alone, the line says so."""
    link = tmp_path / "elsewhere" / "case.yaml"
    link.parent.mkdir()
    link.symlink_to(case)
    done = command("check", link)
    assert done.returncode == 2 and f"beside this link; it is beside the file that the link leads to: name {case}" in (
        done.stderr
    )
    for file in case.parent.iterdir():
        if file.name != "case.yaml":
            (link.parent / file.name).symlink_to(file)
    assert command("check", link).returncode == 0


DIRECTLY = (sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "workflow" / "Snakefile"))
DIRECTLY += ("--cores", "1", "--dry-run", "--quiet", "all", "--configfile", str(ROOT / "config" / "smoke.yaml"))


def test_snakemake_without_bash_is_refused_before_its_first_job(tmp_path):
    """Jobs were started by another shell, which does not know the options of bash."""
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "which").symlink_to(shutil.which("which"))
    done = command("--", program=DIRECTLY, cwd=tmp_path, PATH=str(tmp_path / "bin"))
    assert done.returncode != 0 and "Traceback" not in done.stderr
    assert "error: environment: PATH" in done.stderr and "has no bash" in done.stderr


def test_snakemake_with_a_relative_home_leaves_no_folder_there(tmp_path):
    done = command("--", program=DIRECTLY, cwd=tmp_path, HOME="relative", XDG_CACHE_HOME="", XDG_CONFIG_HOME="")
    assert done.returncode == 0 and not (tmp_path / "relative").exists(), done.stderr


@pytest.mark.parametrize("module", ["coronaryuq", "coronaryuq.cli.main"])
def test_the_command_is_a_module(module):
    done = command("--version", program=(sys.executable, "-m", module))
    assert done.returncode == 0 and done.stdout.startswith("coronaryuq "), done.stderr
