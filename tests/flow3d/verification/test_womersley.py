"""Pulsating flow through a tube: pressure gradient and wall shear against Womersley, amplitude and phase converging."""

import numpy as np
import pytest

from coronaryuq.bench.flow3d.tubes import womersley


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [2.0, 4.0])
def test_amplitude_and_phase_converge_with_second_order(alpha):
    coarse, fine = womersley(3, 80, alpha), womersley(5, 120, alpha)
    for name in ("gradient", "shear"):
        assert (np.abs(np.abs(fine[name]) - 1) < 0.08).all()
        assert (np.abs(np.degrees(np.angle(fine[name]))) < 7.0).all()
        order = np.log(np.abs(coarse[name] - 1) / np.abs(fine[name] - 1)) / np.log(5 / 3)
        assert (order > 1.6).all(), (name, order)
