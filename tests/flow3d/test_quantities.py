"""Statistics over a stenosis region weigh nodes by their area."""

import numpy as np
import pytest

from coronaryuq.flow3d.quantities import area_quantile


def test_the_area_quantile_weighs_nodes_by_area():
    values = np.array([[1.0], [2.0], [3.0]])
    assert area_quantile(values, np.array([1.0, 1.0, 98.0]), 0.5)[0] == pytest.approx(3.0, abs=0.03)
    assert area_quantile(values, np.array([98.0, 1.0, 1.0]), 0.49)[0] == pytest.approx(1.0)
