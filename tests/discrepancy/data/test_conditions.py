"""The conditions file is read and written, or rejected with one line that says what is wrong."""

import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.conditions import drive_files, read_conditions


def read(tmp_path, text):
    (tmp_path / "conditions.yaml").write_text(text)
    return read_conditions(tmp_path / "conditions.yaml")["rest"]


@pytest.mark.parametrize("free", ["coronary_resistance_scale", "[coronary_resistance_scale]"])
def test_free_may_be_a_list_or_a_single_name(tmp_path, free):
    assert read(tmp_path, f"rest: {{free: {free}}}").free == ("coronary_resistance_scale",)


@pytest.mark.parametrize("free", ["1", "true", "{bed_shape: 1}", "[pressure]", "pressure"])
def test_unknown_free_parameters_are_rejected(tmp_path, free):
    with pytest.raises(InputError, match="rest.free"):
        read(tmp_path, f"rest: {{free: {free}}}")


def test_a_drive_that_does_not_exist_is_refused_with_its_condition_and_block(tmp_path):
    with pytest.raises(InputError, match=r"conditions\.yaml: rest\.drive\.AORTA = .lost\.csv.: no such file"):
        read(tmp_path, "rest: {drive: {AORTA: lost.csv}}")


def test_every_drive_has_its_own_file():
    """Also on a file system that ignores case, and never in another folder."""
    wanted = [
        ("low dose", "A"),
        ("low_dose", "A"),
        ("a", "b_c"),
        ("a_b", "c"),
        ("A_b", "c"),
        ("../up", "A"),
        ("x", "y"),
    ]
    found = drive_files(wanted)
    assert list(found) == wanted
    assert len({name.lower() for name in found.values()}) == len(wanted)
    assert all(name.count("/") == 1 and ".." not in name for name in found.values())
    assert found["x", "y"] == "drives/x_y.csv"


@pytest.mark.parametrize("scale", [30.0, 0.01])
def test_a_percentage_in_place_of_a_factor_is_rejected(tmp_path, scale):
    with pytest.raises(InputError, match="expected a factor, 0.05 to 20; 0.3 for 30 %"):
        read(tmp_path, f"rest: {{coronary_resistance_scale: {scale}}}")


def test_a_heart_rate_in_place_of_a_factor_on_the_period_is_rejected(tmp_path):
    with pytest.raises(InputError, match="0.75 for 80 instead of 60 beats/min"):
        read(tmp_path, "rest: {period_scale: 120}")


def test_a_number_that_overflows_is_rejected(tmp_path):
    with pytest.raises(InputError, match="expected a number"):
        read(tmp_path, f"rest: {{period_scale: {'9' * 400}}}")


@pytest.mark.parametrize("name", ["'#1'", "' rest'", '"re\\nst"'])
def test_a_condition_name_that_a_csv_cell_cannot_store_is_rejected(tmp_path, name):
    with pytest.raises(InputError, match="invalid condition name"):
        read(tmp_path, f"{name}:\nrest:\n")


def test_a_duplicate_condition_is_rejected(tmp_path):
    (tmp_path / "c.yaml").write_text("rest:\nhyperaemia:\n  coronary_resistance_scale: 0.3\nrest:\n  held_out: true\n")
    with pytest.raises(InputError, match="rest: given twice, in lines 1 and 4"):
        read_conditions(tmp_path / "c.yaml")


def test_an_unknown_key_is_rejected(tmp_path):
    (tmp_path / "c.yaml").write_text("rest:\n  resistance: 2\n")
    with pytest.raises(InputError, match="rest.resistance"):
        read_conditions(tmp_path / "c.yaml")


def test_numbers_may_have_an_exponent_without_a_sign(tmp_path):
    """PyYAML reads 1e3 and 1.0e3 as strings."""
    (tmp_path / "c.yaml").write_text("a: {period_scale: 5e-1, scale: {BED: {R: 1e3, C: 2}}}\n")
    found = read_conditions(tmp_path / "c.yaml")["a"]
    assert (found.period_scale, found.scale) == (0.5, {"BED": {"R": 1000.0, "C": 2.0}})
    for text, message in (
        ("{scale: {BED: {R: two}}}", "a.scale.BED.R = 'two': expected a number"),
        ("{period_scale: '0,65'}", "a.period_scale = '0,65': expected a number, with a point, not a comma"),
        ("{scale: {BED: {R: -0.5}}}", "a.scale.BED.R = -0.5: expected a factor, 0 or more"),
        ("{set: {BED: {R: true}}}", "a.set.BED.R = True: expected a number"),
        ("{period_scale: -1}", "a.period_scale = -1: expected a positive number"),
        ("{period_scale: [1]}", "a.period_scale = [1]: expected a number"),
    ):
        (tmp_path / "c.yaml").write_text(f"a: {text}\n")
        with pytest.raises(InputError) as caught:
            read_conditions(tmp_path / "c.yaml")
        assert str(caught.value).endswith(message)
