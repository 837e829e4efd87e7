"""`coronaryuq check` says what a file is, and reads it as the campaign would."""

import json
import shutil
from pathlib import Path

import pytest

from coronaryuq.cli.main import main
from coronaryuq.core.errors import InputError
from support.case_files import add_measurements, clinical_table, small_tree, write_case

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture
def configuration(tmp_path, monkeypatch):
    """Write a configuration beside a small case, in the current folder."""
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / "given", small_tree())

    def write(text: str) -> str:
        Path("mine.yaml").write_text(text)
        return "mine.yaml"

    return write


def test_a_configuration_is_distinguished_from_a_case_and_its_case_is_read_too(configuration, capsys):
    assert main(["check", configuration("name: mine\nseed: 3\ncase: given/case.yaml\n")]) == 0
    printed = capsys.readouterr().out
    assert "mine.yaml: the configuration of a campaign, whose results are in results/mine" in printed
    assert "settings other than the defaults: seed: 3, case: given/case.yaml" in printed
    assert "case: given/case.yaml\n" in printed and "3 coronary outlets" in printed
    assert main(["check", "given/case.yaml"]) == 0
    assert "configuration" not in capsys.readouterr().out


@pytest.mark.parametrize("shipped", ["smoke", "laptop", "paper"])
def test_the_shipped_configurations_are_sound(shipped, capsys):
    assert main(["check", str(CONFIG / f"{shipped}.yaml")]) == 0
    assert "case: the bundled patient" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("name: x\nsample: {n_3d: 10}\n", "mine.yaml: sample = {'n_3d': 10}: unknown setting; did you mean samples?"),
        ("name: x\nposterior: {draw: 10}\n", "posterior.draw = 10: unknown setting; did you mean draws?"),
        ("name: x\ncase: nowhere.yaml\n", "nowhere.yaml: no such file"),
        ("name: x\ndiscrepancy: {pairs: [a.csv, b.csv]}\n", "discrepancy.pairs = 'a.csv': no such file"),
        ("anatomi: {}\nstenosis: auto\n", "anatomi = {}: unknown field; did you mean anatomy?"),
        ("text\n", "mine.yaml: neither a case nor a configuration"),
    ],
)
def test_a_fault_is_one_line_that_says_what_was_meant(configuration, capsys, text, line):
    assert main(["check", configuration(text)]) == InputError.EXIT_CODE
    printed = capsys.readouterr().err
    assert line in printed and printed.count("\n") == 1


def test_a_fault_in_the_case_of_a_configuration_is_found(configuration, capsys):
    path = configuration("name: mine\ncase: given/case.yaml\n")
    shutil.copy("given/outlets.csv", "given/whole.csv")
    Path("given/outlets.csv").write_text("name,vessel\n")
    assert main(["check", path]) == InputError.EXIT_CODE
    assert "outlets.csv: perfuses: column missing" in capsys.readouterr().err


def test_the_json_holds_the_case_and_the_first_fault(configuration, capsys):
    path = configuration("name: mine\ncase: given/case.yaml\n")
    assert main(["check", path, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["kind"] == "configuration" and found["sound"] and found["error"] is None
    assert found["case"]["outlets"] and found["configuration"]["name"] == "mine"
    assert main(["check", configuration("name: mine\nseed: -1\n"), "--json"]) == InputError.EXIT_CODE
    found = json.loads(capsys.readouterr().out)
    assert not found["sound"] and found["error"]["field"] == "seed" and found["error"]["value"] == "-1"
    assert found["configuration"] is None and found["case"] is None


def test_measurements_of_a_case_are_read_with_its_network(configuration, capsys):
    add_measurements(Path("given/case.yaml"))
    assert main(["check", "given/case.yaml"]) == 0
    assert "measurements: 2 series under rest, stress (held out)" in capsys.readouterr().out
    table = Path("given/measured.csv")
    table.write_text(table.read_text().replace("lca1:BC_lca1", "lca1:BC_lca9"))
    assert main(["check", configuration("name: mine\ncase: given/case.yaml\n")]) == InputError.EXIT_CODE
    assert "the model has no such pressure location; similar: lca1:BC_lca1" in capsys.readouterr().err
    table.unlink()
    assert main(["check", "given/case.yaml"]) == InputError.EXIT_CODE
    assert "measurements.file = 'measured.csv': no such file" in capsys.readouterr().err


def test_all_that_a_clinic_measures_at_rest_and_stress_can_be_given_in_a_case(configuration, capsys):
    """Cuff, phase-contrast and Doppler flows, perfusion, and a pullback under hyperaemia."""
    add_measurements(Path("given/case.yaml"))
    Path("given/measured.csv").write_text(clinical_table())
    assert main(["check", "given/case.yaml"]) == 0
    printed = capsys.readouterr().out
    assert "measurements: 16 series under rest, stress (held out)" in printed
    assert (
        "pullback: 4 readings along branch1_seg0 > lca1_seg0 > lca1_seg1 > lca1_seg2 > lca1 (6 cm) under stress"
        in printed
    )


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (("60,mm", "60,cm"), "distance (mm) = 600.0: expected 0 to 60 mm, the length of branch1_seg0>lca1_seg0>"),
        (("60,mm", "60,"), "distance_unit: expected the unit of distance: mm or cm"),
        (("branch1_seg0>lca1", "LAD"), "location = 'LAD': no such vessel in the network"),
        (("mL/min/g", "mmHg"), "not a unit of perfusion"),
    ],
)
def test_a_fault_in_a_pullback_of_a_case_is_one_line(configuration, capsys, spoil, line):
    add_measurements(Path("given/case.yaml"))
    Path("given/measured.csv").write_text(clinical_table().replace(*spoil))
    assert main(["check", "given/case.yaml"]) == InputError.EXIT_CODE
    printed = capsys.readouterr().err
    assert line in printed and printed.count("\n") == 1


@pytest.mark.parametrize(
    ("condition", "line"),
    [
        ("stress", None),
        ("rst", "measurements.map_condition = 'rst': the table has no mean perfusion of BC_lca1 under it"),
    ],
)
def test_the_condition_of_the_map_has_readings_of_all_targets(configuration, capsys, condition, line):
    add_measurements(Path("given/case.yaml"))
    rca = "stress,perfusion,BC_rca1,mean,,0.9,0.1,mL/min/g\n"
    Path("given/measured.csv").write_text(clinical_table() + rca)
    case = Path("given/case.yaml")
    case.write_text(case.read_text().replace("conditions.yaml}", f"conditions.yaml, map_condition: {condition}}}"))
    assert main(["check", "given/case.yaml"]) == (0 if line is None else InputError.EXIT_CODE)
    assert line is None or line in capsys.readouterr().err
