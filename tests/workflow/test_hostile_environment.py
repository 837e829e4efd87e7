"""A campaign in a container or a batch job: no home, no name, variables of an outer launcher, other users around."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.case_files import small_tree, write_case
from support.checkout import ROOT
from support.other_user import as_user

pytestmark = pytest.mark.workflow

ME = 12345
OUTER = {
    "SLURM_JOB_ID": "7", "SLURM_NODELIST": "a,b", "SLURM_PROCID": "1", "SLURM_NTASKS": "2", "PMI_RANK": "1",
    "PMI_SIZE": "2", "PMIX_RANK": "1", "PMIX_NAMESPACE": "outer", "OMPI_COMM_WORLD_RANK": "1",
    "GIT_DIR": "/nowhere", "GIT_WORK_TREE": "/",
}  # fmt: skip
ASCII = {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}


@pytest.fixture
def places(tmp_path_factory):
    """Return a folder of this user, and a temporary one that others have been in first."""
    above = tmp_path_factory.mktemp("places")
    for path in (above, *above.parents[:2]):
        path.chmod(0o755)
    own, shared = above / "my dir", above / "tmp"
    own.mkdir()
    os.chown(own, ME, ME)
    shared.mkdir()
    shared.chmod(0o1777)
    (shared / f"coronaryuq-{ME}").mkdir()
    return own, shared


def run(places, *words, **environment):
    own, shared = places
    given = {"PATH": os.environ["PATH"], "TMPDIR": str(shared), "PYTHONPATH": str(ROOT / "src")} | OUTER | ASCII
    command = [*as_user(ME), sys.executable, "-m", "coronaryuq.cli.main", *words]
    return subprocess.run(
        command, cwd=own, env=given | environment, capture_output=True, encoding="ascii", errors="replace", umask=0o077
    )


@pytest.mark.long
def test_a_campaign_starts_without_home_and_name(places):
    """The first job that compiles kernels, and the one before it."""
    (places[0] / "mine.yaml").write_text("name: mine\ncase: given/case.yaml\nperfusion: {realisations: 20}\n")
    write_case(places[0] / "given", small_tree())
    for path in places[0].rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    done = run(places, "run", "mine.yaml", "results/mine/perfusion/chunk_0.npz", "--cores", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    notes = list(Path(places[0], "results/mine/provenance").glob("*.json"))
    assert len(notes) == 2 and all('"code"' in note.read_text() for note in notes)
    assert list(places[1].glob("*/**/*.nbi")), "kernels are kept in the temporary folder"


@pytest.mark.parametrize("home", [{}, pytest.param({"HOME": "/"}, marks=pytest.mark.long), {"HOME": "/proc/nowhere"}])
def test_commands_need_no_home(places, home):
    checked = run(places, "check", str(ROOT / "config" / "smoke.yaml"), **home)
    assert checked.returncode == 0 and "Traceback" not in checked.stderr, checked.stderr


def test_text_that_the_locale_lacks_does_not_stop_a_command(places):
    done = run(places, "run", "--help")
    assert done.returncode == 0, done.stderr
    case = places[0] / "case.yaml"
    case.write_text("name: M\u00fcller\noutlets: \u00e9.csv\nstenoses: []\n", encoding="utf-8")
    case.chmod(0o644)
    wrong = run(places, "check", "case.yaml")
    assert wrong.returncode == 2 and wrong.stderr.startswith("error: case.yaml: name"), wrong.stderr
