"""Samples of θ: which states they are, for chains that are made longer on the way."""

import numpy as np
import pandas as pd
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.posterior.samples import theta

BEDS = ["BC_a", "BC_b"]
PART = 60
"""Rows of the table of draws for each length of the chains."""


def table(length):
    """Draws whose multiplier tells their row."""
    rows = np.arange(PART * length)
    return pd.DataFrame(
        {"chain": rows % 6, "generation": rows // 6, "BC_a": rows + 1.0, "BC_b": 1.0, "log_density": 0.0}
    )


def drawn(count, lengths):
    return theta(table(lengths[-1][1]), BEDS, "propagation", count, (0.7, 1.25), 3, lengths)


steps = st.lists(st.integers(1, 80), min_size=1, max_size=4)


@given(steps, st.integers(1, 80))
def test_longer_chains_change_no_earlier_sample(grown, more):
    firsts = np.concatenate([[0], np.cumsum(grown)])
    lengths = [(int(first), 2**k) for k, first in enumerate(firsts)]
    longest = drawn(int(firsts[-1]) + more, lengths)
    for k, first in enumerate(firsts[1:]):
        assert drawn(int(first), lengths[: k + 1]).equals(longest.iloc[:first])


def test_samples_spread_over_the_new_part_first_and_then_over_all():
    def visits(count):
        rows = drawn(count, [(0, 1), (40, 2), (80, 4)])["BC_a"].to_numpy() - 1
        return np.bincount((rows // PART).astype(int), minlength=4).tolist()

    assert visits(60) == [40, 20, 0, 0]
    assert visits(80) == [40, 40, 0, 0], "as many samples of every part once their number has doubled, too"
    assert visits(160) == [40, 40, 40, 40]
    assert visits(400) == [100, 100, 100, 100]


def test_every_stretch_of_a_part_is_visited_equally_often():
    rows = drawn(240, [(0, 1), (60, 4)])["BC_a"].to_numpy() - 1
    assert np.ptp(np.bincount((rows // 20).astype(int), minlength=12)) <= 2


def test_a_scaling_that_was_inferred_is_that_of_the_draw():
    draws = table(1).assign(R_cor_scaling=np.arange(PART) / 7.0)
    samples = theta(draws, BEDS, "propagation", 50, (0.7, 1.25), 3)
    assert np.array_equal(samples["R_cor_scaling"], (samples["BC_a"] - 1.0) / 7.0)
