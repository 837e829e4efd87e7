"""A smooth stenosis of 60 % in diameter against an axisymmetric solution by another method."""

import numpy as np
import pytest

from coronaryuq.bench.flow3d import axisymmetric
from coronaryuq.bench.flow3d.benchmark import stenosis
from coronaryuq.bench.flow3d.tubes import RADIUS
from coronaryuq.core.units import BLOOD_DENSITY, BLOOD_VISCOSITY


def test_reference_is_exact_for_poiseuille_flow():
    flow = axisymmetric.solve(lambda z: RADIUS + 0 * z, np.linspace(0, 1, 11), 5, 1.0, BLOOD_DENSITY, BLOOD_VISCOSITY)
    assert flow.pressure[0] - flow.pressure[-1] == pytest.approx(8 * BLOOD_VISCOSITY / (np.pi * RADIUS**4), rel=1e-8)
    assert flow.wall_shear[5] == pytest.approx(4 * BLOOD_VISCOSITY / (np.pi * RADIUS**3), rel=1e-8)


@pytest.mark.long
def test_pressure_drop_converges_to_the_reference():
    coarse, fine = (row["drop_error"][0] for row in stenosis((3, 5), (0.4,), levels=72, cells=8))
    assert abs(fine) < 0.04
    assert abs(coarse / fine) > 1.5
