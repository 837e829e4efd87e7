"""The tutorials: every command runs. Those on a finished smoke campaign are also run in `test_notebook.py`."""

import shutil

import pytest

from support.tutorials import FOLDER, follow

pytestmark = [pytest.mark.workflow, pytest.mark.slow]


@pytest.fixture
def folder(tmp_path):
    """A reader's folder, with the script that the second page has them download."""
    shutil.copy(FOLDER / "practice_project.py", tmp_path)
    return tmp_path


@pytest.mark.long
def test_a_simvascular_project_becomes_a_case_and_a_campaign_starts(folder):
    printed = follow("simvascular-project.md", folder)
    assert "5 coronary outlets (4 LV, 1 RV)" in printed and "stenosis LAD: vessel LAD_2" in printed
    assert "circumflex" in printed and "exit code 2" in printed
    assert (folder / "results/practice/perfusion/targets.json").is_file()


@pytest.mark.long
def test_the_simvascular_project_ends_with_a_report(folder):
    follow("simvascular-project.md", folder, long=True)
    assert (folder / "results/practice/report.html").is_file()


@pytest.mark.long
def test_the_bundled_patient_ends_with_a_report(folder):
    printed = follow("bundled-patient.md", folder, long=True)
    assert "Report: results/smoke/report.html" in printed
