"""A swirling flow kept up by a body force: velocity converges with second order."""

import numpy as np
import pytest

from coronaryuq.bench.flow3d.tubes import manufactured


@pytest.mark.slow
def test_velocity_error_converges_with_second_order():
    errors = [manufactured(rings) for rings in (3, 5)]
    assert errors[1] < 0.04
    assert np.log(errors[0] / errors[1]) / np.log(5 / 3) > 1.8
