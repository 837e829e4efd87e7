"""The section on adoption: what, where, how large, from where, and the prediction before and after; or why nothing."""

import pytest

from coronaryuq.core.io.atomic import write_json
from coronaryuq.report.adoption import adopted, labels

SIZE = {"name": "loss", "meaning": "a loss", "unit": "1", "value": 0.34, "low": 0.26, "high": 0.45}
ONE = {
    "effect": "quadratic_stenosis", "place": "rca6", "probability": 0.9, "sizes": [SIZE], "refused": "",
    "measurement": False,
}  # fmt: skip
OTHER = ONE | {"effect": "pressure_offset", "probability": 0.1, "refused": "an error of a sensor", "measurement": True}
FFR = {"median": 0.81, "low": 0.73, "high": 0.858, "zones": [0.1, 0.315, 0.585], "failed": 0}
FOUND = {
    "adopted": True, "targets_corrected": False, "reason": "",
    "classes": [{"members": [ONE, OTHER], "source": "search of 777 fitted values"}],
    "gap": {when: {"misfit": x, "interval_90": [x - 0.1, x + 0.1]} for when, x in (("before", 1.7), ("after", 0.9))},
    "held_out": ["half dilated"], "scheme": "held out", "zones": [0.75, 0.8], "not_in_3d": {}, "in_lumen": {},
    "samples": {"before": 200, "after": 200},
    "ffr": [{"branch": "RCA", "before": FFR, "after": FFR | {"median": 0.87, "zones": [0.0, 0.0, 1.0]}}],
}  # fmt: skip


@pytest.fixture
def section(tmp_path):
    def of(invented=False, **changes):
        write_json(tmp_path / "comparison.json", FOUND | changes)
        return adopted({"adoption": str(tmp_path / "comparison.json")}, invented=invented)

    return of


def test_it_says_what_was_adopted_with_interval_and_source_and_both_predictions(section):
    found = section()
    first, second = found["classes"][0]
    assert first["sizes"] == "loss 0.34 (0.26 to 0.45)" and first["source"] == "search of 777 fitted values"
    assert first["became"] == "adopted in 0D and the 0D side of 3D" and second["became"] == "an error of a sensor"
    assert "1.70 (1.60 to 1.80) before, 0.90 (0.80 to 1.00) with" in found["gap"]
    (row,) = found["rows"]
    assert row["before"]["ffr"] == "0.810 (0.730 to 0.858)" and row["after"]["zones"] == ["0 %", "0 %", "100 %"]
    assert found["zones"] == ["FFR ≤ 0.75", "0.75 < FFR ≤ 0.80", "FFR > 0.80"]
    assert not found["not_in_3d"] and not found["in_lumen"] and "nothing about the patient" not in found["text"]


def test_an_invented_effect_is_not_presented_as_one_of_the_patient(section):
    assert section(invented=True)["text"].startswith("This tests the loop on invented data")


@pytest.mark.parametrize("network", [True, False])
def test_target_flows_without_an_error_of_the_map_are_said_and_the_prediction_is_another_one(section, network):
    found = section(adopted=network, targets_corrected=True)
    assert "target flows are those of the perfusion map without its error" in found["text"]
    assert ("became part" in found["text"]) == network or "No effect became part" in found["text"]
    assert found["note"].startswith("200 samples each")


def test_what_3d_cannot_have_is_said(section):
    found = section(not_in_3d={"quadratic stenosis at rca6": "it lies inside the 3D domain"})
    assert found["classes"][0][0]["became"] == "adopted in 0D alone"
    assert "do not contain" in found["not_in_3d"]


def test_what_the_lumen_of_3d_has_is_said_with_its_place(section):
    found = section(in_lumen={"quadratic stenosis at rca6": "in the middle of rca6; place and length are assumed"})
    assert found["classes"][0][0]["became"] == "adopted in 0D and the lumen of 3D" and not found["not_in_3d"]
    assert "has: quadratic stenosis at rca6, in the middle of rca6; place and length are assumed." in found["in_lumen"]


def test_nothing_adopted_gives_the_reason_and_no_comparison(section):
    found = section(adopted=False, reason="the answer of the search is “nothing”, which names no effect", classes=[])
    assert "“nothing”" in found["text"] and "its own" in found["text"] and found["note"] == ""


def test_without_adoption_there_is_no_section(tmp_path):
    assert adopted({}, invented=False) == {"text": ""} and labels({}) == {}


def test_columns_of_theta_have_labels(tmp_path):
    write_json(tmp_path / "comparison.json", FOUND)
    assert labels({"adoption": str(tmp_path / "comparison.json")}) == {
        "missing_1_size": "size of the quadratic stenosis",
        "missing_1_member": "whether it is the quadratic stenosis",
    }
