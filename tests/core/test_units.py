"""Units are understood in any usual spelling."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core import units

TABLES = (
    units.LENGTHS,
    units.PRESSURES,
    units.FLOWS,
    units.VOLUMES,
    units.RATIOS,
    units.RATES,
    units.perfusions(),
)


@pytest.mark.parametrize(
    ("unit", "spellings"),
    {
        "mL/min/g": [
            "ml/min/g",
            "mL/(min g)",
            "mL/(min·g)",
            "ml/g/min",
            "cc/min/g",
            "mL per min per g",
            "ml min-1 g-1",
        ],
        "mL/min/100g": ["mL/100g/min", "ml/100 g/min", "mL min^-1 (100 g)^-1", "ML/MIN/100G", "mL·min⁻¹·100g⁻¹"],
        "mL/min/100mL": ["mL/100 mL/min", "ml/100ml/min", "cm3/min/100cm3"],
        "mL/s/g": ["ml/s/g", "ml/(g*s)"],
    }.items(),
)
def test_perfusion_in_every_usual_notation(unit, spellings):
    for written in spellings:
        assert units.standard_unit(written, units.perfusions()) == unit, written


@pytest.mark.parametrize(
    ("table", "written", "unit"),
    [
        (units.PRESSURES, "mm Hg", "mmHg"),
        (units.PRESSURES, "dynes/cm²", "dyn/cm2"),
        (units.FLOWS, "cc/s", "mL/s"),
        (units.FLOWS, "cm^3/s", "cm3/s"),
        (units.FLOWS, "l / min", "L/min"),
        (units.RATES, "beats/min", "1/min"),
        (units.RATES, "BPM", "bpm"),
        (units.LENGTHS, "millimeters", "mm"),
        (units.RATIOS, "", "1"),
    ],
)
def test_other_units_in_usual_spellings(table, written, unit):
    assert table[units.standard_unit(written, table)] == table[unit]


@pytest.mark.parametrize(
    "written", ["", "g/min/mL", "mL/min/kg", "mL/min", "mL/min/g/g", "bar", "-1", "/", "9 mL/min/g"]
)
def test_what_is_no_unit_of_perfusion_is_none(written):
    assert units.standard_unit(written, units.perfusions()) is None


@given(st.sampled_from(TABLES), st.text(alphabet="mMlLgs/100 ()-^·²³⁻¹kPaHz%", max_size=20))
def test_any_text_is_a_known_unit_or_none(table, written):
    assert units.standard_unit(written, table) in (*table, None)


@given(st.sampled_from(TABLES), st.data())
def test_a_known_unit_keeps_its_meaning_in_other_capitals(table, data):
    unit = data.draw(st.sampled_from(sorted(table)))
    written = "".join(data.draw(st.sampled_from((letter.lower(), letter.upper()))) for letter in unit)
    assert table[units.standard_unit(written, table)] == table[unit]


def test_every_share_is_written_with_a_space_before_the_per_cent_sign():
    assert units.percent(0.1875) == "19 %" and units.percent(0.027, 1) == "2.7 %"
    package = Path(units.__file__).parents[1]
    specifications = re.compile(r"\{[^{}\n]*:[^{}\n]*%\}|\d%[ .,;)]")
    assert [
        f"{path.name}: {found}" for path in package.rglob("*.py") for found in specifications.findall(path.read_text())
    ] == []
