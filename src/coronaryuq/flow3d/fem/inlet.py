"""Velocity profile at an inlet: developed flow through its cross-section that carries a given flow.

The axial velocity v on the cap's triangles solves ∂v/∂t − ν∇²v = λ(t), v = 0 on the rim, with λ such that ∫v dA is the
flow: Womersley's profile in a circle (Womersley 1955), and its counterpart in any other shape.
"""

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.flow3d.fem.discretisation import BDF2, Cap, Discretisation
from coronaryuq.flow3d.fem.lanes import LANES


@njit(cache=True, error_model="numpy")
def _advance(relax, forced, area, now, old, c_now, c_old, flow, new):
    carried = np.zeros(LANES)
    for i in range(relax.shape[0]):
        for s in range(LANES):
            new[i, s] = 0.0
        for j in range(relax.shape[1]):
            w = relax[i, j]
            for s in range(LANES):
                new[i, s] += w * (c_now * now[j, s] + c_old * old[j, s])
        for s in range(LANES):
            carried[s] += area[i] * new[i, s]
    for i in range(relax.shape[0]):
        for s in range(LANES):
            new[i, s] += forced[i] * (flow[s] - carried[s])


class InletProfile:
    """Profile of one inlet for LANES samples; velocities are positive into the domain."""

    def __init__(self, space: Discretisation, cap: Cap):
        self.cap = cap
        place = np.full(space.nodes, -1)
        place[cap.nodes] = np.arange(len(cap.nodes))
        stiffness, mass = _cap_matrices(space.points, cap.faces, place, len(cap.nodes))
        rate = BDF2[0] / space.dt
        inverse = np.linalg.inv(rate * mass + space.nu * stiffness)
        self._relax = np.ascontiguousarray(inverse @ mass) / space.dt
        load = cap.nodal_area
        self._area = load
        forced = inverse @ load
        self._forced = forced / (load @ forced)
        steady = np.linalg.solve(stiffness, load)
        self.steady = steady / (load @ steady)
        self.now = np.zeros((len(cap.nodes), LANES))
        self.old = np.zeros_like(self.now)

    def start(self, flow: np.ndarray) -> None:
        """Set the steady developed profile of `flow` (LANES,), mL/s into the domain."""
        self.now[:] = self.steady[:, None] * flow
        self.old[:] = self.now

    def advance(self, flow: np.ndarray) -> np.ndarray:
        """Return the profile (k, LANES) at the end of a step over which the flow becomes `flow`."""
        new = np.empty_like(self.now)
        _advance(self._relax, self._forced, self._area, self.now, self.old, -BDF2[1], -BDF2[2], flow, new)
        self.old, self.now = self.now, new
        return new


def _cap_matrices(points, faces, place, size):
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    for face in faces:
        corner = points[face]
        edge = corner[[2, 0, 1]] - corner[[1, 2, 0]]
        area = np.linalg.norm(np.cross(edge[0], edge[1])) / 2.0
        at = place[face]
        for a in range(3):
            for b in range(3):
                if at[a] >= 0 and at[b] >= 0:
                    stiffness[at[a], at[b]] += edge[a] @ edge[b] / (4.0 * area)
                    mass[at[a], at[b]] += area * (2.0 if a == b else 1.0) / 12.0
    return stiffness, mass
