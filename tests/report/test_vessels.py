"""The card of a vessel follows from the intervals of its estimates."""

from dataclasses import replace

import pytest

from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation.results import BeyondTheMean, Probability
from coronaryuq.report.mesh_error import MeshError
from coronaryuq.report.vessels import improve_first, vessel_card
from support.estimates import estimator, row, value

COLUMNS = dict.fromkeys(("ffr", "tawss_min", "osi_max"), estimator())


@pytest.fixture
def card(tmp_path):
    """Return the card of a stenosis with given estimates beyond the mean of FFR."""
    write_json(tmp_path / "mesh.json", {"nodes": 8000, "settings": {"throat_resolution": 3.0}})

    def make(columns=COLUMNS, **beyond):
        rows = [
            row(column_3d=f"{quantity}_lad", beyond_the_mean=BeyondTheMean(**beyond), estimators={"MC": estimate})
            for quantity, estimate in columns.items()
        ]
        return vessel_card("LAD", rows, {"BC_b": "D1 (lca3)"}, MeshError(tmp_path / "mesh.json", None))

    return make


def zones(middle, low, high):
    """Return zones of which those at or below 0.80 have a given probability together."""
    lower, upper = (
        Probability(middle / 2, 0.01, low / 2, high / 2, 0.95),
        Probability(1 - middle, 0.01, 1 - high, 1 - low, 0.95),
    )
    return [replace(lower, at_most=0.75), replace(lower, above=0.75, at_most=0.8), replace(upper, above=0.8)]


@pytest.mark.parametrize(("low", "high", "kind"), [(0.92, 0.97, "bad"), (0.01, 0.06, "good"), (0.42, 0.47, "warn")])
def test_the_verdict_depends_on_the_whole_interval_of_what_lies_below_the_highest_limit(card, low, high, kind):
    assert card(zones=zones((low + high) / 2, low, high))["class"] == kind


def test_every_zone_is_shown_and_a_narrow_interval_gets_a_decimal(card):
    narrow, wide = card(zones=zones(0.031, 0.027, 0.035))["zones"], card(zones=zones(0.02, -0.01, 0.11))["zones"]
    assert [zone["zone"] for zone in narrow] == ["FFR ≤ 0.75", "0.75 < FFR ≤ 0.80", "FFR > 0.80"]
    assert narrow[2] == {"zone": "FFR > 0.80", "value": "96.9 %", "low": "96.5 %", "high": "97.3 %"}
    assert wide[2] == {"zone": "FFR > 0.80", "value": "98 %", "low": "89 %", "high": "100 %"}


def test_only_inputs_whose_effect_differs_from_zero_are_named_as_drivers(card):
    effects = {"BC_a": value(0.2, 0.1, 0.3), "BC_b": value(0.5, 0.4, 0.6), "BC_c": value(0.3, 0.0, 0.6)}
    assert card(shapley=effects)["drivers"] == "D1 (lca3) 50 %, BC_a 20 %"


def test_quantiles_with_few_runs_beyond_them_carry_a_warning(card):
    few = "only about 5 of 100 runs lie beyond it"
    quantiles = {end: value(0.8, warning=few) for end in ("0.95", "0.05")}
    assert card(quantiles=quantiles | {"0.50": value(0.8)})["rare"] == f"5 % and 95 % quantiles: {few}."
    assert card(quantiles={"0.50": value(0.8)})["rare"] == ""


def test_the_patient_has_the_median_and_the_90_percent_range_over_draws(card):
    quantiles = {"0.50": value(0.8), "0.95": value(0.88), "0.05": value(0.71)}
    assert card(quantiles=quantiles)["patient"] == {"low": "0.71", "median": "0.80", "high": "0.88"}
    assert card()["patient"] == {}


def test_extremes_come_after_averages_and_a_value_in_all_runs_has_no_interval(card):
    shear = {"tawss_patch_min": estimator(), "low_shear_area": estimator(mean=0.0, std=0.0, n_3d=16)}
    found = card({"osi_max": estimator(), "ffr": estimator(), **shear})
    assert [cell["heading"] for cell in found["quantities"]] == ["FFR", "patch-min TAWSS (dyn/cm²)", "low-shear area"]
    assert [cell["heading"] for cell in found["extremes"]] == ["max OSI"]
    low_shear = found["quantities"][2]
    assert (low_shear["value"], low_shear["range"]) == ("0", "in all 16 runs")


def test_the_source_to_improve_first_is_named_with_those_that_may_be_as_large(card):
    effects = {"flow": value(0.3, 0.2, 0.4), "lumen": value(0.6, 0.5, 0.7), "model": value(0.1, 0.05, 0.15)}
    assert card(by_source=effects)["improve"] == (
        "Improve first: the lumen's segmentation (shares of FFR's variance: lumen 60 %, flow 30 %, model 10 %; "
        "numerics not measured)."
    )
    close = effects | {"flow": value(0.45, 0.35, 0.55), "lumen": value(0.45, 0.35, 0.55)}
    assert improve_first(close, 0.0).startswith("Improve first: perfusion or the lumen's segmentation (")
    assert improve_first(effects, 0.5).startswith("Improve first: mesh and time step (")
    assert card()["improve"] == ""
