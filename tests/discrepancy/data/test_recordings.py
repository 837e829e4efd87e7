"""Recordings become a case, or are rejected with one line that says what is wrong."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.data.recordings import prepare_case
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.network.read import read_network


def recording(folder, name, flow, count=80, period=0.6):
    phase = np.linspace(0.0, 1.0, count)
    frame = {"t abs [s]": 3.0 + period * phase, "AoP [mmHg]": 80 + 20 * np.sin(2 * np.pi * phase)}
    frame |= {
        "LVP [mmHg]": 50 + 50 * np.sin(2 * np.pi * phase),
        "LAD Flow [ml/s]": flow * (1 + 0.2 * np.cos(2 * np.pi * phase)),
    }
    pd.DataFrame(frame).to_csv(folder / f"{name}.csv", index=False)


@pytest.mark.parametrize(("flow", "unit"), [(30.0, "mL/min"), (0.5, "mL/s")])
def test_recordings_of_an_animal_become_a_case(tmp_path, flow, unit):
    for name in ("X1_rest", "X1_baseline", "X1_rest_dob", "X10_baseline"):
        recording(tmp_path, name, flow)
    (tmp_path / "X1_microsphere.csv").write_text("baseline [ml/min/g]\n1.0\n")
    prepare_case(tmp_path, "X1", tmp_path / "case")
    conditions = read_conditions(tmp_path / "case" / "conditions.yaml")
    assert list(conditions) == ["baseline", "rest", "rest_dob"]
    assert [name for name, c in conditions.items() if c.held_out] == ["rest_dob"]
    table = pd.read_csv(tmp_path / "case" / "measurements.csv")
    assert set(table.unit) == {unit}
    network = read_network(tmp_path / "case" / "model.json")
    read_problem(network, tmp_path / "case" / "measurements.csv", conditions, "c", Settings())


def test_interpolated_recordings_are_thinned(tmp_path):
    """Flow readings closer in time than a probe resolves are dropped; the pressures keep all of theirs."""
    for name in ("X1_rest", "X1_baseline"):
        recording(tmp_path, name, 30.0, count=801)
    prepare_case(tmp_path, "X1", tmp_path / "case")
    table = pd.read_csv(tmp_path / "case" / "measurements.csv")
    times = table[(table.condition == "rest") & (table.statistic == "waveform")].time
    assert np.diff(times) == pytest.approx(9 * 0.6 / 800)
    assert len(pd.read_csv(tmp_path / "case" / "drives" / "rest_LV.csv")) == 801


def test_a_truncated_animal_name_is_answered_with_the_full_one(tmp_path):
    for name in ("pig_7_baseline", "pig_7_dob"):
        recording(tmp_path, name, 30.0)
    with pytest.raises(InputError, match=r"pig: no such animal; did you mean pig_7\?"):
        prepare_case(tmp_path, "pig", tmp_path / "case")
    prepare_case(tmp_path, "pig_7", tmp_path / "case")


def test_artery_and_units_are_read_from_the_headings(tmp_path):
    """The same beats with other headings give the same case, except for the name of the artery."""
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 30.0)
        frame = pd.read_csv(tmp_path / f"{name}.csv")
        other = {"Time [ms]": 1000 * frame["t abs [s]"], "LCx flow [mL/min]": frame["LAD Flow [ml/s]"]}
        other |= {f"{p} [kPa]": frame[f"{p} [mmHg]"] * MMHG / 1e4 for p in ("LVP", "AoP")}
        pd.DataFrame(other).to_csv(tmp_path / f"X2_{name[3:]}.csv", index=False)
    prepare_case(tmp_path, "X1", tmp_path / "one")
    prepare_case(tmp_path, "X2", tmp_path / "two")
    one, two = (pd.read_csv(tmp_path / folder / "measurements.csv") for folder in ("one", "two"))
    assert set(two.location) == {"AORTA:lcx"}
    pd.testing.assert_frame_equal(one.drop(columns="location"), two.drop(columns="location"), rtol=1e-12)
    one, two = (read_network(tmp_path / folder / "model.json") for folder in ("one", "two"))
    one, two = (network["boundary_conditions"][0]["bc_values"]["P"] for network in (one, two))
    assert two == pytest.approx(one, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("AoP [mmHg]", "AoP [bar]", "X1_rest.csv: AoP [bar] = 'bar': unknown unit; known: dyn/cm2, mmhg, pa, kpa"),
        ("AoP [mmHg]", "Pa [mmHg]", "X1_rest.csv: AoP [mmHg]: column missing"),
        ("LAD Flow", "LCx Flow", "X1_rest.csv: flow = 'lcx ml/s': the other recordings contain lad ml/s"),
    ],
)
def test_inconsistent_recordings_are_rejected(tmp_path, old, new, message):
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 30.0)
    path = tmp_path / "X1_rest.csv"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError) as caught:
        prepare_case(tmp_path, "X1", tmp_path / "case")
    assert message in str(caught.value)


def exchanged(frame, one, other):
    return frame.assign(**{one: frame[other], other: frame[one]})


def beats(frame, count, share=1.0):
    """A recording of several beats, truncated to a fraction `share` of its length."""
    one = frame.iloc[:-1]
    step = one["t abs [s]"].diff().iloc[1]
    many = pd.concat([one] * count, ignore_index=True)
    many["t abs [s]"] = step * np.arange(len(many))
    return many.iloc[: int(share * len(many))]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: beats(f, 3), "LVP [mmHg]: number of systoles = 3: expected one; cut out one beat"),
        (lambda f: f.iloc[:65], "of its range between start and end; expected one whole beat"),
        (lambda f: f.iloc[: int(0.85 * len(f))], "of its range between start and end; expected one whole beat"),
        (
            lambda f: exchanged(f, "AoP [mmHg]", "LVP [mmHg]"),
            "check whether the two are exchanged",
        ),
        (lambda f: f.assign(**{"LAD Flow [ml/s]": -f["LAD Flow [ml/s]"]}), "change the sign if the probe was reversed"),
        (lambda f: f.assign(**{"AoP [mmHg]": 0.1333 * f["AoP [mmHg]"]}), "outside 20 to 250; check the unit"),
        (
            lambda f: f.assign(**{"t abs [s]": 1000 * f["t abs [s]"]}),
            "outside 0.1 to 3.0 s; give one beat and check the unit of time",
        ),
        (lambda f: f.iloc[[0, 2, 1, *range(3, len(f))]], "line 4: times must increase"),
        (lambda f: f.drop(index=range(20, 50)), "largest gap over the beat = 0.39"),
        (lambda f: f.drop(index=range(20, 26)), "largest gap over the beat = 0.089: expected at most 0.05"),
        (
            lambda f: f.assign(**{"LAD Flow [ml/s]": f["LAD Flow [ml/s]"].where(f.index != 4, np.inf)}),
            "LAD Flow [ml/s] = 'inf': line 6: expected a number",
        ),
        (lambda f: f.rename(columns={c: c.split(" [")[0] for c in f}), "no unit in the heading"),
        (lambda f: exchanged(f, "AoP [mmHg]", "LAD Flow [ml/s]"), "check whether"),
        (lambda f: exchanged(f, "LVP [mmHg]", "LAD Flow [ml/s]"), "check whether columns are exchanged"),
        (
            lambda f: f.assign(**{"AoP [mmHg]": f["AoP [mmHg]"] + 60.0 * (f.index == 30)}),
            "AoP [mmHg] = 153.714: line 32: a spike, 94.8 around it",
        ),
        (
            lambda f: f.assign(**{"LAD Flow [ml/s]": f["LAD Flow [ml/s]"].where(~f.index.isin(range(20, 45)), 0.0)}),
            "LAD Flow [ml/s] = 0.0: from line 22 on for 25 readings: lost or clipped",
        ),
        (
            lambda f: f.assign(**{"AoP [mmHg]": f["AoP [mmHg]"].clip(upper=88.0)}),
            "readings: lost or clipped",
        ),
    ],
)
def test_implausible_recordings_are_rejected(tmp_path, change, message):
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 30.0)
    path = tmp_path / "X1_rest.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)
    with pytest.raises(InputError) as caught:
        prepare_case(tmp_path, "X1", tmp_path / "case")
    assert "X1_rest.csv: " in str(caught.value) and message in str(caught.value)
    assert not (tmp_path / "case").exists()


@pytest.mark.parametrize("name", ["#2", " b"])
def test_a_condition_name_that_a_csv_cell_cannot_store_is_rejected(tmp_path, name):
    for condition in ("baseline", name):
        recording(tmp_path, f"X1_{condition}", 30.0)
    with pytest.raises(InputError, match="invalid condition name"):
        prepare_case(tmp_path, "X1", tmp_path / "case")
    assert not (tmp_path / "case").exists()


def test_a_condition_may_be_called_na(tmp_path):
    for condition in ("baseline", "NA"):
        recording(tmp_path, f"X1_{condition}", 30.0)
    prepare_case(tmp_path, "X1", tmp_path / "case")
    conditions = read_conditions(tmp_path / "case" / "conditions.yaml")
    network = read_network(tmp_path / "case" / "model.json")
    problem = read_problem(network, tmp_path / "case" / "measurements.csv", conditions, "c", Settings())
    assert set(problem.condition) == {"baseline", "NA"}


def test_a_flow_too_small_for_its_unit_is_rejected(tmp_path):
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 0.6)
        path = tmp_path / f"{name}.csv"
        path.write_text(path.read_text().replace("ml/s", "ml/min"))
    with pytest.raises(InputError, match=r"X1: mean flow \(mL/min\) = 0.6.*below the error of a flow reading"):
        prepare_case(tmp_path, "X1", tmp_path / "case")


def test_flows_of_two_units_under_one_heading_are_rejected(tmp_path):
    for name, flow in (("X1_baseline", 0.5), ("X1_rest", 40.0)):
        recording(tmp_path, name, flow)
    with pytest.raises(
        InputError, match=r"X1_baseline.csv: mean flow = 0.501: mL/s as its heading says, or mL/min as 40.1"
    ):
        prepare_case(tmp_path, "X1", tmp_path / "case")


@pytest.mark.parametrize(("rate", "used"), [(110, 110), (151, 151), (300, 150), (1000, 143)])
def test_the_number_of_readings_per_second_is_limited(tmp_path, rate, used):
    for name in ("X1_rest", "X1_baseline"):
        recording(tmp_path, name, 30.0, count=rate + 1, period=1.0)
    prepare_case(tmp_path, "X1", tmp_path / "case")
    table = pd.read_csv(tmp_path / "case" / "measurements.csv")
    assert ((table.condition == "rest") & (table.statistic == "waveform")).sum() == pytest.approx(used, abs=1)


def test_headings_may_have_units_in_round_brackets(tmp_path):
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 30.0)
    path = tmp_path / "X1_rest.csv"
    path.write_text(path.read_text().replace("[", "(").replace("]", ")"))
    prepare_case(tmp_path, "X1", tmp_path / "case")
    assert list(read_conditions(tmp_path / "case" / "conditions.yaml")) == ["baseline", "rest"]


def test_files_of_an_animal_with_a_longer_name_are_not_mixed_in(tmp_path):
    for name in ("dog_baseline", "dog_mild_sten", "dog_2_baseline", "dog_2_mild_sten"):
        recording(tmp_path, name, 30.0)
    with pytest.raises(InputError, match="2_baseline, 2_mild_sten look like conditions of dog_2"):
        prepare_case(tmp_path, "dog", tmp_path / "case")
    prepare_case(tmp_path, "dog_2", tmp_path / "case")


def test_condition_names_do_not_change_the_model(tmp_path):
    """Unless one is called baseline: the model then has its resistance."""
    flows = {"a": 40.0, "b": 20.0, "c": 30.0}
    for animal, order in (("X1", "abc"), ("X2", "cab")):
        for name, of in zip("abc", order, strict=True):
            recording(tmp_path, f"{animal}_{name}", flows[of])
        prepare_case(tmp_path, animal, tmp_path / animal)
    recording(tmp_path, "X2_baseline", flows["a"])
    prepare_case(tmp_path, "X2", tmp_path / "X3")
    one, two, three = (
        read_network(tmp_path / name / "model.json")["boundary_conditions"] for name in ("X1", "X2", "X3")
    )
    assert one == two
    assert one[1]["bc_values"]["Ra1"] / three[1]["bc_values"]["Ra1"] == pytest.approx(flows["a"] / flows["c"], rel=1e-3)


@pytest.mark.parametrize(
    ("names", "held_out", "expected"),
    [
        (("rest", "DOB", "sten_dobutamine", "doberman_x"), None, ["DOB", "sten_dobutamine"]),
        (("rest", "DOB", "sten"), ["sten"], ["sten"]),
        (("a_dob", "b_dob"), None, []),
        (("rest", "DOB"), ["dob"], "held_out = 'dob': no such condition of X1; known: rest, DOB"),
        (("rest", "DOB"), ["DOB", "rest"], "all conditions; leave at least one to be fitted"),
    ],
)
def test_held_out_conditions_are_chosen_by_name_or_listed(tmp_path, names, held_out, expected):
    for name in names:
        recording(tmp_path, f"X1_{name}", 30.0)
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            prepare_case(tmp_path, "X1", tmp_path / "case", held_out)
        return
    prepare_case(tmp_path, "X1", tmp_path / "case", held_out)
    conditions = read_conditions(tmp_path / "case" / "conditions.yaml")
    assert [name for name, c in conditions.items() if c.held_out] == expected


def test_one_condition_is_not_enough(tmp_path):
    recording(tmp_path, "X1_baseline", 30.0)
    with pytest.raises(InputError, match="expected at least two files X1_CONDITION.csv"):
        prepare_case(tmp_path, "X1", tmp_path / "case")
    assert not (tmp_path / "case").exists()


def test_a_missing_folder_is_rejected(tmp_path):
    with pytest.raises(InputError, match="nowhere: no such folder"):
        prepare_case(tmp_path / "nowhere", "X1", tmp_path / "case")
    assert not (tmp_path / "case").exists()


def test_the_recorded_animals_pass(shared, tmp_path):
    for animal in ("DSEA08", "DSEA10"):
        prepare_case(shared / "data" / "perfused-heart", animal, tmp_path / animal)
