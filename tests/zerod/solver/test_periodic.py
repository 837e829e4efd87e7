"""Acceleration leads to the same periodic state as waiting, in fewer cycles."""

import numpy as np
import pytest

from coronaryuq.zerod.solver.periodic import Periodicity
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
