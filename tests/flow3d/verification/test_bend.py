"""Flow in a bend: the reference against Dean's series, the 3D solver against the reference."""

import numpy as np
import pytest

from coronaryuq.bench.flow3d import bend, torus

DENSITY, VISCOSITY, RADIUS = 1.06, 0.04, 0.15


@pytest.mark.parametrize("dean", [60.0, 120.0, 240.0])
def test_a_weak_bend_carries_the_flow_of_deans_series(dean):
    """Dean 1928: Q/Q0 = 1 − 0.0306 (K/576)² + 0.0120 (K/576)⁴, K = 2 Re² a/R, as a/R goes to zero."""
    around = 5000.0
    reynolds = np.sqrt(dean * around / RADIUS / 2)
    speed = reynolds * VISCOSITY / DENSITY / (2 * RADIUS)

    def flow(density):
        gradient = 8 * VISCOSITY * speed / RADIUS**2
        return torus.solve(RADIUS, around, gradient, 6, density, VISCOSITY).flow

    share = flow(DENSITY) / flow(1e-6)  # over the straight tube's, on the same mesh
    series = 1 - 0.0306 * (dean / 576) ** 2 + 0.0120 * (dean / 576) ** 4
    assert 1 - share == pytest.approx(1 - series, rel=0.01)


def test_the_forces_on_the_wall_balance_the_fall_of_pressure():
    gradient = 50.0
    flow = torus.solve(RADIUS, 1.0, gradient, 6, DENSITY, VISCOSITY)
    # Moments about the axis of the torus: pressure on the cross-section, shear on the wall at a distance r.
    r = 1.0 - RADIUS * np.cos(flow.angle)
    assert np.mean(flow.along * r**2) * 2 * np.pi * RADIUS == pytest.approx(gradient * np.pi * RADIUS**2, rel=3e-3)
    assert flow.around.max() < 1e-3 * flow.along.mean()  # along the wall back to the inside


@pytest.mark.long
def test_pressure_and_wall_shear_in_a_bend_converge_with_second_order():
    reynolds = np.array([10.0, 50.0, 100.0, 200.0])
    coarse, fine = bend.errors(4, reynolds), bend.errors(6, reynolds)
    assert np.abs(fine["gradient"]).max() < 0.025 and np.abs(fine["shear"]).max() < 0.02
    assert fine["shear_rms"].max() < 0.05 and np.abs(fine["around"]).max() < 0.04
    for name in ("gradient", "shear"):
        order = np.log(np.abs(coarse[name][:2] / fine[name][:2])) / np.log(6 / 4)
        assert (order > 1.7).all(), (name, order)
