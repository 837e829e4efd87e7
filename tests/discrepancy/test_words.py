"""What the paragraph says of held-out measurements is what the numbers say."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.discrepancy.abstention import Gaps
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.verify import Gap
from coronaryuq.discrepancy.words import _unforeseen, moved, rival, shapeless


def gap(lpd: float) -> Gap:
    return Gap(1.0, (0.9, 1.1), {}, lpd, 10 * lpd, np.zeros(10), np.arange(10))


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [(3.76, 1.57, "falls from 3.76 to 1.57"), (1.93, 2.68, "rises from 1.93 to 2.68"), (1.053, 1.051, "stays at 1.05")],
)
def test_a_misfit_is_said_to_fall_only_where_it_does(before, after, said):
    assert moved(before, after).startswith(f"{said} standard deviations of the noise")


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
