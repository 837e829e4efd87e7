"""What does an adopted stenosis, drawn into a straight vessel of 3 mm, lose in 3D over what its 0D law says?

Steady flow through the shape of `case.lumen.narrowing`, axisymmetric and by the 3D solver on structured meshes; the
growth of the pressure drop over that of the tube without a stenosis, to the outlet 7.5 diameters behind the stenosis.

    python benchmarks/adopted_narrowing.py [CELLS_OVER_THE_RADIUS ...]
"""

import sys

import numpy as np

from coronaryuq.bench.flow3d import axisymmetric, tubes
from coronaryuq.case.lumen.narrowing import LENGTH, stenosis
from coronaryuq.case.network.build import Physics, shape_integrals, stenosis_coefficient
from coronaryuq.core.units import BLOOD_DENSITY, BLOOD_VISCOSITY, MMHG
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES

RADIUS, END, PLACE, FLOW = tubes.RADIUS, 4.2, 1.5, 1.5
"""cm, cm, cm and mL/s."""
THROATS = (1.0, 0.72, 0.61, 0.49, 0.44, 0.39)
"""Radii of the throat over the vessel's; the first is the tube."""
TIME, STEP = 0.6, 1e-3
"""s."""
ARC = np.linspace(0.0, END, 2001)


def radii(throat: float) -> np.ndarray:
    half = LENGTH * RADIUS
    arc = np.linspace(PLACE - half, PLACE + half, 201)
    shape = stenosis(arc, np.full(201, RADIUS), PLACE, coefficient(throat), Physics())
    return RADIUS * shape.ratio(ARC)


def coefficient(throat: float) -> float:
    return stenosis_coefficient(throat**2, RADIUS, Physics())


def exact(lumen: np.ndarray) -> float:
    """Return the drop, dyn/cm2, of the axisymmetric flow."""
    levels = np.linspace(0.0, END, 211)
    flow = axisymmetric.solve(lambda z: np.interp(z, ARC, lumen), levels, 12, FLOW, BLOOD_DENSITY, BLOOD_VISCOSITY)
    return float(flow.pressure[0] - flow.pressure[-1])


def in_3d(lumens: list[np.ndarray], cells: int) -> np.ndarray:
    """Return drops, dyn/cm2, by the 3D solver."""
    spaces = [
        tubes.discretised(END, lambda z, own=own: np.interp(z, ARC, own), cells, 20 * cells, STEP) for own in lumens
    ]
    space = Discretisation.of_lanes(spaces + [spaces[-1]] * (LANES - len(spaces)), spaces[0])
    return tubes.steady(space, np.full(LANES, FLOW), TIME).cap_pressure[0][: len(lumens)]


def main() -> None:
    lumens = [radii(throat) for throat in THROATS]
    law = np.array([coefficient(throat) for throat in THROATS[1:]]) * FLOW**2
    friction = np.array([8.0 * BLOOD_VISCOSITY / np.pi * float(shape_integrals(own, ARC)[0]) * FLOW for own in lumens])
    drops = {"axisymmetric": np.array([exact(own) for own in lumens])}
    drops |= {f"{cells} cells": in_3d(lumens, int(cells)) for cells in sys.argv[1:]}
    print("throat", THROATS[1:], "law, mmHg", np.round(law / MMHG, 2), "friction, over law", growth(friction) / law)
    for name, drop in drops.items():
        print(f"{name}: tube over Poiseuille {drop[0] / friction[0]:.3f}, growth over law {growth(drop) / law}")


def growth(drops: np.ndarray) -> np.ndarray:
    return np.round(drops[1:] - drops[0], 3)


if __name__ == "__main__":
    np.set_printoptions(precision=3)
    main()
