"""Rounds of a growing campaign: the decision, and a round from files to file."""

import pytest

from coronaryuq.core.io.atomic import read_json
from coronaryuq.estimation.analysis.allocation import allocate, decide
from coronaryuq.estimation.results import Bounds, Counts, TargetPlan
from coronaryuq.estimation.settings import Settings
from support.small_campaign import LIMITS, write_campaign, write_zerod

COUNTS, MOST, PORTION = Counts(16, 200), Bounds(40, 400, 4), Counts(8, 100)


def row_plan(half_width, more_3d, more_0d, longer_chain=1.0):
    return TargetPlan("1", 1.0, half_width, more_3d, more_0d, 0.0, 0.0, longer_chain)


def test_it_stops_when_every_target_width_is_met():
    assert decide([row_plan(0.9, 0, 0), row_plan(1.0, 0, 0)], COUNTS, MOST, PORTION, last=False) == (
        COUNTS,
        True,
        "met",
    )


def test_the_next_round_meets_the_most_demanding_row_in_whole_portions():
    plan = [row_plan(1.4, 3, 20), row_plan(0.9, 0, 0), row_plan(1.2, 9, 0)]
    assert decide(plan, COUNTS, MOST, PORTION, last=False) == (Counts(32, 300), False, None)


def test_no_round_more_than_doubles_the_runs_or_exceeds_the_bounds():
    assert decide([row_plan(9, 999, 0)], COUNTS, MOST, PORTION, last=False)[0] == Counts(32, 200)
    assert decide([row_plan(9, 999, 999)], Counts(32, 400), MOST, PORTION, last=False)[0] == Counts(40, 400)


def test_it_stops_at_the_bounds_and_at_the_last_round():
    assert decide([row_plan(9, 999, 999)], Counts(40, 400), MOST, PORTION, last=False)[2] == "bounds reached"
    assert decide([row_plan(9, 999, 999)], COUNTS, MOST, PORTION, last=True) == (COUNTS, True, "rounds exhausted")


LONGER = ((0, 1), (200, 2))


def test_chains_that_limit_the_error_are_doubled_together_with_the_propagation_samples():
    plan = [row_plan(1.4, 0, 0, longer_chain=1.3), row_plan(1.2, 3, 20)]
    assert decide(plan, COUNTS, MOST, PORTION, last=False) == (Counts(24, 400, LONGER), False, None)
    met = [row_plan(0.9, 0, 0, longer_chain=1.3), row_plan(1.2, 3, 20)]
    assert decide(met, COUNTS, MOST, PORTION, last=False)[0] == Counts(24, 300), "long enough for the row that is met"


def test_samples_of_jobs_that_have_run_are_not_drawn_from_the_longer_chains():
    """Of 250 samples, 300 have been run: three jobs of 100."""
    most = Bounds(40, 1000, 4)
    following, _, _ = decide([row_plan(1.4, 0, 0, 1.3)], Counts(16, 250), most, PORTION, last=False)
    assert following == Counts(16, 500, ((0, 1), (300, 2)))
    again, _, _ = decide([row_plan(1.4, 0, 0, 1.3)], following, most, PORTION, last=False)
    assert again == Counts(16, 1000, ((0, 1), (300, 2), (500, 4)))


@pytest.mark.parametrize(
    ("counts", "most", "why"),
    [
        (Counts(16, 400, ((0, 1), (100, 2), (200, 4))), Bounds(40, 1600, 4), "chain too short"),
        (Counts(16, 400, LONGER), Bounds(40, 1600, 3), "chain too short"),
        (Counts(16, 400, LONGER), Bounds(40, 400, 4), "bounds reached"),
        (Counts(16, 350, LONGER), Bounds(40, 390, 4), None),
    ],
)
def test_chains_are_too_short_only_where_they_may_not_be_longer(counts, most, why):
    """Without another job of propagation samples, longer chains would not be visited."""
    following, done, found = decide([row_plan(1.4, 0, 0, 1.3)], counts, most, PORTION, last=False)
    assert (found, done, following.lengths) == (why, why is not None, counts.lengths)


@pytest.mark.slow
def test_the_runs_of_the_next_round_do_not_depend_on_cpu_times(tmp_path, capsys):
    """Half-widths are not met, so the plan decides; bytes of its file after runs of quite different CPU times."""
    inputs = write_campaign(tmp_path)
    settings = Settings(target_half_width={"ffr_flow_lad": 1e-3}, max_3d=48, max_0d=200, min_3d=4, cost_ratio=0.01)
    written = []
    for cpu_s in (0.5, 0.004):
        write_zerod(tmp_path, cpu_s=cpu_s)
        allocate(inputs, LIMITS, settings, 1, 0, Counts(12, 20), Counts(4, 10), tmp_path / "round_0.json")
        written.append((tmp_path / "round_0.json").read_bytes())
    assert written[0] == written[1] and not read_json(tmp_path / "round_0.json")["done"]
    first, second = capsys.readouterr().out.strip().splitlines()
    assert first.endswith("measured so far: 0.25; declare cost_ratio: 0.2 for a cheaper plan")
    assert second.endswith("measured so far: 0.002; declare cost_ratio: 0.002 for a cheaper plan")
