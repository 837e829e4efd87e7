"""How the counts of a campaign are cut into jobs."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.campaign.targets import Targets, portions, within
from coronaryuq.config import Campaign


def targets(**blocks):
    return Targets(Campaign(name="x", samples={"n_3d": 16, "n_0d": 64, "batch_3d": 8, "chunk_0d": 32}, **blocks))


@given(st.integers(0, 5000), st.integers(1, 700))
def test_portions_cover_every_sample_once(total, size):
    cut = portions(total, size)
    assert [k for first, count in cut.values() for k in range(first, first + count)] == list(range(total))


@given(st.integers(1, 3000), st.integers(0, 3000), st.integers(1, 700))
def test_more_samples_only_fill_the_last_portion_or_add_portions(total, more, size):
    before, after = portions(total, size), portions(total + more, size)
    assert all(after[k] == before[k] for k in list(before)[:-1])
    assert set(before) <= set(after)


def test_portions_of_the_first_samples():
    assert within(portions(100, 30), 60) == [0, 1] and within(portions(100, 30), 61) == [0, 1, 2]


def test_a_campaign_without_growth_runs_its_counts():
    assert targets().needed({"n_3d": 16, "n_0d": 64}) == {
        "flow3d": [0, 1],
        "coarse": [],
        "zerod_pilot": [0],
        "zerod_propagation": [0, 1],
    }


def test_a_coarse_level_continues_the_table_of_the_pilot():
    coarse = targets(flow3d={"coarse": {"runs_per_fine": 4}})
    assert coarse.counts["pilot"] == 64 and len(coarse.coarse_batches) == 8
    assert coarse.needed(coarse.first_counts)["zerod_pilot"] == [0, 1]
    assert coarse.coarse_tables and not targets().coarse_tables


@pytest.mark.parametrize("most", [{"max_3d": 64}, {"max_3d": 64, "max_0d": 256}])
def test_a_growing_campaign_draws_inputs_for_the_most_it_may_run(most):
    growing = targets(estimation={"target_half_width": {"ffr": 0.01}, **most})
    assert growing.grows and growing.counts == {"pilot": 64, "propagation": most.get("max_0d", 64)}
    assert growing.needed(growing.first_counts)["flow3d"] == [0, 1]
