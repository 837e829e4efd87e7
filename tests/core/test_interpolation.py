"""Waveforms at the times at which they were measured."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.interpolation import interpolated
from coronaryuq.core.seeds import generator


@given(st.integers(0, 10**6), st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4))
def test_waves_are_interpolated_to_the_bits_of_numpy(seed, late):
    random = generator(seed, "test", "interpolation")
    waves, grid, time = random.standard_normal((4, 31)), np.linspace(0.0, 0.8, 31), random.uniform(0.0, 0.8, 17)
    found = interpolated(waves, 0.8, time, np.array([late[0], late[0], *late[2:]]), 0.8)
    for own, wave, shift in zip(found, waves, [late[0], late[0], *late[2:]], strict=True):
        assert own.tolist() == np.interp((time - shift) % 0.8, grid, wave).tolist()
