"""Definitions of containers and of the conda environment: they name files that exist and agree with pyproject.toml."""

import re
import shutil
import subprocess
import tomllib

import pytest
import yaml
from packaging.specifiers import SpecifierSet

from support.checkout import ROOT

ENVS = ROOT / "envs"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def sources(definition: str) -> list[str]:
    """Files that go into an Apptainer image."""
    section = definition.partition("%files")[2].partition("%post")[0]
    return [line.split()[0] for line in section.splitlines() if line.strip()]


def copied(definition: str) -> list[str]:
    """Files that go into a Docker image."""
    return [word for line in re.findall(r"^COPY (.+)$", definition, re.MULTILINE) for word in line.split()[:-1]]


@pytest.mark.parametrize(("name", "files_of"), [("coronaryuq.def", sources), ("Dockerfile", copied)])
def test_a_container_holds_what_the_build_of_the_package_needs(name, files_of):
    files = files_of((ENVS / name).read_text())
    assert [path for path in files if not (ROOT / path).exists()] == []
    hatch = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {"pyproject.toml", PROJECT["project"]["readme"], *PROJECT["project"]["license-files"]}
    needed |= {path.split("/")[0] for path in hatch["packages"]} | set(hatch["force-include"])
    assert needed | {"envs/requirements.lock"} == set(files)


def test_the_conda_environment_has_the_versions_of_python_that_the_package_allows():
    found = yaml.safe_load((ENVS / "environment.yml").read_text())["dependencies"]
    (python,) = (line for line in found if isinstance(line, str) and line.startswith("python "))
    tested = [line.split(" :: ")[-1] for line in PROJECT["project"]["classifiers"] if ":: 3." in line]
    allowed = SpecifierSet(python.removeprefix("python ")) & SpecifierSet(PROJECT["project"]["requires-python"])
    assert [f"3.{minor}" for minor in range(8, 20) if f"3.{minor}" in allowed] == tested
    (pip,) = (line["pip"] for line in found if isinstance(line, dict))
    assert all((ENVS / line.removeprefix("--requirement ")).is_file() for line in pip)


@pytest.mark.skipif(shutil.which("hadolint") is None, reason="needs hadolint; see the extra `dev`")
def test_hadolint_finds_nothing_in_the_dockerfile():
    done = subprocess.run(["hadolint", str(ENVS / "Dockerfile")], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
