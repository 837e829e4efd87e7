"""The wheel in an environment that has no checkout: it carries the workflow and runs campaigns in an empty folder."""

import email
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from support.case_files import small_tree, write_case
from support.checkout import ROOT

pytestmark = [pytest.mark.workflow, pytest.mark.slow]
pytest.importorskip("hatchling", reason="hatchling, of the extra `dev`, builds the wheel")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT, check=True, capture_output=True,
    )  # fmt: skip
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def program(wheel, tmp_path_factory):
    """The console command of a fresh environment with the wheel; its dependencies are those installed here."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=True)
    packages = next(folder.glob("lib/python*/site-packages"))
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python"), "install",
         "--quiet", "--no-deps", "--no-index", str(wheel)],
        check=True, capture_output=True,
    )  # fmt: skip
    # A path in a .pth file brings the packages there, but not the editable checkout that they name.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "bin" / "coronaryuq"


def run(program, folder, *arguments):
    """Run the command as a user would whose PATH holds neither environment."""
    return subprocess.run(
        [str(program), *arguments], cwd=folder, capture_output=True, text=True, timeout=1500,
        env={"PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin", "HOME": str(folder)},
    )  # fmt: skip


def test_the_wheel_states_what_it_needs_and_its_licence(wheel):
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("METADATA"))
        metadata = email.message_from_bytes(archive.read(name))
    requirements = [Requirement(line) for line in metadata.get_all("Requires-Dist")]
    needed = {one.name for one in requirements if one.marker is None}
    assert {"numpy", "scipy", "snakemake", "torch", "pyvista", "pydantic"} <= needed
    assert not [str(one) for one in requirements if any(part.operator in ("<", "==", "~=") for part in one.specifier)]
    assert metadata["License-Expression"] == "BSD-3-Clause"


def test_the_package_comes_from_the_wheel(program, tmp_path):
    code = "import coronaryuq, coronaryuq.core.shipped as s; print(coronaryuq.__file__); print(s.snakefile())"
    done = run(program.with_name("python"), tmp_path, "-c", code)
    assert all(str(program.parents[1]) in line for line in done.stdout.splitlines()) and done.stdout


def test_a_campaign_runs_in_an_empty_folder(program, tmp_path):
    planned = run(program, tmp_path, "run", "smoke", "--dry-run")
    assert planned.returncode == 0 and "bundled_patient" in planned.stdout + planned.stderr, planned.stderr
    write_case(tmp_path / "given", small_tree())
    (tmp_path / "mine.yaml").write_text("name: mine\ncase: given/case.yaml\n")
    done = run(program, tmp_path, "run", "mine.yaml", "results/mine/case/case.json")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "results/mine/case/case.json").is_file()
    assert str(ROOT) not in (tmp_path / "results/mine/provenance/case.json").read_text()
    checked = run(program, tmp_path, "check", "given/case.yaml")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    explained = run(program, tmp_path, "explain", "results/mine/case/case.json")
    assert explained.returncode == 0 and str(program.parents[1]) in explained.stdout
    assert run(program, tmp_path, "verify", "results/mine").returncode == 0


def test_unknown_configurations_are_one_line(program, tmp_path):
    done = run(program, tmp_path, "run", "smokes")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "the package has the configurations" in done.stderr


@pytest.mark.long
def test_the_demonstration_ends_with_a_report(program, tmp_path):
    done = run(program, tmp_path, "demo")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Report: results/smoke/report.html" in done.stdout and (tmp_path / "results/smoke/report.html").is_file()
