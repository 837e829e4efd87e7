"""Stroke volume and mean pressure from whatever was measured, and a note on where they are from."""

import pytest

from coronaryuq.case.case_json import TargetValue
from coronaryuq.case.tables.needed_targets import complete_targets, heart_period
from coronaryuq.core.errors import InputError


def given(**values):
    return {name: TargetValue(value=value) for name, value in values.items()}


@pytest.mark.parametrize(
    ("measured", "stroke", "origin"),
    [
        ({"CO": 4.8}, 64.0, "cardiac output times the period"),
        ({"EDV": 120.0, "ESV": 50.0}, 70.0, "end-diastolic less end-systolic"),
        ({"EDV": 120.0, "EFLV": 0.6}, 72.0, "ejection fraction"),
        ({}, 1000 / 15, "adult at rest"),
    ],
)
def test_stroke_volume_is_completed(measured, stroke, origin):
    targets, notes = complete_targets(given(PaoMean=90.0, **measured), 0.8, "targets.csv")
    assert targets["AbsQin"].value == pytest.approx(stroke) and targets["AbsQin"].unit == "mL"
    (note,) = notes
    assert note.startswith("stroke volume is not given") and origin in note


@pytest.mark.parametrize(("measured", "mean"), [({"PaoMin": 72.0, "PaoMax": 129.0}, 91.0), ({}, 93.0)])
def test_mean_pressure_is_completed(measured, mean):
    targets, notes = complete_targets(given(AbsQin=70.0, **measured), 1.0, "targets.csv")
    assert targets["PaoMean"].value == pytest.approx(mean) and "mean aortic pressure is not given" in notes[0]


def test_what_is_given_is_left_alone():
    targets = given(AbsQin=70.0, PaoMean=90.0, PaoMin=60.0, PaoMax=130.0, CO=4.2)
    assert complete_targets(targets, 1.0, "targets.csv") == (targets, ())


def test_heart_rate_is_the_period():
    assert heart_period(given(HR=75.0), None, "targets.csv") == pytest.approx(0.8)
    assert heart_period(given(HR=75.0), 0.81, "targets.csv") == 0.81
    with pytest.raises(InputError, match=r"HR = 75.0: is a period of 0.8 s, but the period is 1 s"):
        heart_period(given(HR=75.0), 1.0, "targets.csv")


def test_output_and_stroke_volume_that_contradict_each_other_are_refused():
    with pytest.raises(
        InputError, match=r"CO = 7.0: with a period of 1 s is a stroke volume of 117 mL, but AbsQin is 70"
    ):
        complete_targets(given(CO=7.0, AbsQin=70.0, PaoMean=90.0), 1.0, "targets.csv")
