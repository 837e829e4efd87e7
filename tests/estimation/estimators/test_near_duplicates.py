"""Near-duplicates against all pairs."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.near_duplicates import linked


@settings(max_examples=60, deadline=None)
@given(
    m=st.integers(2, 150), d=st.integers(1, 6), radius=st.sampled_from([1e-12, 0.01, 0.1, 0.5, 3.0]),
    repeated=st.integers(0, 20), seed=st.integers(0, 99),
)  # fmt: skip
def test_components_are_those_of_all_pairs(m, d, radius, repeated, seed):
    rng = generator(3, "near-duplicates", seed)
    points = rng.normal(size=(m, d))
    points[rng.integers(m, size=repeated)] = points[rng.integers(m, size=repeated)]
    points = np.round(points, 2) if seed % 2 else points
    apart = np.abs(points[:, None] - points[None]).max(axis=2)
    assert np.array_equal(linked(points, radius), connected_components(apart <= radius, directed=False)[1])
