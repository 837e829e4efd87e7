"""The card of a vessel follows from the intervals of its estimates."""

import pytest

from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation.results import BeyondTheMean, Probability
from coronaryuq.report.mesh_error import MeshError
from coronaryuq.report.vessels import vessel_card
from support.estimates import row, value


@pytest.fixture
def card(tmp_path):
    """Return the card of a stenosis with given estimates beyond the mean of FFR."""
    write_json(tmp_path / "mesh.json", {"nodes": 8000, "settings": {"throat_resolution": 3.0}})

    def make(**beyond):
        rows = [
            row(column_3d=f"{quantity}_lad", beyond_the_mean=BeyondTheMean(**beyond))
            for quantity in ("ffr", "tawss_min", "osi_max")
        ]
        return vessel_card("LAD", rows, {"BC_b": "D1 (lca3)"}, MeshError(tmp_path / "mesh.json", None))

    return make


def probability(middle, low, high):
    return Probability(0.8, middle, 0.01, low, high, 0.95)


@pytest.mark.parametrize(("low", "high", "kind"), [(0.92, 0.97, "bad"), (0.01, 0.06, "good"), (0.42, 0.47, "warn")])
def test_the_verdict_depends_on_the_whole_interval(card, low, high, kind):
    assert card(probability_at_or_below=probability((low + high) / 2, low, high))["class"] == kind


def test_a_narrow_interval_of_a_probability_gets_a_decimal(card):
    narrow = card(probability_at_or_below=probability(0.031, 0.027, 0.035))
    wide = card(probability_at_or_below=probability(0.02, -0.01, 0.11))
    assert narrow["significant"] == {"value": "3.1 %", "low": "2.7 %", "high": "3.5 %"}
    assert wide["significant"] == {"value": "2 %", "low": "0 %", "high": "11 %"}


def test_only_inputs_whose_index_differs_from_zero_are_named_as_drivers(card):
    sobol = {"BC_a": value(0.2, 0.1, 0.3), "BC_b": value(0.5, 0.4, 0.6), "BC_c": value(0.3, 0.0, 0.6)}
    assert card(sobol_first_order=sobol)["drivers"] == "D1 (lca3) 50 %, BC_a 20 %"


def test_quantiles_with_few_runs_beyond_them_carry_a_warning(card):
    few = "only about 5 of 100 runs lie beyond it"
    quantiles = {end: value(0.8, warning=few) for end in ("0.95", "0.05")}
    assert card(quantiles=quantiles | {"0.50": value(0.8)})["rare"] == f"5 % and 95 % quantiles: {few}."
    assert card(quantiles={"0.50": value(0.8)})["rare"] == ""


def test_the_spread_over_draws_is_given_by_the_outermost_quantiles(card):
    quantiles = {"0.50": value(0.8), "0.95": value(0.88), "0.05": value(0.71)}
    assert card(quantiles=quantiles)["draws"] == "90 % of draws: 0.71 to 0.88"
