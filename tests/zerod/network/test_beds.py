"""θ and hyperaemia change the resistances of coronary beds."""

import numpy as np
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.beds import beds, distal_resistances, resistance_changes
from coronaryuq.zerod.theta import theta_changes
from support.zerod_networks import MMHG, bifurcation, closed_loop


def test_beds_are_the_coronary_boundary_conditions():
    assert list(beds(closed_loop())) == ["BC_left", "BC_right"]
    assert beds(bifurcation()) == {}
    assert distal_resistances(closed_loop())["BC_left"] == pytest.approx((9.3 + 15.1 + 33.3) * MMHG)


def test_each_factor_multiplies_its_own_resistances():
    r, s = np.array([0.5, 2.0]), np.array([0.7, 1.25])
    changes = resistance_changes(closed_loop(), {"BC_left": r}, s, hyperaemia=0.24)
    assert np.allclose(changes["BC_left.Ra"], 9.3 * MMHG * r * s * 0.24)
    assert np.allclose(changes["BC_left.Ram"], 15.1 * MMHG * r * s * 0.24)
    assert np.allclose(changes["BC_left.Rv"], 33.3 * MMHG * r * s)
    assert np.allclose(changes["BC_right.Rv"], 33.3 * MMHG * s)
    assert np.allclose(changes["BC_right.Ra"], 9.3 * MMHG * s * 0.24)


def test_columns_of_theta_are_read_by_name():
    theta = {"BC_right": np.array([1.5]), "R_cor_scaling": np.array([0.8])}
    changes = theta_changes(closed_loop(), theta)
    assert np.allclose(changes["BC_right.Ra"], 9.3 * MMHG * 1.2) and np.allclose(
        changes["BC_left.Ra"], 9.3 * MMHG * 0.8
    )


def test_an_unknown_bed_and_a_factor_that_is_not_positive_are_errors():
    with pytest.raises(InputError, match="BC_middle"):
        resistance_changes(closed_loop(), {"BC_middle": 1.0})
    with pytest.raises(InputError, match="positive"):
        resistance_changes(closed_loop(), {"BC_left": -1.0})
