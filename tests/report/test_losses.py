"""Losses learnt from 3D on the report."""

import json

from coronaryuq.case.network.network_names import InWords
from coronaryuq.report.losses import learnt


def test_errors_in_runs_left_out_and_certain_losses_are_shown(tmp_path):
    rms = {"before": 0.0167, "after": 0.0006, "left_out": 0.0008}
    (tmp_path / "fit.json").write_text(json.dumps({"runs": 8, "rms": {"LAD": rms, "cap": rms}}))
    (tmp_path / "losses.csv").write_text(
        "vessels,loss,own_mmhg,added_mmhg,added_sd_mmhg,meaning\n"
        "a_seg0 b2,linear,3.37,-0.94,0.17,less friction than a straight tube's\na b,quadratic,10.8,0.1,0.2,\n"
    )
    files = {"losses_fit": str(tmp_path / "fit.json"), "losses": str(tmp_path / "losses.csv")}
    found = learnt(files, ["LAD"], InWords({}, {}))
    assert "by 0.0167 (LAD; root mean square)" in found["sentence"] and "0.0008" in found["sentence"]
    (row,) = found["rows"]
    (row_named,) = learnt(files, ["LAD"], InWords({"a": "LAD", "b2": "LAD"}, {}))["rows"]
    assert row_named["where"] == "LAD (part 1)"
    assert row["where"] == "a_seg0, b2" and row["added"] == "-0.94 ± 0.17" and row["own"] == "3.37"


def test_without_3d_runs_that_teach_there_is_nothing_to_show():
    assert learnt({}, ["LAD"], InWords({}, {})) == {"sentence": "", "rows": []}
