"""A pullback is read along a named path of vessels, and rejected with one line that says what is wrong."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy.pullback_cases import PATH, VESSELS, model
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.conditions import Condition, PullbackErrors, as_entry, read_conditions
from coronaryuq.discrepancy.data.pullbacks import has_pullback, path_of
from coronaryuq.discrepancy.inference.pullback_errors import independent_sd
from coronaryuq.discrepancy.inference.read_problem import read_series
from coronaryuq.zerod.effects.pullback import CHECK
from coronaryuq.zerod.effects.searchable import check_searchable

LENGTH = 125.0
CONDITIONS = {name: Condition(name) for name in ("rest", "hyperaemia")}


def table(distances=(120.0, 80.0, 40.0, 0.0), **changes) -> pd.DataFrame:
    """A pullback in the order of its recording, distances in mm."""
    count = len(distances)
    columns = {
        "condition": "hyperaemia", "quantity": "pressure", "location": PATH, "statistic": "mean", "time": np.nan,
        "distance": distances, "distance_unit": "mm", "value": np.linspace(70.0, 90.0, count), "sd": 1.5,
        "unit": "mmHg",
    }  # fmt: skip
    return pd.DataFrame(columns | changes, index=range(count))


def row(**values) -> pd.DataFrame:
    return table((0.0,), **({"distance": np.nan, "distance_unit": "", "location": "lad:BC_lad"} | values))


@pytest.fixture
def read(tmp_path):
    def run(*tables: pd.DataFrame, conditions=CONDITIONS):
        path = tmp_path / "measurements.csv"
        pd.concat(tables).to_csv(path, index=False)
        return read_series(model(), path, conditions, "conditions.yaml")

    return run


def test_a_pullback_is_one_series_from_the_start_of_its_path(read):
    pressure, pullback = read(row(condition="rest"), table())
    assert pressure.pullback is None and pullback.quantity == "pullback pressure"
    assert pullback.pullback.path == tuple(VESSELS) and pullback.pullback.length == pytest.approx(12.5)
    assert pullback.pullback.distance == pytest.approx([0.0, 4.0, 8.0, 12.0])
    assert pullback.value == pytest.approx(MMHG * np.linspace(90.0, 70.0, 4))


def test_distances_may_be_in_cm_and_start_at_any_vessel(read):
    (pullback,) = read(table((0.0, 1.0, 2.9), location="lad", distance_unit="cm"))
    assert pullback.pullback.path == ("lad",) and pullback.pullback.distance == pytest.approx([0.0, 1.0, 2.9])


def test_without_times_the_drift_grows_as_the_wire_is_pulled_back(read):
    """Half of the time to the end has passed when the pullback begins at its distal end, unless `begins` says more."""
    (pullback,) = read(table((120.0, 60.0, 0.0)))
    assert pullback.pullback.response / MMHG == pytest.approx([1.0, 0.75, 0.5])
    late = {"hyperaemia": Condition("hyperaemia", pullback=PullbackErrors(begins=0.8))}
    (pullback,) = read(table((120.0, 60.0, 0.0)), conditions=late)
    assert pullback.pullback.response / MMHG == pytest.approx([1.0, 0.9, 0.8])


def test_with_times_the_drift_is_linear_since_equalisation_until_the_check(read):
    check = row(quantity="drift", location=PATH, time=200.0, value=2.0, sd=0.5)
    pullback, checked = read(table((120.0, 60.0, 0.0), time=[100.0, 120.0, 150.0]), check)
    assert pullback.pullback.response / MMHG == pytest.approx([0.75, 0.6, 0.5])
    assert checked.quantity == CHECK and checked.pullback.response / MMHG == pytest.approx([1.0])
    assert checked.value == pytest.approx([2.0 * MMHG])
    (pullback,) = read(table((120.0, 60.0, 0.0), time=[100.0, 120.0, 150.0]))
    assert pullback.pullback.response[0] / MMHG == pytest.approx(1.0)


def test_readings_slightly_beyond_the_path_do_not_share_all_of_their_noise(read):
    """Moved to its end they did, and the noise of all readings was then taken to be independent."""
    (pullback,) = read(table((125.4, 125.2, 120.0, 60.0, 0.0)))
    assert len(np.unique(pullback.pullback.distance)) == 5
    alone = independent_sd(pullback) / pullback.sd
    assert 0.05 < alone[0] < 0.5 and alone == pytest.approx(alone[0])


def test_pullbacks_of_two_arteries_may_share_vessels(read):
    lad, lcx = read(table(), table((40.0, 20.0, 0.0), location="left_main>lcx"))
    assert lad.pullback.path[0] == lcx.pullback.path[0] == "left_main"


@given(st.lists(st.sampled_from(list(VESSELS)), min_size=1, max_size=4, unique=True))
def test_a_path_is_filled_and_runs_downstream(named):
    def fail(field, value, remedy):
        raise ValueError(remedy)

    order = [list(VESSELS).index(name) for name in named]
    if order != sorted(order):
        with pytest.raises(ValueError, match="is not downstream of"):
            path_of(Topology(model()), ">".join(named), fail)
    else:
        assert path_of(Topology(model()), " > ".join(named), fail) == tuple(VESSELS)[order[0] : order[-1] + 1]


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ([table((130.0, 60.0, 0.0))], "line 2: distance (mm) = 130.0: expected 0 to 125 mm, the length of left_main>"),
        ([table((12.0, 6.0, -1.0))], "line 4: distance (mm) = -1.0: expected 0 to 125 mm"),
        ([table((12.0, 6.0, 0.0), distance_unit="cm", location="lad")], "= 120.0: expected 0 to 30 mm"),
        ([table((120.0, 60.0, 0.0, 110.0))], "line 5: distance (mm) = 110.0: turns round or repeats; give one"),
        ([table((120.0, 60.0, 60.0, 0.0))], "line 4: distance (mm) = 60.0: turns round or repeats"),
        ([table(), table((30.0, 20.0, 0.0), location="lad")], "line 6: location = 'lad': another pullback to lad"),
        ([table(), table(quantity="ratio", value=0.9, sd=0.02, unit="1")], "another pullback to lad under hyperaemia"),
        ([table(), table(statistic="min")], "keep one, with one statistic"),
        ([table(distance_unit="")], "line 2: distance_unit: expected the unit of distance: mm or cm"),
        ([table(distance_unit="inch")], "line 2: distance_unit = 'inch': expected the unit of distance"),
        ([table().drop(columns="distance_unit")], "line 2: distance_unit: expected the unit of distance: mm or cm"),
        ([table().drop(columns="distance")], "line 2: distance = nan: expected the distance along the centreline"),
        ([table(distance=[120.0, np.nan, 40.0, 0.0])], "line 3: distance = nan: expected the distance"),
        ([table((60.0, 0.0))], "line 2: distance = 2: a pullback needs at least 3 readings"),
        ([table(location="lad_seg4")], "line 2: location = 'lad_seg4': no such vessel in the network; did you mean"),
        ([table(location="lcx>lad")], "lad is not downstream of lcx; name vessels from proximal to distal"),
        ([table(location="lad:BC_lad")], "no such vessel in the network"),
        ([table(quantity="flow", unit="mL/s")], "line 2: distance = 120.0: only the pressure or ratio of a pullback"),
        ([table(statistic="waveform")], "line 2: statistic = 'waveform': a pullback has mean, min or max"),
        ([table(quantity="ratio", statistic="min", unit="1")], "a ratio is that of mean pressures; use mean"),
        ([table(time=[1.0, 2.0, np.nan, 4.0])], "line 2: time: some readings of this pullback have a time"),
        ([table(time=[-1.0, 2.0, 3.0, 4.0])], "line 2: time = -1.0: expected s since equalisation"),
        ([row(quantity="drift", location=PATH, value=1.0)], "drift: location = 'left_main>lad': no pullback of"),
        ([table(), row(quantity="drift", location=PATH, statistic="max")], "a drift check is a difference of mean"),
    ],
)  # fmt: skip
def test_a_fault_is_one_line(read, tables, words):
    with pytest.raises(InputError) as raised:
        read(*tables)
    assert words in str(raised.value) and "\n" not in str(raised.value)


def test_a_vessel_without_a_length_cannot_be_pulled_through(tmp_path):
    network = model()
    del network.vessel("lad_seg1")["vessel_length"]
    table().to_csv(tmp_path / "m.csv", index=False)
    with pytest.raises(InputError, match=r"the network has no vessel_length \(cm\) of lad_seg1; add it"):
        read_series(network, tmp_path / "m.csv", CONDITIONS, "conditions.yaml")


def test_names_must_not_contain_the_separator_of_a_path():
    network = model()
    network.vessel("lcx")["vessel_name"] = "lcx>2"
    with pytest.raises(InputError, match="expected a name without '>'"):
        check_searchable(network, "model.json")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("{drift: 2}", "rest.pullback = {'drift': 2}: expected a mapping; known: drift_sd, noise_length, begins"),
        ("3", "rest.pullback = 3: expected a mapping"),
        ("{drift_sd: 0}", "rest.pullback.drift_sd = 0.0: expected a positive number"),
        ("{begins: 1.5}", "rest.pullback.begins = 1.5: expected a positive number up to 1"),
    ],
)
def test_faults_of_the_errors_of_a_pullback(tmp_path, keys, words):
    (tmp_path / "c.yaml").write_text(f"rest: {{pullback: {keys}}}\n")
    with pytest.raises(InputError) as raised:
        read_conditions(tmp_path / "c.yaml")
    assert words in str(raised.value)


def test_the_errors_of_a_pullback_are_written_as_read(tmp_path):
    (tmp_path / "c.yaml").write_text("rest: {pullback: {drift_sd: 2, noise_length: 8}}\nhyperaemia:\n")
    found = read_conditions(tmp_path / "c.yaml")
    assert found["rest"].pullback == PullbackErrors(2.0, 8.0, 0.5)
    assert as_entry(found["rest"])["pullback"] == {"drift_sd": 2.0, "noise_length": 8.0, "begins": 0.5}
    assert "pullback" not in as_entry(found["hyperaemia"])


def test_a_table_shows_whether_it_has_a_pullback(tmp_path):
    table().to_csv(tmp_path / "pulled.csv", index=False)
    row().to_csv(tmp_path / "none.csv", index=False)
    assert has_pullback(tmp_path / "pulled.csv") and not has_pullback(tmp_path / "none.csv")
    assert not has_pullback(tmp_path / "missing.csv")
