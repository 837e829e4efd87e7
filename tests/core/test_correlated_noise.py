"""White noise and shapes make up the correlations that they stand for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.correlated_noise import white_and_shapes

PLACES = st.lists(st.integers(0, 40), min_size=2, max_size=20)


@given(PLACES)
def test_the_parts_make_up_the_correlations_of_any_places_two_alike_included(places):
    """With two at one place, the smallest variance is zero or, rounded, less: all noise was then taken for white."""
    apart = np.abs(np.subtract.outer(places, places)) / 4.0
    correlation = np.exp(-apart)
    white, shapes = white_and_shapes(correlation, 1.05)
    assert white**2 * np.eye(len(places)) + shapes.T @ shapes == pytest.approx(correlation, abs=0.06)
