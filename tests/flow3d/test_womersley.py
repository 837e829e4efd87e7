"""Pulsating flow through a tube: pressure gradient and wall shear against Womersley, amplitude and phase converging."""

import numpy as np
import pytest
from channels import DENSITY, discretised
from scipy.special import jv

from coronaryuq.flow3d.coupling import LinearCaps
from coronaryuq.flow3d.lanes import LANES
from coronaryuq.flow3d.section import section_weights
from coronaryuq.flow3d.step import Stepper
from coronaryuq.flow3d.wall_shear import WallShear

RADIUS, LENGTH, PERIOD = 0.15, 0.6, 0.4
FLOW = 1.0


def harmonic(signal, times):
    """Complex amplitude of the first harmonic of samples (steps, LANES) over one period."""
    return 2.0 * (signal * np.exp(-2j * np.pi * times / PERIOD)[:, None]).mean(axis=0)


def responses(rings, steps, alpha):
    """Pressure gradient and wall shear over exact ones, complex (LANES,), for flow 1.3 + cos ωt."""
    nu = RADIUS**2 * (2 * np.pi / PERIOD) / alpha**2
    space = discretised(LENGTH, RADIUS, rings, 3 * rings, PERIOD / steps, viscosity=nu * DENSITY)
    stepper, wall = Stepper(space), WallShear(space)
    flow = FLOW * np.linspace(0.5, 1.5, LANES)
    caps = LinearCaps(
        [0, 1], [1, 0], lambda t: np.stack([-flow * (1.3 + np.cos(2 * np.pi * t / PERIOD)), 0 * flow]), PERIOD / steps
    )
    stepper.start(np.zeros((2, LANES)), np.zeros((2, LANES)))
    sections = [section_weights(space.points, space.tets, [0, 0, z], [0, 0, 1])[:2] for z in (0.2, 0.4)]
    height = space.points[wall.nodes, 2]
    middle = (height > 0.2) & (height < 0.4)
    area = wall.area[middle, None] / wall.area[middle].sum()
    cycles, gradient, shear, times = 3, [], [], []
    for step in range(cycles * steps):
        stepper.step(caps)
        if step >= (cycles - 1) * steps:
            low, high = ((weight[:, None] * stepper.pressure[nodes]).sum(axis=0) for nodes, weight in sections)
            wall.sample(stepper, 1.0)
            gradient.append((low - high) / 0.2)
            shear.append((area * wall.stress[middle, 2]).sum(axis=0))
            times.append((step + 1) * PERIOD / steps)
    times = np.array(times)
    omega = 2 * np.pi / PERIOD
    argument = 1j**1.5 * alpha
    share = 2 * jv(1, argument) / (argument * jv(0, argument))
    exact_gradient = flow * 1j * omega * DENSITY / (np.pi * RADIUS**2 * (1 - share))
    exact_shear = exact_gradient * RADIUS / 2 * share
    return harmonic(np.array(gradient), times) / exact_gradient, harmonic(np.array(shear), times) / exact_shear


@pytest.mark.parametrize("alpha", [2.0, 4.0])
def test_amplitude_and_phase_converge(alpha):
    coarse, fine = responses(3, 80, alpha), responses(6, 160, alpha)
    for quantity in range(2):
        amplitude = [np.abs(np.abs(r[quantity]) - 1).max() for r in (coarse, fine)]
        phase = [np.abs(np.degrees(np.angle(r[quantity]))).max() for r in (coarse, fine)]
        assert amplitude[1] < 0.05, (quantity, amplitude)
        assert phase[1] < 6.0, (quantity, phase)
        error = [np.hypot(a, np.radians(p)) for a, p in zip(amplitude, phase, strict=True)]
        assert np.log2(error[0] / error[1]) > 1.6, (quantity, error)
