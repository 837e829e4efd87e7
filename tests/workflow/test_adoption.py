"""One command, from data with a hidden effect to the prediction with what the search of them named."""

import zipfile

import pytest

from coronaryuq.case.case_json import read_case
from coronaryuq.core.io.atomic import read_json
from coronaryuq.report.captions import SEARCHES
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from support import smoke

ADOPT = ("discrepancy: {adopt: true}\n",)

pytestmark = [pytest.mark.workflow, pytest.mark.long]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return smoke.campaign(tmp_path_factory.mktemp("adopted"), "--", "adopted", more=ADOPT)


def true_ffr(results):
    """FFR of the loop before adoption with the hidden stenosis in it, in hyperaemia, by stenosis."""
    truth = read_json(results / "discrepancy" / "hidden" / "case" / "truth.json")
    scales = read_json(results / "discrepancy" / "hidden" / "found" / "discrepancy.json")["scales"]
    coefficient = truth["sizes"]["loss"] * scales["pressure"] / scales["flow"][truth["place"]] ** 2
    network, case = (
        read_network(results / "adopted" / "before" / "hyperaemia.json"),
        read_case(results / "case/case.json"),
    )
    names = {one.name: f"mean_pressure:{one.ffr}" for one in case.stenoses}
    aorta = f"mean_pressure:{case.aorta.pressure}"
    engine = Engine(with_changes(network, {f"{truth['place']}.stenosis_coefficient": coefficient}))
    found = engine.run_to_periodic(quantities=[aorta, *names.values()])
    return {name: found.values[place][0] / found.values[aorta][0] for name, place in names.items()}


def test_the_prediction_after_adoption_holds_the_true_ffr_and_the_one_before_does_not(results):
    """At the stenosis of the artery with the hidden one; the others hardly change."""
    truth = true_ffr(results)
    found = read_json(results / "adopted" / "comparison.json")
    assert found["adopted"] and found["gap"]["after"]["misfit"] < found["gap"]["before"]["misfit"]
    rows = {row["branch"]: row for row in found["ffr"]}
    for branch, ffr in truth.items():
        assert rows[branch]["after"]["low"] < ffr < rows[branch]["after"]["high"], branch
    assert any(not rows[b]["before"]["low"] < ffr < rows[b]["before"]["high"] for b, ffr in truth.items())


def test_snakemakes_own_report_holds_the_figures_of_the_search_as_a_self_test(results, tmp_path):
    smoke.campaign(results.parents[1], "--", "discrepancy", more=ADOPT)
    zipped = ("--report", str(tmp_path / "campaign.zip"))
    smoke.campaign(results.parents[1], *zipped, "--", "discrepancy", more=ADOPT)
    with zipfile.ZipFile(tmp_path / "campaign.zip") as archive:
        text = "".join(archive.read(name).decode() for name in archive.namelist() if name.endswith((".js", ".html")))
    for words in ("Self-test of the search", "The measurements are invented", SEARCHES["ranking"].title):
        assert words in text
    assert "Missing effects" not in text, "an invented effect must not be read as one of the patient"


def test_the_tuned_loop_says_where_its_effect_is_from_and_calibration_held_it(results):
    network = read_network(results / "calibration" / "hyperaemia.json")
    (entry,) = network["uncertain_parameters"]
    untuned = read_network(results / "adopted" / "network.json")
    assert "search of" in entry["source"] and network.held
    for target in network.held:
        block, _, name = target.rpartition(".")
        assert network.vessel_values(block)[name] == untuned.vessel_values(block)[name]
