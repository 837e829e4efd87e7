"""Command lines: results that cannot be written, targets and options of `run`."""

import pytest

from coronaryuq.cli import main, run
from coronaryuq.cli.snakemake_run import Command
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


@pytest.mark.parametrize(
    ("words", "targets", "more"),
    [
        ("smoke posterior --cores 2", ["posterior"], []),
        ("smoke --cores 2 posterior figures", ["posterior", "figures"], []),
        ("smoke report --cores 2 posterior", ["report", "posterior"], []),
        ("smoke --cores 2 -- posterior", ["posterior"], []),
        ("smoke --cores 2 -- posterior --keep-going", ["posterior"], ["--keep-going"]),
        ("smoke posterior -- --until posterior", ["posterior"], ["--until", "posterior"]),
        ("--cores 2 smoke posterior", ["posterior"], []),
    ],
)
def test_targets_of_run_may_stand_where_those_of_snakemake_may(monkeypatch, words, targets, more):
    given = []
    monkeypatch.setattr(run, "run", lambda configuration, targets, **options: given.append((targets, options)) or 0)
    assert main.main(["run", *words.split()]) == 0
    ((found, options),) = given
    assert found == targets and options["more"] == more


def test_an_unknown_option_of_run_is_told(capsys):
    with pytest.raises(SystemExit):
        main.main(["run", "smoke", "posterior", "--corse", "2"])
    assert "unrecognized arguments: --corse 2; did you mean --cores?" in capsys.readouterr().err


def test_words_for_snakemake_follow_no_option_that_takes_them(tmp_path):
    command = Command(tmp_path / "c.yaml", ["report"], "2", None, ["figures"])
    assert command.words("--quiet", "all")[-5:] == ["--cores", "2", "figures", "--", "report"]
