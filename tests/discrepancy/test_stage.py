"""The campaign's own case from end to end: an effect hidden, searched, held against the truth, and on the page."""

import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.search_case import search
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.stage import compare, hide_in_loop
from coronaryuq.report.discrepancy import write_page
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import read_network

pytestmark = pytest.mark.slow

SEED = 5


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Folder `hidden` of a campaign: `case`, `found` and `known`."""
    folder = tmp_path_factory.mktemp("campaign") / "hidden"
    write_json(folder.parent / "rest.json", open_loop().network)
    hide_in_loop(folder.parent / "rest.json", Settings(), SEED, folder / "case")
    names = {"model": "model.json", "measurements": "measurements.csv", "conditions": "conditions.yaml"}
    case = {key: str(folder / "case" / name) for key, name in names.items()}
    search(*case.values(), Settings(), SEED, folder / "found")
    truth = folder / "case" / "truth.json"
    answer = {"gaps": folder / "found" / "gap.csv", "answer": folder / "found" / "discrepancy.json"}
    out = {"table": folder / "known" / "gap.csv", "reference": folder / "known" / "gap.json"}
    compare(case, truth, answer, Settings(), SEED, out)
    return folder


def test_the_search_closes_the_same_gap_as_the_truth(found):
    """On held-out data the named effect closes the gap that the true one closes, where it is the true one."""
    gaps = read_csv(found / "known" / "gap.csv").set_index("model").misfit
    answer, truth = (read_json(found / name) for name in ("found/discrepancy.json", "case/truth.json"))
    assert (answer["named"][0]["effect"], answer["named"][0]["place"]) == (truth["effect"], truth["place"])
    assert gaps["recalibration alone"] > 1.5 * gaps["with the true effect"]
    assert gaps["with the named effects"] == pytest.approx(gaps["with the true effect"], rel=0.01)
    assert read_json(found / "known" / "gap.json")["misfit"] == gaps["with the true effect"]


def test_the_page_compares_the_answer_with_the_truth(found, tmp_path):
    truths = [found / "case" / "truth.json", found / "known" / "gap.json"]
    write_page([found / "found" / "discrepancy.json"], [], "campaign", {}, tmp_path / "page.html", truths)
    page = (tmp_path / "page.html").read_text()
    assert "The first answer is the true effect at its location" in page and "with the true effect" in page
    write_page([found / "found" / "discrepancy.json"], [], "campaign", {}, tmp_path / "page.html")
    assert "with the true effect" not in (tmp_path / "page.html").read_text()


@pytest.mark.parametrize("name", ["pressure_offset", "mbf_underestimation", "ostial_loss", "incomplete_hyperaemia"])
def test_an_effect_is_hidden_at_a_place_of_the_search(name, tmp_path):
    """Places before measured beds are chosen of those that the effect has; sensors have theirs by what is measured."""
    write_json(tmp_path / "rest.json", open_loop().network)
    hide_in_loop(tmp_path / "rest.json", Settings(hidden_effect=name), SEED, tmp_path)
    conditions = read_conditions(tmp_path / "conditions.yaml")
    paths = tmp_path / "measurements.csv", conditions, tmp_path / "conditions.yaml"
    forward = read_problem(read_network(tmp_path / "model.json"), *paths, Settings()).forward
    truth = read_json(tmp_path / "truth.json")
    assert truth["effect"] == name and truth["place"] in effect(name).places(forward.anatomy, forward.measured)
