"""Results that cannot be written are reported on one line."""

import pytest

from coronaryuq.cli import main
from coronaryuq.core.io.atomic import write_json


def test_a_result_that_cannot_be_written_is_reported_on_one_line(tmp_path, capsys):
    network = {
        "simulation_parameters": {"number_of_cardiac_cycles": 1, "number_of_time_pts_per_cardiac_cycle": 3},
        "boundary_conditions": [
            {"bc_name": "IN", "bc_type": "FLOW", "bc_values": {"t": [0, 1], "Q": [1, 1]}},
            {"bc_name": "OUT", "bc_type": "RESISTANCE", "bc_values": {"R": 1.0, "Pd": 0.0}},
        ],
        "junctions": [],
        "vessels": [
            {
                "vessel_id": 0,
                "vessel_name": "v",
                "boundary_conditions": {"inlet": "IN", "outlet": "OUT"},
                "zero_d_element_type": "BloodVessel",
                "zero_d_element_values": {"R_poiseuille": 1.0},
            }
        ],
    }
    write_json(tmp_path / "n.json", network)
    table = tmp_path / ("x" * 300)
    assert main.main(["solve", str(tmp_path / "n.json"), str(table)]) == 2
    assert capsys.readouterr().err == f"error: {table}: File name too long\n"


@pytest.mark.parametrize("command", ["tune", "fit", "discrepancy"])
def test_a_file_in_place_of_the_results_folder_is_reported_before_the_work(tmp_path, capsys, command):
    (tmp_path / "file").write_text("")
    words = {"tune": ["n.json", "t.csv"], "fit": ["n.json", "t.csv"], "discrepancy": ["--pairs", "s.csv", "m.csv"]}
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        assert main.main([command, *words[command], "--out", str(out)]) == 2
        line = f"error: {out}: expected a folder for results, but {tmp_path / 'file'} is a file\n"
        assert capsys.readouterr().err == line


def test_a_misspelt_target_of_a_campaign_is_answered_with_what_was_meant(capsys):
    assert main.main(["run", "smoke", "report", "results/smoke/report.html", "figurs"]) == 2
    assert capsys.readouterr().err == (
        "error: command line: TARGET = 'figurs': unknown; did you mean figures? see README.md\n"
    )
