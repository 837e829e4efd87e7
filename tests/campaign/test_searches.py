"""The cases that the discrepancy search examines."""

import pytest

from coronaryuq.campaign.paths import Paths
from coronaryuq.campaign.searches import Searches
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.settings import Settings


def searches(bundled=True, **settings):
    return Searches(Settings(**settings), Paths("x"), "results/x/calibration/rest.json", bundled)


def test_nothing_is_hidden_in_the_loop_of_a_patient():
    assert searches(bundled=False).names == [] and searches(bundled=False, in_report=True).answers == []
    with pytest.raises(InputError, match="nothing to search: name measurements"):
        searches(bundled=False).required()


def test_without_inputs_an_effect_is_hidden_in_the_bundled_loop():
    hidden = searches()
    assert hidden.names == ["hidden"] and hidden.answers == ["results/x/discrepancy/hidden/found/discrepancy.json"]
    assert hidden.tables["hidden", "gap"] == "results/x/discrepancy/hidden/known/gap.csv"
    assert "hidden_size" in hidden.block(hiding=True) and "hidden_size" not in hidden.block(hiding=False)


def test_figures_of_the_patients_network_have_the_names_of_its_case(tmp_path):
    """Not those of another network, in which the same name may be another vessel."""
    anatomy = {"case": "results/x/case/case.json", "tree": "results/x/case/tree.vtp"}
    own = searches()
    assert own.drawn_from("hidden", "ranking") == {"table": own.tables["hidden", "ranking"]} | anatomy
    assert own.drawn_from("hidden", "gap") == {"table": own.tables["hidden", "gap"]}
    given = {name: str(tmp_path / name) for name in ("measurements", "conditions")}
    (tmp_path / "measurements").write_text("condition,quantity,location,statistic,value,sd,unit\n")
    (tmp_path / "conditions").write_text("rest: {}\n")
    assert searches(**given).of_patient == ["case"] and searches(**given, model="other.json").of_patient == []
    assert set(searches(**given, model="other.json").drawn_from("case", "tree")) == {"table"}


def test_pairs_alone_hide_nothing():
    pairs = searches(pairs=("a.csv", "b.csv"))
    assert pairs.names == ["pairs"] and not pairs.cases
    assert {name for _, name in pairs.tables} == {"pairs", "pairs_gap", "pairs_effects"}


def test_measurements_without_a_model_are_searched_in_the_tuned_loop(tmp_path):
    case = searches(measurements="m.csv", conditions=str(tmp_path / "none.yaml")).cases["case"]
    assert case["model"] == "results/x/calibration/rest.json" and case["drives"] == []


def test_networks_of_the_benchmark(tmp_path):
    given = searches(benchmark={"networks": ["campaign", "open_loop", "mine.json"]})
    assert given.hidden_in("campaign") == {"network": "results/x/calibration/rest.json"}
    assert given.hidden_in("open_loop") == {} and given.hidden_in("mine") == {"network": "mine.json"}


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"pairs": ("gone.csv", "b.csv")}, "discrepancy.pairs = 'gone.csv': no such file"),
        ({"benchmark": {"networks": ["gone.json"]}}, "discrepancy.benchmark.networks = 'gone.json': no such file"),
        ({"recordings": "nowhere", "animals": ["X"]}, "discrepancy.animals = 'X': no X_CONDITION.csv in nowhere"),
    ],
)
def test_missing_files_are_refused(settings, error):
    with pytest.raises(InputError) as raised:
        searches(**settings).check()
    assert error in str(raised.value)


def test_conditions_to_hold_out_must_be_recorded(tmp_path):
    (tmp_path / "X_baseline.csv").touch()
    with pytest.raises(InputError, match="not recorded; recorded are baseline"):
        searches(recordings=str(tmp_path), animals=["X"], held_out=["severe"]).check()


@pytest.mark.parametrize("distance", ["12", ""])
def test_a_pullback_is_drawn_where_the_table_has_one(tmp_path, distance):
    (tmp_path / "m.csv").write_text(f"condition,quantity,location,value,distance\nrest,pressure,lad,90,{distance}\n")
    found = searches(measurements=str(tmp_path / "m.csv"), conditions=str(tmp_path / "c.yaml"))
    assert (("case", "pullback") in found.tables) == bool(distance)
    assert any(path.endswith("case/figures/pullback.png") for path in found.figures) == bool(distance)
    assert ("hidden", "pullback") not in searches().tables
