"""Every number of a quantity has the same scale and decimals."""

import pytest

from coronaryuq.estimation.results import Interval
from coronaryuq.report.quantities import Digits, kind_of
from support.estimates import estimator, row


def rows(prefix, *widths):
    return [
        row(column_3d=f"{prefix}{artery}", estimators={"MC": estimator(calibrated=Interval(0.1, 0.1 + width, 0.95))})
        for artery, width in zip(("lad", "lcx", "rca"), widths, strict=False)
    ]


def test_the_widest_interval_of_a_quantity_sets_the_decimals_of_all_arteries():
    found = rows("osi_patch_max_", 0.02, 0.003)
    digits = [Digits(one.column_3d, found) for one in found]
    assert [one(0.16789) for one in digits] == ["0.168", "0.168"] and digits[0].error(0.00456) == "0.0046"


def test_ffr_has_three_decimals_and_an_area_is_in_percent():
    assert Digits("ffr_lad", rows("ffr_", 0.2))(0.84567) == "0.846"
    assert Digits("lowest_ffr_lad", rows("lowest_ffr_", 0.2))(0.84567) == "0.846"
    area = Digits("low_shear_area_lad", rows("low_shear_area_", 0.0005))
    assert area(0.00139) == "0.139" and area.kind.heading == "Low-shear area (%)"


@pytest.mark.parametrize("value", [None, float("nan")])
def test_no_number_is_a_dash(value):
    digits = Digits("ffr_lad", rows("ffr_", 0.2))
    assert digits(value) == digits.error(value) == "–"


def test_an_unknown_column_keeps_its_name():
    assert kind_of("stroke_work_lad").heading == "stroke_work_lad"
