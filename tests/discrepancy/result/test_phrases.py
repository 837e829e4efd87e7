"""The phrases of the summary agree with the numbers."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference.locate import Located, PriorConflict
from coronaryuq.discrepancy.inference.outliers import Outlier
from coronaryuq.discrepancy.result import phrases
from coronaryuq.discrepancy.result.facts import by_condition, described_sizes, prior_conflicts
from coronaryuq.discrepancy.selection.size_constancy import Constancy
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from support.hypotheses import placed

LEVEL = 0.01
OPEN_LOOP = Anatomy({"vessels": []})
FORWARD = SimpleNamespace(anatomy=OPEN_LOOP, measured=[])
CLOSED_LOOP = Anatomy({"vessels": [], "closed_loop_blocks": [{}]})


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [(3.76, 1.57, "falls from 3.76 to 1.57"), (1.93, 2.68, "rises from 1.93 to 2.68"), (1.053, 1.051, "stays at 1.05")],
)
def test_the_misfit_falls_only_if_the_shown_numbers_do(before, after, text):
    assert phrases.misfit_change(before, after).startswith(f"{text} (1 is expected from")


def test_a_model_that_fits_but_does_not_predict_gets_a_warning():
    assert phrases.prediction_warning(0.5, ["pacing"]) == ""
    warning = phrases.prediction_warning(1e-9, ["pacing"])
    assert "does not predict the held-out data (p = 1e-09)" in warning and "hold other conditions out" in warning
    alone = phrases.prediction_warning(1e-9, [])
    assert "what is left out of the fit is not predicted by the rest (p = 1e-09)" in alone and "held-out" not in alone


def test_the_measurement_that_distinguishes_a_class_is_named_only_if_it_is_informative():
    best = {"quantity": "pressure", "location": "lad:BC_lad", "condition": "rest", "expected_information_nats": 0.55}
    best |= {"already_measured": False}
    assert phrases.next_measurement_text([best]).startswith(
        "The mean pressure at lad:BC_lad under rest would distinguish them best (expected information 0.55 nats"
    )
    repeated = phrases.next_measurement_text([best | {"already_measured": True}])
    assert repeated.startswith("The mean pressure at lad:BC_lad under rest, measured with another instrument, would")
    uninformative = phrases.next_measurement_text([best | {"expected_information_nats": 0.01}])
    assert uninformative.startswith("No mean pressure or flow")
    assert phrases.next_measurement_text([]) == ""


def test_the_probability_of_a_class_is_separate_from_that_of_its_first_member():
    first = {"effect": "bifurcation_loss", "place": "lad", "probability": 0.4}
    other = {"effect": "ostial_loss", "place": "lm", "probability": 0.59}
    assert phrases.class_probability_text([first]) == "probability 0.40"
    text = phrases.class_probability_text([first, other])
    assert text.startswith("probability 0.99 for its class, 0.40 for this member; ")
    assert text.endswith("indistinguishable from it with these data: ostial loss at lm 0.59")
    unlikely = other | {"probability": 0.004}
    assert phrases.class_probability_text([first, other, unlikely]) == text
    assert phrases.class_probability_text([first, unlikely]).endswith("with these data: others, below 0.01 each")


def test_noise_is_told_by_its_size_and_by_how_long_it_lasts():
    noise = {"pressure": {"scale": 1.24, "correlation_time": 0.0}, "flow": {"scale": 1.03, "correlation_time": 0.036}}
    said = "1.24 times the stated size for pressure and 1.03 times the stated size, correlated over 0.036 s, for flow"
    told = phrases.noise_notes(noise)
    assert told == f"By the scatter of the waveforms, their noise is {said}; the search uses this. "
    assert phrases.noise_notes({}) == ""
    quiet = phrases.noise_notes({"flow": {"scale": 0.03, "correlation_time": 0.1}})
    assert quiet.endswith(" Check that standard deviations of flow are in the unit of the values. ")
    loud = phrases.noise_notes({"flow": {"scale": 4.9, "correlation_time": 0.0}})
    assert "So much noise of flow may be an effect that the library lacks" in loud and "So much" not in told


@pytest.mark.parametrize(
    ("strains", "text"),
    [
        ([("a", 2.0, 0.5), ("b", -1.0, 0.9)], ""),
        ([("a", 2.0, 1e-3), ("b", 2.9, 1e-3)], ""),
        (
            [("a", 3.1, 1e-3), ("b", -4.0, 0.2)],
            "It moves the b by -4.0 standard deviations of its prior (×0.14) and the a by +3.1 (×4.7). ",
        ),
        (
            [(name, 4.0, 1e-6) for name in "abcdef"],
            "It moves the a by +4.0 standard deviations of its prior (×7.4), the b by +4.0 (×7.4), the c by +4.0 "
            "(×7.4), the d by +4.0 (×7.4) and 2 more. ",
        ),
    ],
    ids=["none", "in conflict, but not far", "far outside", "many"],
)
def test_every_nuisance_parameter_far_outside_its_prior_is_listed(strains, text):
    located = Located(1.0, {}, [], [PriorConflict(name, sd, sd, p) for name, sd, p in strains])
    nuisances = [Nuisance(name, 0.5) for name, _, _ in strains]
    conflicts = prior_conflicts(located, nuisances, LEVEL)
    assert phrases.conflict_text("It moves", conflicts) == text


def test_the_effects_whose_size_varies_are_listed_among_the_best_candidates():
    varying = Constancy(placed("diffuse_narrowing", "lad"), 9.0, {"rest": (0.0, 0.1), "pacing": (2.0, 0.1)})
    loss = {"effect": "diffuse_narrowing", "place": "lad", "varying": by_condition(varying, FORWARD)}
    leak = {"effect": "side_branch_leak", "place": "lad", "varying": None}
    several = phrases.varying_text([leak, loss])
    assert several.startswith(
        "the best candidates are side branch leak at lad and diffuse narrowing at lad, of which diffuse"
    )
    assert several.endswith(") would need a different size under each condition")
    alone = phrases.varying_text([loss])
    assert alone.startswith(
        "the best candidate, diffuse narrowing at lad, would need a different size under each condition (l"
    )


def test_an_effect_may_be_absent_under_one_condition():
    """The logarithm of its size has no such value, but the model is linear in the size."""
    (loss,) = effect("diffuse_narrowing").parameters
    absent = 1.0 - 1.0 / loss.spread
    varying = Constancy(placed("diffuse_narrowing", "lad"), 9.0, {"rest": (absent, 0.1), "pacing": (1.0, 0.1)}, 1.0)
    value, low, high = by_condition(varying, FORWARD)["conditions"]["rest"]
    assert value == pytest.approx(0.0, abs=1e-6) and low == 0.0 and high > 0.0
    found = by_condition(varying, FORWARD)["conditions"]["pacing"][0]
    assert found == pytest.approx(loss.from_standard(1.0))


def test_sizes_by_condition_have_intervals_and_omit_uninformative_conditions():
    sizes = {"rest": (0.0, 0.1), "pacing": (2.0, 0.2), "held": (0.0, 1.2)}
    text = phrases.sizes_by_condition(by_condition(Constancy(placed("flow_delay", "a:b"), 9.0, sizes), FORWARD))
    assert text == "delay: rest 0.000 (-0.005 to 0.005), pacing 0.060 (0.050 to 0.070) s"


def test_sizes_by_condition_are_described_as_the_effect_describes_them():
    """An added share of the ventricular pressure; in a closed loop a factor on the present pressure."""
    varying = Constancy(placed("intramyocardial_pressure", "all beds"), 9.0, {"rest": (1.0, 0.1)})
    (share, factor) = (
        phrases.sizes_by_condition(by_condition(varying, SimpleNamespace(anatomy=one, measured=[])))
        for one in (OPEN_LOOP, CLOSED_LOOP)
    )
    (parameter,) = varying.placed.effect.parameters
    added = float(parameter.from_standard(1.0))
    assert share.startswith(f"share: rest {added:.2g} (")
    assert factor.startswith(f"factor on the model's intramyocardial pressure: rest {np.exp(added):.2g} (")


def test_an_offset_beside_which_another_unit_is_printed_says_what_it_is_relative_to():
    varying = Constancy(placed("pressure_offset", "a:b"), 9.0, {"rest": (1.0, 0.1), "pacing": (2.0, 0.1)})
    assert phrases.sizes_by_condition(by_condition(varying, FORWARD)).startswith(
        "offset over the mean pressure at the root: rest 0.08"
    )


@pytest.mark.parametrize(
    ("name", "z", "text"),
    [
        ("flow_delay", -1.0, "read early by 0.030 (0.025 to 0.035) s"),
        ("flow_delay", 1.0, "delay in seconds: 0.030 (0.025 to 0.035)"),
        ("flow_gain", -1.0, "gain minus 1: -0.15 (-0.17 to -0.13)"),
    ],
)
def test_a_negative_delay_is_described_as_read_early(name, z, text):
    sensor = effect(name)
    sizes = described_sizes(placed(sensor, "a:b"), [(sensor.parameters[0], z, 0.1)], OPEN_LOOP)
    assert phrases.size_text(sizes) == text


def test_outliers_are_listed_with_a_remedy():
    outlier = vars(Outlier("flow", "AORTA:lad", "rest", 0.3125, -10.0))
    assert phrases.outlier_notes([]) == ""
    assert phrases.outlier_notes([outlier]).startswith(
        "One sample is an outlier and was left out: the flow at AORTA:lad under rest at 0.3125 s (-10 "
    )
    assert "and 3 more. Check whether they are artefacts" in phrases.outlier_notes([outlier] * 7)


def test_an_offset_by_condition_is_told_in_clinical_units():
    """A tenth of the pressure at the root, wherever the sensor is."""
    five = np.array([5.0 * MMHG])
    measured = [Measured("rest", "pressure", "a:b", "mean", None, 1.0, five, np.ones(1), scale=100.0 * MMHG)]
    scale = effect("pressure_offset").parameters[0].from_standard(1.0)
    offset = Constancy(placed("pressure_offset", "a:b"), 9.0, {"rest": (0.1 / float(scale), 0.0)})
    told = by_condition(offset, SimpleNamespace(anatomy=OPEN_LOOP, measured=measured))
    assert told["label"].endswith("in mmHg") and told["conditions"]["rest"][0] == pytest.approx(10.0)
