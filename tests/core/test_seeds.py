"""Random numbers depend on seed and name only."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.seeds import generator

names = st.lists(st.one_of(st.text(max_size=8), st.integers(0, 10**6)), min_size=1, max_size=4)


@given(st.integers(0, 2**31), names)
def test_the_same_name_gives_the_same_numbers(seed, name):
    assert np.array_equal(generator(seed, *name).random(4), generator(seed, *name).random(4))


@given(st.integers(0, 2**31), names, names)
def test_different_names_give_different_numbers(seed, name, other):
    if name != other:
        assert not np.array_equal(generator(seed, *name).random(4), generator(seed, *other).random(4))


def test_a_number_and_its_text_are_different_names():
    assert generator(1, 2).random() != generator(1, "2").random()


def test_numpy_integers_give_the_same_stream_as_python_integers():
    assert generator(1, np.int64(2)).random() == generator(1, 2).random()


def test_streams_of_neighbouring_indices_are_uncorrelated():
    draws = np.array([generator(7, "realisation", k).normal(size=200) for k in range(200)])
    correlation = np.corrcoef(draws)[np.triu_indices(200, 1)]
    assert abs(correlation.mean()) < 4 / np.sqrt(200 * len(correlation))
    assert np.isclose(correlation.std(), 1 / np.sqrt(200), rtol=0.05)
