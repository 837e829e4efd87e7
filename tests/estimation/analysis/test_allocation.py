"""Rounds of a growing campaign: the decision, and a round from files to file."""

import pytest

from coronaryuq.core.io.atomic import read_json
from coronaryuq.estimation.analysis.allocation import allocate, decide
from coronaryuq.estimation.results import Counts, TargetPlan
from coronaryuq.estimation.settings import Settings
from support.small_campaign import LIMITS, write_campaign, write_zerod

COUNTS, MOST, PORTION = Counts(16, 200), Counts(40, 400), Counts(8, 100)


def row_plan(half_width, more_3d, more_0d):
    return TargetPlan("1", 1.0, half_width, more_3d, more_0d, 0.0, 0.0)


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
    assert decide([row_plan(9, 999, 999)], Counts(32, 400), MOST, PORTION, last=False)[0] == MOST


def test_it_stops_at_the_bounds_and_at_the_last_round():
    assert decide([row_plan(9, 999, 999)], MOST, MOST, PORTION, last=False)[2] == "bounds reached"
    assert decide([row_plan(9, 999, 999)], COUNTS, MOST, PORTION, last=True) == (COUNTS, True, "rounds exhausted")


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
