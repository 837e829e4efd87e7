"""What the paragraph says of held-out measurements is what the numbers say."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.discrepancy.inference.cross_validation import Gap
from coronaryuq.discrepancy.inference.locate import Strain
from coronaryuq.discrepancy.result import summary_text
from coronaryuq.discrepancy.result.summary_text import _unforeseen, moved, rival, shapeless
from coronaryuq.discrepancy.selection.abstention import Gaps
from coronaryuq.discrepancy.selection.size_constancy import Constancy
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.library import effect

OPEN_LOOP, CLOSED_LOOP = (
    SimpleNamespace(forward=SimpleNamespace(anatomy=SimpleNamespace(closed_loop=closed))) for closed in (False, True)
)


def gap(lpd: float) -> Gap:
    return Gap(1.0, (0.9, 1.1), {}, lpd, 10 * lpd, np.zeros(10))


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [(3.76, 1.57, "falls from 3.76 to 1.57"), (1.93, 2.68, "rises from 1.93 to 2.68"), (1.053, 1.051, "stays at 1.05")],
)
def test_a_misfit_is_said_to_fall_only_where_it_does(before, after, said):
    assert moved(before, after).startswith(f"{said} (1 is what")


@pytest.mark.parametrize(
    ("after", "flexible", "both", "named", "said"),
    [
        (1.0, 0.9, 1.2, True, ""),
        (1.0, 1.1, 1.2, True, "better than the named effects alone, and better still together with them (log"),
        (1.0, 1.1, 1.05, True, "better than the named effects alone (log predictive density per row 1.00, 1.10)"),
        (1.0, 1.1, 1.1, False, "better (log predictive density per row 1.10, without it 1.00)"),
    ],
)
def test_a_flexible_discrepancy_is_said_to_be_better_only_where_it_is(after, flexible, both, named, said):
    told = rival(Gaps(gap(0.0), gap(after), gap(flexible), gap(both)), named)
    assert said in told
    assert bool(told) == bool(said)


@pytest.mark.parametrize(
    ("smooth", "said"), [(0.4, 1.5), (1e-5, None)], ids=["white noise above what was said", "residuals with a shape"]
)
def test_noise_larger_than_said_is_told_from_something_missing(smooth, said):
    located = SimpleNamespace(tests={"all residuals": 1e-9, "smooth part": smooth, "best candidate": 0.2})
    base = SimpleNamespace(objective=1.5**2 * 200, residual=np.zeros(200))
    problem = SimpleNamespace(settings=Settings())
    larger = shapeless(SimpleNamespace(problem=problem, located=located, base=base))
    assert larger == (said and pytest.approx(said))


def test_a_model_that_agrees_with_what_was_fitted_is_not_said_to_agree_with_the_rest():
    assert _unforeseen(0.5, ["pacing"]) == ""
    assert "not as the model foretells them (p = 1e-09)" in _unforeseen(1e-9, ["pacing"])
    assert "keep others out" in _unforeseen(1e-9, ["pacing"]) and "keep others out" not in _unforeseen(1e-9, [])


def member(name: str, place: str, probability: float):
    return SimpleNamespace(acting=(effect(name), place), probability=probability)


def test_what_would_split_a_class_is_said_where_anything_would():
    best = {"quantity": "pressure", "location": "lad:BC_lad", "condition": "rest", "expected_information_nats": 0.55}
    best |= {"already_measured": False}
    assert summary_text._told_apart([best]).startswith(
        "The mean pressure at lad:BC_lad under rest would tell them apart best (0.55"
    )
    by_another = summary_text._told_apart([best | {"already_measured": True}])
    assert by_another.startswith("The mean pressure at lad:BC_lad under rest, read by another instrument, would tell")
    assert summary_text._told_apart([best | {"expected_information_nats": 0.01}]).startswith("No mean pressure or flow")
    assert summary_text._told_apart([]) == ""


def test_the_probability_of_a_class_is_told_from_that_of_its_first_member():
    one, other = member("bifurcation_loss", "lad", 0.4), member("ostial_loss", "lm", 0.59)
    assert summary_text._probability(SimpleNamespace(members=[one])) == "probability 0.40"
    told = summary_text._probability(SimpleNamespace(members=[one, other]))
    assert told.startswith("probability of the class 0.99, of this member 0.40; ")
    assert told.endswith("cannot tell from it: ostial loss at lm 0.59")


@pytest.mark.parametrize(
    ("strains", "said"),
    [
        ([("a", 2.0, 0.5), ("b", -1.0, 0.9)], ""),
        (
            [("a", 2.0, 1e-3), ("b", 2.9, 1e-3)],
            "It moves the a by +2.0 standard deviations of its prior (×2.7, p = 0.001). ",
        ),
        (
            [("a", 2.0, 1e-3), ("b", -4.0, 0.2)],
            "It moves the a by +2.0 standard deviations of its prior (×2.7, p = 0.001) and the b by -4.0 (×0.14). ",
        ),
        (
            [(name, 4.0, 1e-6) for name in "abcdef"],
            "It moves the a by +4.0 standard deviations of its prior (×7.4, p = 1e-06), the b by +4.0 (×7.4), "
            "the c by +4.0 (×7.4), the d by +4.0 (×7.4) and 2 more. ",
        ),
    ],
    ids=["none", "the worst", "and one far outside", "many"],
)
def test_every_nuisance_parameter_far_outside_its_prior_is_said(strains, said):
    located = SimpleNamespace(strains=[Strain(name, sd, sd, p) for name, sd, p in strains])
    nuisances = [SimpleNamespace(name=name, sd=0.5) for name, _, _ in strains]
    problem = SimpleNamespace(settings=Settings(), forward=SimpleNamespace(nuisances=nuisances))
    assert summary_text._strained("It moves", located, SimpleNamespace(problem=problem)) == said


def test_what_comes_nearest_is_all_that_acts():
    leak, loss = (effect("side_branch_leak"), "lad"), (effect("diffuse_narrowing"), "lad")
    varying = Constancy(loss, 9.0, {"rest": (0.0, 0.1), "pacing": (2.0, 0.1)})
    parts = {"verdict": SimpleNamespace(varying=[varying]), "problem": OPEN_LOOP}
    several = summary_text._varying(SimpleNamespace(acting=[leak, loss], **parts))
    assert several.startswith(
        "what comes nearest is side branch leak at lad and diffuse narrowing at lad, of which diffuse"
    )
    assert several.endswith(") would need another size under each condition")
    alone = summary_text._varying(SimpleNamespace(acting=[loss], **parts))
    assert alone.startswith(
        "what comes nearest, diffuse narrowing at lad, would need another size under each condition (l"
    )


def test_sizes_by_condition_have_their_intervals_and_leave_out_what_says_nothing():
    known = {"rest": (0.0, 0.1), "pacing": (2.0, 0.2), "held": (0.0, 1.2)}
    told = summary_text._sizes(Constancy((effect("flow_delay"), "a:b"), 9.0, known), OPEN_LOOP.forward.anatomy)
    assert told == "delay: rest 0 (-0.0049 to 0.0049), pacing 0.06 (0.05 to 0.07) s"


def test_sizes_by_condition_are_said_as_the_size_is():
    """A share of the ventricular pressure that is added, in a closed loop the factor on what is there."""
    varying = Constancy((effect("intramyocardial_pressure"), "all beds"), 9.0, {"rest": (1.0, 0.1)})
    (share, factor) = (summary_text._sizes(varying, one.forward.anatomy) for one in (OPEN_LOOP, CLOSED_LOOP))
    (parameter,) = varying.acting[0].parameters
    added = float(parameter.from_standard(1.0))
    assert share.startswith(f"share: rest {added:.2g} (")
    assert factor.startswith(f"factor on the model's intramyocardial pressure: rest {np.exp(added):.2g} (")


@pytest.mark.parametrize(
    ("name", "z", "said"),
    [
        ("flow_delay", -1.0, "read early by 0.03 (0.025 to 0.035) s"),
        ("flow_delay", 1.0, "delay in seconds 0.03 (0.025 to 0.035)"),
        ("flow_gain", -1.0, "gain less 1 -0.15 (-0.17 to -0.13)"),
    ],
)
def test_a_negative_delay_is_read_early(name, z, said):
    one = effect(name)
    problem = SimpleNamespace(forward=SimpleNamespace(anatomy=None))
    found = SimpleNamespace(sizes=lambda acting: [(one.parameters[0], z, 0.1)], problem=problem)
    assert summary_text._size_of(found, (one, "a:b")) == said
