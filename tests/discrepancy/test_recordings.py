"""Recordings of an animal as a case: headings, units, beats, names of conditions."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.data.recordings import prepare
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
    prepare(tmp_path, "X1", tmp_path / "case")
    conditions = read_conditions(tmp_path / "case" / "conditions.yaml")
    assert list(conditions) == ["baseline", "rest", "rest_dob"]
    assert [name for name, c in conditions.items() if c.held_out] == ["rest_dob"]
    table = pd.read_csv(tmp_path / "case" / "measurements.csv")
    assert set(table.unit) == {unit}
    network = read_network(tmp_path / "case" / "model.json")
    read_problem(network, tmp_path / "case" / "measurements.csv", conditions, "c", Settings())


def test_curves_drawn_through_recordings_say_no_more_than_those(tmp_path):
    """Readings closer in time than a flow probe tells apart are left out; the pressures keep all of theirs."""
    for name in ("X1_rest", "X1_baseline"):
        recording(tmp_path, name, 30.0, count=801)
    prepare(tmp_path, "X1", tmp_path / "case")
    table = pd.read_csv(tmp_path / "case" / "measurements.csv")
    times = table[(table.condition == "rest") & (table.statistic == "waveform")].time
    assert np.diff(times) == pytest.approx(9 * 0.6 / 800)
    assert len(pd.read_csv(tmp_path / "case" / "drives" / "rest_LV.csv")) == 801


def test_an_animal_whose_name_was_cut_short(tmp_path):
    for name in ("pig_7_baseline", "pig_7_dob"):
        recording(tmp_path, name, 30.0)
    with pytest.raises(InputError, match=r"pig: no such animal; did you mean pig_7\?"):
        prepare(tmp_path, "pig", tmp_path / "case")
    prepare(tmp_path, "pig_7", tmp_path / "case")


def test_recordings_of_another_artery_in_other_units(tmp_path):
    """The same beats under other headings make the same case, but for the artery's name."""
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 30.0)
        frame = pd.read_csv(tmp_path / f"{name}.csv")
        other = {"Time [ms]": 1000 * frame["t abs [s]"], "LCx flow [mL/min]": frame["LAD Flow [ml/s]"]}
        other |= {f"{p} [kPa]": frame[f"{p} [mmHg]"] * MMHG / 1e4 for p in ("LVP", "AoP")}
        pd.DataFrame(other).to_csv(tmp_path / f"X2_{name[3:]}.csv", index=False)
    prepare(tmp_path, "X1", tmp_path / "one")
    prepare(tmp_path, "X2", tmp_path / "two")
    one, two = (pd.read_csv(tmp_path / folder / "measurements.csv") for folder in ("one", "two"))
    assert set(two.location) == {"AORTA:lcx"}
    pd.testing.assert_frame_equal(one.drop(columns="location"), two.drop(columns="location"), rtol=1e-12)
    one, two = (read_network(tmp_path / folder / "model.json") for folder in ("one", "two"))
    one, two = (network["boundary_conditions"][0]["bc_values"]["P"] for network in (one, two))
    assert two == pytest.approx(one, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("AoP [mmHg]", "AoP [bar]", "X1_rest.csv: AoP [bar] = 'bar': know dyn/cm2, mmhg, pa, kpa"),
        ("AoP [mmHg]", "Pa [mmHg]", "X1_rest.csv: AoP [mmHg]: column missing"),
        ("LAD Flow", "LCx Flow", "X1_rest.csv: flow = 'lcx ml/s': the other recordings hold lad ml/s"),
    ],
)
def test_recordings_that_do_not_agree(tmp_path, old, new, said):
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 30.0)
    path = tmp_path / "X1_rest.csv"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError) as caught:
        prepare(tmp_path, "X1", tmp_path / "case")
    assert said in str(caught.value)


def beats(frame, count, share=1.0):
    """A recording of so many beats, of which the last is cut."""
    one = frame.iloc[:-1]
    step = one["t abs [s]"].diff().iloc[1]
    many = pd.concat([one] * count, ignore_index=True)
    many["t abs [s]"] = step * np.arange(len(many))
    return many.iloc[: int(share * len(many))]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: beats(f, 3), "LVP [mmHg] = 3: systoles in the recording; cut out one beat"),
        (lambda f: f.iloc[:65], "of its range from end to start; want one whole beat"),
        (
            lambda f: f.assign(**{"AoP [mmHg]": f["LVP [mmHg]"], "LVP [mmHg]": f["AoP [mmHg]"]}),
            "are the two exchanged?",
        ),
        (lambda f: f.assign(**{"LAD Flow [ml/s]": -f["LAD Flow [ml/s]"]}), "turn the sign if the probe was reversed"),
        (lambda f: f.assign(**{"AoP [mmHg]": 0.1333 * f["AoP [mmHg]"]}), "want 20 to 250; see its unit"),
        (
            lambda f: f.assign(**{"t abs [s]": 1000 * f["t abs [s]"]}),
            "want one beat, 0.1 to 3.0 s; see the unit of time",
        ),
        (lambda f: f.iloc[[0, 2, 1, *range(3, len(f))]], "line 4: times must increase"),
        (lambda f: f.drop(index=range(20, 50)), "= '39%': of the beat without a reading"),
        (
            lambda f: f.assign(**{"LAD Flow [ml/s]": f["LAD Flow [ml/s]"].where(f.index != 4, np.inf)}),
            "LAD Flow [ml/s] = 'inf': line 6: want a number",
        ),
        (lambda f: f.rename(columns={c: c.split(" [")[0] for c in f}), "no unit in the heading"),
    ],
)
def test_recordings_that_are_no_beat_of_a_coronary_artery(tmp_path, change, said):
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 30.0)
    path = tmp_path / "X1_rest.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)
    with pytest.raises(InputError) as caught:
        prepare(tmp_path, "X1", tmp_path / "case")
    assert "X1_rest.csv: " in str(caught.value) and said in str(caught.value)
    assert not (tmp_path / "case").exists()


@pytest.mark.parametrize("name", ["#2", " b"])
def test_a_condition_that_its_table_could_not_hold(tmp_path, name):
    for condition in ("baseline", name):
        recording(tmp_path, f"X1_{condition}", 30.0)
    with pytest.raises(InputError, match="not a condition's name"):
        prepare(tmp_path, "X1", tmp_path / "case")
    assert not (tmp_path / "case").exists()


def test_a_condition_called_na(tmp_path):
    for condition in ("baseline", "NA"):
        recording(tmp_path, f"X1_{condition}", 30.0)
    prepare(tmp_path, "X1", tmp_path / "case")
    conditions = read_conditions(tmp_path / "case" / "conditions.yaml")
    network = read_network(tmp_path / "case" / "model.json")
    problem = read_problem(network, tmp_path / "case" / "measurements.csv", conditions, "c", Settings())
    assert set(problem.condition) == {"baseline", "NA"}


def test_flow_in_another_unit_than_is_headed(tmp_path):
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 0.6)
        path = tmp_path / f"{name}.csv"
        path.write_text(path.read_text().replace("ml/s", "ml/min"))
    with pytest.raises(InputError, match="X1: flow = 0.6.*less than the error of such a flow"):
        prepare(tmp_path, "X1", tmp_path / "case")


@pytest.mark.parametrize(("rate", "used"), [(110, 110), (151, 151), (300, 150), (1000, 143)])
def test_readings_that_are_used_of_a_second(tmp_path, rate, used):
    for name in ("X1_rest", "X1_baseline"):
        recording(tmp_path, name, 30.0, count=rate + 1, period=1.0)
    prepare(tmp_path, "X1", tmp_path / "case")
    table = pd.read_csv(tmp_path / "case" / "measurements.csv")
    assert ((table.condition == "rest") & (table.statistic == "waveform")).sum() == pytest.approx(used, abs=1)


def test_headings_may_have_units_in_round_brackets(tmp_path):
    for name in ("X1_baseline", "X1_rest"):
        recording(tmp_path, name, 30.0)
    path = tmp_path / "X1_rest.csv"
    path.write_text(path.read_text().replace("[", "(").replace("]", ")"))
    prepare(tmp_path, "X1", tmp_path / "case")
    assert list(read_conditions(tmp_path / "case" / "conditions.yaml")) == ["baseline", "rest"]


def test_files_of_an_animal_whose_name_begins_the_same_are_not_taken_for_its_own(tmp_path):
    for name in ("dog_baseline", "dog_mild_sten", "dog_2_baseline", "dog_2_mild_sten"):
        recording(tmp_path, name, 30.0)
    with pytest.raises(InputError, match="2_baseline, 2_mild_sten look like conditions of dog_2"):
        prepare(tmp_path, "dog", tmp_path / "case")
    prepare(tmp_path, "dog_2", tmp_path / "case")


def test_names_of_conditions_do_not_decide_what_the_model_is(tmp_path):
    """Unless one is called baseline: then the model has its resistance."""
    flows = {"a": 40.0, "b": 20.0, "c": 30.0}
    for animal, order in (("X1", "abc"), ("X2", "cab")):
        for name, of in zip("abc", order, strict=True):
            recording(tmp_path, f"{animal}_{name}", flows[of])
        prepare(tmp_path, animal, tmp_path / animal)
    recording(tmp_path, "X2_baseline", flows["a"])
    prepare(tmp_path, "X2", tmp_path / "X3")
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
        (("rest", "DOB"), ["dob"], "held_out = 'dob': no such condition of X1; know rest, DOB"),
        (("rest", "DOB"), ["DOB", "rest"], "all conditions; leave one at least to be fitted"),
    ],
)
def test_conditions_kept_out_of_the_fits(tmp_path, names, held_out, expected):
    for name in names:
        recording(tmp_path, f"X1_{name}", 30.0)
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            prepare(tmp_path, "X1", tmp_path / "case", held_out)
        return
    prepare(tmp_path, "X1", tmp_path / "case", held_out)
    conditions = read_conditions(tmp_path / "case" / "conditions.yaml")
    assert [name for name, c in conditions.items() if c.held_out] == expected


def test_recordings_of_one_condition_are_too_few(tmp_path):
    recording(tmp_path, "X1_baseline", 30.0)
    with pytest.raises(InputError, match="X1_CONDITION.csv of two conditions"):
        prepare(tmp_path, "X1", tmp_path / "case")
    assert not (tmp_path / "case").exists()


def test_a_folder_of_recordings_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="nowhere: no such folder"):
        prepare(tmp_path / "nowhere", "X1", tmp_path / "case")
    assert not (tmp_path / "case").exists()
