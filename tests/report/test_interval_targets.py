"""Whether target widths were reached, why a campaign stopped, and the cost of half the width."""

import json

import pytest

from coronaryuq.report.interval_targets import sentences
from support.estimates import estimator, row

ROWS = [
    row(row=name, label=f"FFR, FFR, {name}", recommended="MFMC", estimators={"MFMC": estimator(method="MFMC")})
    for name in ("LAD", "LCx")
]
MET = {
    "row": "LAD",
    "target": 0.01,
    "half_width": 0.0081,
    "more_3d": 0,
    "more_0d": 0,
    "cost": 0.0,
    "cost_of_half": 61.24,
}
SHORT = {
    "row": "LCx",
    "target": 0.002,
    "half_width": 0.004,
    "more_3d": 1077,
    "more_0d": 20,
    "cost": 1077,
    "cost_of_half": 400,
}


@pytest.fixture
def written(tmp_path):
    def write(plan, ended=None):
        (tmp_path / "budget.json").write_text(json.dumps({"budget": [], "plan": plan}))
        (tmp_path / "round.json").write_text(json.dumps(ended))
        return str(tmp_path / "budget.json"), str(tmp_path / "round.json") if ended else None

    return write


def test_a_reached_and_a_missed_width_are_reported(written):
    met, short = sentences(ROWS, *written([MET, SHORT]))
    assert met["met"] and met["text"] == (
        "FFR, FFR, LAD: ± 0.01 targeted, ± 0.0081 reached by MFMC. "
        "Half the target width, ± 0.005, would cost about 61 more 3D runs."
    )
    assert not short["met"] and "reached by MFMC; this needs about 1,077 3D runs and 20 0D runs more." in short["text"]


@pytest.mark.parametrize(
    ("why", "text"), [("met", "all target widths"), ("bounds reached", "max_3d"), ("rounds exhausted", "rounds")]
)
def test_a_campaign_that_grew_reports_why_it_stopped(written, why, text):
    counts = {"n_3d": 48, "n_0d": 400}
    ended = {"round": 1, "counts": counts, "plan": [], "next": counts, "done": True, "why": why}
    (last,) = sentences(ROWS, *written([], ended))
    assert "in round 2 with 48 3D and 400 propagation runs" in last["text"] and text in last["text"]
    assert last["met"] == (why == "met")


def test_without_target_widths_there_are_no_lines(written):
    assert sentences(ROWS, *written([])) == []
