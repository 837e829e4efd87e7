"""Acceleration leads to the same periodic state as waiting, in fewer cycles."""

import numpy as np
import pytest

from coronaryuq.zerod.solver.periodic import STALLED, Periodicity, drift
from support.zerod_networks import LOOP_PARAMETERS, varied


@pytest.mark.slow
def test_a_periodic_state_is_the_one_that_waiting_finds(fine_loop):
    changes = varied(fine_loop, 6, LOOP_PARAMETERS)
    names = ["mean_flow:left:BC_left", "max_pressure:CLH:J_heart_outlet", "min_V_LV:CLH"]
    start = fine_loop.run_to_periodic().state[0]
    accelerated = fine_loop.run_to_periodic(changes, names, periodicity=Periodicity(tolerance=1e-5), start=start)
    waited = fine_loop.run_cycles(changes, names, cycles=120, start=start)
    assert list(accelerated.status) == ["ok"] * 6
    assert accelerated.cycle_error.max() < 1e-5
    for name in names:
        assert np.allclose(accelerated.values[name], waited.values[name], rtol=2e-4), name


def test_acceleration_takes_fewer_cycles_than_waiting(fine_loop):
    changes = varied(fine_loop, 16, LOOP_PARAMETERS)
    start = fine_loop.run_to_periodic().state[0]
    fast = fine_loop.run_to_periodic(changes, start=start)
    slow = fine_loop.run_to_periodic(changes, periodicity=Periodicity(accelerate=False), start=start)
    assert fast.cycles.mean() < 0.8 * slow.cycles.mean()


def test_a_sample_that_does_not_become_periodic_has_that_status(loop):
    result = loop.run_to_periodic(periodicity=Periodicity(cycles=2, tolerance=1e-9))
    assert result.status[0].startswith("not periodic after 2 cycles")


def test_a_flow_that_is_zero_but_for_rounding_does_not_keep_a_sample_from_being_periodic():
    """Two flows, of which the second decays from the start's error, and a pressure."""
    before, after = np.array([[10.0, 1e-8, 100.0]]), np.array([[10.001, 0.0, 100.0]])
    low, high = np.array([[0.0, 0.0, 80.0]]), np.array([[20.0, 1e-8, 120.0]])
    error, scale = drift(before, after, low, high, np.array([0, 0, 1]))
    assert error[0] == pytest.approx(0.001 / 20.0)
    assert scale[0, 0] == 20.0 and scale[0, 2] == 40.0


def test_a_sample_that_no_longer_approaches_its_tolerance_is_accepted_below_the_loose_one():
    rule = Periodicity(tolerance=1e-4, patience=6, loose=5e-3)
    error = np.array([9e-5, 2e-3, 2e-3, 2e-2, 2e-2])
    waited = np.array([0, STALLED - 1, STALLED, STALLED, 6])
    assert rule.over(error, waited).tolist() == [True, False, True, False, True]
    assert rule.accepted == 5e-3 and Periodicity(tolerance=1e-4).accepted == 1e-4
