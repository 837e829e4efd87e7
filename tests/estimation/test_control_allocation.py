"""Rounds of a growing campaign: what is decided, and that gathered counts are the first samples."""

from coronaryuq.estimation.campaign.allocation import decide
from coronaryuq.estimation.campaign.convergence_and_budget import Want

COUNTS, MOST, PORTION = {"n_3d": 16, "n_0d": 200}, {"n_3d": 40, "n_0d": 400}, {"n_3d": 8, "n_0d": 100}


def want(now, more_3d, more_0d):
    return Want("1", 1.0, now, more_3d, more_0d, 0.0, 0.0)


def test_it_stops_when_every_wanted_width_is_met():
    got = decide([want(0.9, 0, 0), want(1.0, 0, 0)], COUNTS, MOST, PORTION, last=False)
    assert got == {"next": COUNTS, "done": True, "why": "met"}


def test_the_next_round_meets_the_most_demanding_row_in_whole_portions():
    got = decide([want(1.4, 3, 20), want(0.9, 0, 0), want(1.2, 9, 0)], COUNTS, MOST, PORTION, last=False)
    assert got == {"next": {"n_3d": 32, "n_0d": 300}, "done": False, "why": None}


def test_no_round_more_than_doubles_and_none_passes_the_bounds():
    assert decide([want(9, 999, 0)], COUNTS, MOST, PORTION, last=False)["next"] == {"n_3d": 32, "n_0d": 200}
    near = {"n_3d": 32, "n_0d": 400}
    assert decide([want(9, 999, 999)], near, MOST, PORTION, last=False)["next"] == MOST


def test_it_stops_at_the_bounds_and_at_the_last_round():
    assert decide([want(9, 999, 999)], MOST, MOST, PORTION, last=False)["why"] == "bounds reached"
    assert decide([want(9, 999, 999)], COUNTS, MOST, PORTION, last=True) == {
        "next": COUNTS, "done": True, "why": "rounds spent"
    }  # fmt: skip
