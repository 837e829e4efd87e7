"""Clinical targets are converted to their own units and checked."""

import pytest

from coronaryuq.case.case_json import TargetValue
from coronaryuq.case.tables.read import read_case_targets
from coronaryuq.case.tables.targets import check_targets
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG


def test_targets_are_converted_to_their_own_units_and_unmeasured_ones_left_out():
    given = {
        "PaoMean": TargetValue(value=90.0 * MMHG, unit="dyn/cm2"),
        "EFLV": TargetValue(value=68.0, unit="%"),
        "PraMean": TargetValue(value=None, unit="mmHg"),
    }
    assert check_targets(given, "case.json") == pytest.approx({"PaoMean": 90.0, "EFLV": 0.68})


def test_a_volume_in_mmhg_is_refused():
    with pytest.raises(InputError, match=r"AbsQin\.unit"):
        check_targets({"AbsQin": TargetValue(value=66.0, unit="mmHg")}, "case.json")


def test_a_number_too_large_is_not_taken_for_one_with_a_unit(tmp_path):
    (tmp_path / "targets.csv").write_text("name,value\nAbsQin,1e400\n")
    with pytest.raises(InputError) as error:
        read_case_targets(tmp_path / "targets.csv")
    assert str(error.value).endswith("AbsQin = '1e400': expected a number or none")
