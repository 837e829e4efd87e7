"""Targets files of either unit system mean the same, and wrong ones are named."""

import numpy as np
import pytest

from coronaryuq.calibration.targets import (
    BY_NAME,
    TARGETS,
    TUNED,
    in_own_units,
    misfits,
    read_targets,
)
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG
from coronaryuq.zerod.cardiac_function import MEASURES

TABLE = "PaoMin,Minimum,{min}\nPaoMean,Mean,{mean}\nEFLV,Ejection,0.68\nmitValveTime,Valve,none\nAbsQin,Stroke,66.3\n"


def written(tmp_path, text):
    path = tmp_path / "targets.csv"
    path.write_text(text)
    return path


def test_every_measure_is_a_target_and_every_tuned_target_a_measure():
    assert set(TUNED) == set(MEASURES)
    assert len({target.name for target in TARGETS}) == len(TARGETS)


@pytest.mark.parametrize("unit", [1.0, MMHG])
def test_the_unit_of_pressure_is_found(tmp_path, unit):
    targets = read_targets(written(tmp_path, TABLE.format(min=69 * unit, mean=90 * unit)))
    assert targets == pytest.approx({"PaoMin": 69.0, "PaoMean": 90.0, "EFLV": 0.68, "AbsQin": 66.3})


def test_none_is_skipped(tmp_path):
    assert "mitValveTime" not in read_targets(written(tmp_path, TABLE.format(min=69, mean=90)))


@pytest.mark.parametrize(
    "text, field",
    [
        ("PaoMean,Mean,90\nEFLV,Ejection,68\n", "EFLV"),
        ("PaoMean,Mean,90\nAbsQin,Stroke,0.066\n", "AbsQin"),
        ("PaoMean,Mean,90\nPaoMiddle,Middle,80\n", "PaoMiddle"),
        ("PaoMean,Mean,ninety\n", "PaoMean"),
        ("EFLV,Ejection,0.6\n", "PaoMean"),
    ],
)
def test_a_wrong_value_is_reported_on_one_line(tmp_path, text, field):
    with pytest.raises(InputError) as error:
        read_targets(written(tmp_path, text))
    assert error.value.field == field
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "name,description,value\nPaoMin,Minimum,69\nPaoMean,Mean,90.5\nEFLV,Ejection,0.68\n",
        "PaoMin;Minimum;69\nPaoMean;Mean;90,5\nEFLV;Ejection;0,68\n",
        "PaoMin\tMinimum\t69\nPaoMean\tMean\t90.5\nEFLV\tEjection\t0.68\n",
        "Name,Value,Unit\nPaoMin,9.1992,kPa\nPaoMean,90.5,mmHg\nEFLV,68,%\n",
        "# by hand\nPaoMin,Minimum, as measured by cuff,69\nPaoMean,Mean,90.5\nEFLV,Ejection,0.68\n",
    ],
)
def test_a_table_may_have_a_header_units_and_a_spreadsheet_s_marks(tmp_path, text):
    for encoding in ("utf-8", "utf-16"):
        (tmp_path / "targets.csv").write_bytes(text.encode(encoding))
        targets = read_targets(tmp_path / "targets.csv")
        assert targets == pytest.approx({"PaoMin": 69.0, "PaoMean": 90.5, "EFLV": 0.68}, rel=1e-4)


@pytest.mark.parametrize(
    "text, said",
    [
        ("PaoMean,72\n", "line 1 = 'PaoMean,72': expected name, description, value; or a header with name and value"),
        ("PaoMean,Mean,72 mmHg\n", "PaoMean = '72 mmHg': expected a number or none; put units into a column `unit`"),
        ("PaoMean,Mean,72\nPaoMean,Mean,80\n", "PaoMean = '80': duplicate"),
        (
            "PaoMean,Mean,93\nEFLV,Ejection,61\n",
            "EFLV = 61.0: implausible: 61, expected 0.05 to 0.95; give a fraction, not",
        ),
        ("PaoMin,Min,120\nPaoMean,Mean,93\n", "PaoMin = 120.0: must be below PaoMean, 93"),
        ("name,value,unit\nPaoMean,93,bar\n", "PaoMean.unit = 'bar': expected one of dyn/cm2, mmHg"),
    ],
)
def test_an_error_in_a_table_is_reported(tmp_path, text, said):
    with pytest.raises(InputError) as error:
        read_targets(written(tmp_path, text))
    assert said in str(error.value)


def test_a_misfit_of_one_is_the_tolerance():
    target = BY_NAME["PaoMax"]
    off = misfits({"PaoMax": np.array([120.0, 120.0 * (1 + target.tolerance)])}, {"PaoMax": 120.0})
    assert off["PaoMax"] == pytest.approx([0.0, 1.0])
    absolute = BY_NAME["LThirdFF"]
    off = misfits({"LThirdFF": np.array([0.46 - absolute.tolerance])}, {"LThirdFF": 0.46})
    assert off["LThirdFF"] == pytest.approx([-1.0])


def test_measures_of_a_cgs_network_come_in_the_targets_units():
    assert in_own_units({"PaoMean": np.array([90.0 * MMHG]), "AbsQin": np.array([66.0])}) == {
        "PaoMean": pytest.approx([90.0]),
        "AbsQin": pytest.approx([66.0]),
    }


def test_the_published_table_reads_as_the_patient_it_describes(shared):
    targets = read_targets(shared / "data/closed-loop-22/coronary_cgs.csv")
    assert (targets["PaoMin"], targets["PaoMean"], targets["PaoMax"]) == pytest.approx((69.0, 90.0, 132.0))
    assert targets["AbsQin"] == pytest.approx(targets["EDV"] - targets["ESV"])
    assert "PraMean" not in targets
