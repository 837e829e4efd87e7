"""Waveforms on the grid that all of them share."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import PERIOD, left_coronary
from coronaryuq.zerod.effects.intramyocardial import waveform
from coronaryuq.zerod.network.waveforms import WAVE_POINTS, resampled, sampled


def test_a_waveform_of_one_value_is_constant():
    network = left_coronary()
    network["boundary_conditions"][1]["bc_values"]["Pim"] = [12.0]
    assert sampled(network, "BC_lad.Pim").tolist() == [12.0] * WAVE_POINTS
    assert waveform(network, "BC_lad", 0.85)[1].tolist() == [12.0] * WAVE_POINTS


def test_a_waveform_is_resampled_over_its_own_times_or_an_even_grid():
    time = np.array([0.0, 0.1, 0.5, PERIOD])
    grid = np.linspace(0.0, PERIOD, WAVE_POINTS)
    assert resampled(2.0 * time, time) == pytest.approx(2.0 * grid, abs=1e-12)
    assert resampled(np.array([0.0, PERIOD])) == pytest.approx(grid, abs=1e-12)
