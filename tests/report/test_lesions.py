"""The card of a lesion follows from the intervals of its estimates."""

from dataclasses import replace

import pytest

from coronaryuq.case.case_json import CaseStenosis, FfrPlace
from coronaryuq.core.io.atomic import write_json
from coronaryuq.estimation.estimators.tails import rare
from coronaryuq.estimation.results import BeyondTheMean, Interval, Probability
from coronaryuq.report.lesions import Lesion, lesion_card
from coronaryuq.report.mesh_error import MeshError
from support.estimates import estimator, row, value

COLUMNS = dict.fromkeys(("ffr", "tawss_min", "osi_max"), estimator())
STENOSIS = CaseStenosis(
    name="LAD", artery="LAD", vessel="v", segment="v", proximal=None, distal=None, area_ratio=0.3, start=0.0, end=1.0,
    ffr="v:J", flow="J:v", root="J:v", outlet="BC_b",
)  # fmt: skip


def read_at(arc, stop=None):
    """The stenosis, whose FFR is read at an arc length."""
    return STENOSIS.model_copy(update={"read": FfrPlace(arc=arc, asked=1.5, stop=stop)})


@pytest.fixture
def card(tmp_path):
    """Return the card of a stenosis with given estimates beyond the mean of FFR."""
    write_json(tmp_path / "mesh.json", {"nodes": 8000, "settings": {"throat_resolution": 3.0}})

    def make(columns=COLUMNS, reading=None, stenosis=STENOSIS, past=False, **beyond):
        if "quantiles" in beyond:
            beyond["predictive"] = {share: one.value for share, one in beyond["quantiles"].items()}
        rows = [
            row(column_3d=f"{quantity}_lad", beyond_the_mean=BeyondTheMean(**beyond), estimators={"MC": estimate})
            for quantity, estimate in columns.items()
        ]
        mesh = MeshError(tmp_path / "mesh.json", None)
        return lesion_card(Lesion(stenosis, {"BC_b": "the resistance of the D1 bed"}, mesh, reading, past), rows)

    return make


def zones(middle, low, high):
    """Return zones of which those at or below 0.80 have a given probability together."""
    lower, upper = (
        Probability(middle / 2, 0.01, low / 2, high / 2, 0.95),
        Probability(1 - middle, 0.01, 1 - high, 1 - low, 0.95),
    )
    return [replace(lower, at_most=0.75), replace(lower, above=0.75, at_most=0.8), replace(upper, above=0.8)]


def quantiles(low, median, high):
    return {
        "0.05": value(low),
        "0.25": value(median),
        "0.50": value(median),
        "0.75": value(median),
        "0.95": value(high),
    }


@pytest.mark.parametrize(("low", "high", "kind"), [(0.92, 0.97, "bad"), (0.01, 0.06, "good"), (0.42, 0.47, "warn")])
def test_the_verdict_depends_on_the_whole_interval_of_what_lies_below_the_highest_limit(card, low, high, kind):
    assert card(zones=zones((low + high) / 2, low, high))["class"] == kind


def test_the_card_has_the_pressure_drop_and_leaves_the_lowest_ffr_to_the_artery(card):
    columns = dict.fromkeys(("ffr", "lowest_ffr", "pressure_drop", "tawss_min"), estimator())
    assert [cell["heading"] for cell in card(columns)["quantities"]] == ["FFR", "Pressure drop (mmHg)"]


def test_the_conclusion_is_one_sentence_with_the_patients_range_and_the_probability(card):
    told = card(zones=zones(0.93, 0.91, 0.95), quantiles=quantiles(0.66, 0.714, 0.81))["sentence"]
    assert told == (
        "The LAD stenosis very likely limits blood flow: FFR is 0.71 (90 % range 0.66 to 0.81); the "
        "probability of 0.80 or less is 93 %."
    )


def test_every_zone_is_shown_and_a_narrow_interval_gets_a_decimal(card):
    narrow, wide = card(zones=zones(0.031, 0.027, 0.035))["zones"], card(zones=zones(0.02, -0.01, 0.11))["zones"]
    assert [zone["zone"] for zone in narrow] == ["FFR ≤ 0.75", "0.75 < FFR ≤ 0.80", "FFR > 0.80"]
    shown = {"zone": "FFR > 0.80", "percent": 96.9, "value": "96.9 %", "low": "96.5", "high": "97.3 %"}
    assert narrow[2] == shown
    assert wide[2] == {"zone": "FFR > 0.80", "percent": 98.0, "value": "98 %", "low": "89", "high": "100 %"}
    assert sum(zone["percent"] for zone in narrow) == pytest.approx(100, abs=0.02)


def test_what_rounds_to_nothing_is_said_to_be_below_a_number(card):
    found = card(zones=zones(0.0002, 0.0, 0.029), quantiles=quantiles(0.84, 0.88, 0.9))
    assert found["sentence"].endswith("the probability of 0.80 or less is below 1 %.")
    assert [(zone["value"], zone["low"], zone["high"]) for zone in found["zones"]] == [
        ("< 1 %", "0", "1 %"),
        ("< 1 %", "0", "1 %"),
        ("> 99 %", "97", "100 %"),
    ]


def test_only_inputs_whose_effect_differs_from_zero_are_named_as_drivers(card):
    effects = {"BC_a": value(0.2, 0.1, 0.3), "BC_b": value(0.5, 0.4, 0.6), "BC_c": value(0.3, 0.0, 0.6)}
    drivers = card(shapley=effects)["drivers"]
    assert [tuple(driver.values()) for driver in drivers] == [
        ("the resistance of the D1 bed", "50 %"),
        ("BC_a", "20 %"),
    ]


def test_quantiles_that_rest_on_few_runs_carry_a_warning(card):
    few = rare(104, 0.05)
    both = {end: value(0.8, warning=few) for end in ("0.95", "0.05")}
    told = (
        "The ends of this range are rough: of the 5 % and 95 % quantiles, each rests on about 5 of 104 runs; its "
        "interval was tested with 10 or more. More 3D runs would make them sharper."
    )
    assert card(quantiles=both | {"0.50": value(0.8)})["rare"] == told
    assert card(quantiles={"0.05": value(0.7, warning=few)})["rare"].startswith(
        "One end of this range is rough: the 5 % quantile rests on about 5 of"
    )
    assert card(quantiles={"0.50": value(0.8)})["rare"] == ""


def test_the_patient_has_the_median_and_the_90_percent_range(card):
    patient = card(quantiles=quantiles(0.71, 0.8, 0.88))["patient"]
    assert (patient["low"], patient["median"], patient["high"]) == ("0.71", "0.80", "0.88")
    assert patient["scale"] == [0.5, 1.0]
    assert card(quantiles=quantiles(0.34, 0.5, 0.6))["patient"]["scale"][0] == pytest.approx(0.3)
    assert card()["patient"] == {}


@pytest.mark.parametrize(
    ("half_width", "sources", "words"),
    [
        (
            0.004,
            {"runs_3d": 1.0},
            "More simulations would not decide it: the numerical error of the mean is ± 0.004.",
        ),
        (
            0.06,
            {"runs_3d": 1.0},
            "More simulations could decide it: the numerical error of the mean, mostly of 3D runs, is ± 0.060",
        ),
        (0.06, {"runs_3d": 0.1, "mesh": 0.9}, "A finer mesh and shorter time steps could decide it: "),
        (0.004, {"runs_3d": 0.1, "mesh": 0.9}, "Neither more simulations nor a finer mesh would decide it: "),
    ],
)
def test_what_would_help_is_the_source_whose_error_reaches_the_next_verdict(card, half_width, sources, words):
    interval = Interval(0.87 - half_width, 0.87 + half_width, 0.95)
    ffr = estimator(mean=0.87, calibrated=interval, variance=sources)
    told = card({"ffr": ffr}, zones=zones(0.02, 0.01, 0.03), quantiles=quantiles(0.81, 0.87, 0.9))
    assert not told["open"] and told["change"][-1].startswith(words)


def test_a_verdict_changes_where_a_tenth_of_the_states_lies_on_the_other_side(card):
    high = card(zones=zones(0.02, 0.01, 0.03), quantiles=quantiles(0.81, 0.87, 0.9))["change"][0]
    assert high == (
        "If FFR were lower by about 0.03 in every state, for instance because the lumen was drawn too wide, it would "
        "be undecided; by 0.07, the median would lie at 0.80."
    ), "a tenth lies below 0.832, between 0.81 and 0.87 on normal scores"
    low = card(zones=zones(0.98, 0.97, 0.99), quantiles=quantiles(0.6, 0.7, 0.78))["change"][0]
    assert low.startswith("If FFR were higher by about 0.05") and "too narrow" in low
    assert card()["change"] == []


def test_an_open_verdict_is_settled_by_neither_a_small_shift_nor_a_small_numerical_error(card):
    small = estimator(mean=0.8, calibrated=Interval(0.79, 0.81, 0.95), variance={"mesh": 1.0})
    told = card({"ffr": small}, zones=zones(0.5, 0.45, 0.55), quantiles=quantiles(0.72, 0.8, 0.87))
    assert told["open"] and told["change"][0].startswith("FFR higher by about 0.05 in every state")
    assert told["change"][0].endswith("FFR lower by about 0.04 in every state would make it very likely flow-limiting.")
    wide = card({"ffr": small}, zones=zones(0.5, 0.45, 0.55), quantiles=quantiles(0.45, 0.8, 0.97))
    assert wide["change"][0].startswith("FFR lower by"), "a shift that takes the median above 1 is none"
    assert told["change"][-1].startswith("Neither more simulations nor a finer mesh would decide it: ")


def test_where_ffr_is_read_is_compared_with_what_experts_advise(card):
    assert card(reading=0.71)["reading"] == {
        "words": "7 mm beyond the lesion",
        "advised": False,
        "advice": "10 to 20 mm",
        "by_0d": "The 0D model, which helps to estimate it, reads at the lesion's end.",
    }
    far = card(reading=1.5, stenosis=read_at(2.5))["reading"]
    assert far["advised"] and far["words"] == "15 mm beyond the lesion" and far["by_0d"] == ""
    past = card(reading=0.93, past=True)["reading"]["words"]
    assert past == "9 mm beyond the lesion, past a branching"
    near = card(reading=0.6, stenosis=read_at(1.6, "branch"))["reading"]
    assert near["words"] == "6 mm beyond the lesion, the last place before its vessel branches (15 mm were asked for)"
    apart = card(reading=0.3, stenosis=read_at(1.6, "branch"))["reading"]
    assert apart["words"] == "3 mm beyond the lesion", "0D's place is the last before the branching"
    assert apart["by_0d"].endswith("6 mm beyond it, the last place before its vessel branches (15 mm were asked for).")
    assert card()["reading"]["words"] == ""


def test_extremes_come_after_averages_and_a_value_in_all_runs_has_no_interval(card):
    shear = {"tawss_patch_min": estimator(), "low_shear_area": estimator(mean=0.0, std=0.0, n_3d=16)}
    found = card({"osi_max": estimator(), "ffr": estimator(), **shear})
    assert [cell["heading"] for cell in found["quantities"]] == [
        "FFR",
        "Patch-min TAWSS (dyn/cm²)",
        "Low-shear area (%)",
    ]
    assert [cell["heading"] for cell in found["extremes"]] == ["Max OSI"]
    low_shear = found["quantities"][2]
    assert (low_shear["value"], low_shear["range"]) == ("0", "in all 16 runs")


def test_the_spread_is_the_one_of_the_quantiles(card):
    """That of 16 runs alone was a fifth larger than the range beside it; without the estimate it is all there is."""
    assert card()["spread"] == "0.200"
    assert card(variance=value(0.01), quantiles=quantiles(0.64, 0.80, 0.96))["spread"] == "0.100"
