"""Velocity profile at an inlet: developed flow through its cross-section that carries a given flow.

The axial velocity v on the cap's triangles solves ∂v/∂t − ν∇²v = λ(t), v = 0 on the rim, with λ such that ∫v dA is the
flow: Womersley's profile in a circle (Womersley 1955), and its counterpart in any other shape.
"""

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.flow3d.fem.discretisation import BDF2, Cap, Discretisation
from coronaryuq.flow3d.fem.lanes import LANES, entry_of, rows


@njit(cache=True, error_model="numpy")
def _advance(relax, forced, area, now, old, c_now, c_old, flow, new):
    carried = np.zeros(LANES)
    size = now.shape[0]
    for i in range(size):
        for s in range(LANES):
            new[i, s] = 0.0
        for j in range(size):
            for s in range(LANES):
                new[i, s] += entry_of(relax, size * i + j, s) * (c_now * now[j, s] + c_old * old[j, s])
        for s in range(LANES):
            carried[s] += entry_of(area, i, s) * new[i, s]
    for i in range(size):
        for s in range(LANES):
            new[i, s] += entry_of(forced, i, s) * (flow[s] - carried[s])


class InletProfile:
    """Profile of one inlet for LANES samples; velocities are positive into the domain."""

    def __init__(self, space: Discretisation, cap: Cap):
        self.cap = cap
        place = np.full(space.nodes, -1)
        place[cap.nodes] = np.arange(len(cap.nodes))
        self._area = rows(cap.nodal_area)
        relax, forced, steady = zip(
            *(
                _responses(space, space.places[..., k], cap.faces, place, cap.nodal_area[:, k], space.nu[k])
                for k in range(space.places.shape[-1])
            ),
            strict=True,
        )
        self._relax, self._forced = rows(np.stack(relax, axis=-1)), rows(np.stack(forced, axis=-1))
        self.steady = np.stack(steady, axis=-1)
        self.now = np.zeros((len(cap.nodes), LANES))
        self.old = np.zeros_like(self.now)

    def start(self, flow: np.ndarray) -> None:
        """Set the steady developed profile of `flow` (LANES,), mL/s into the domain."""
        self.now[:] = self.steady * flow
        self.old[:] = self.now

    def advance(self, flow: np.ndarray) -> np.ndarray:
        """Return the profile (k, LANES) at the end of a step over which the flow becomes `flow`."""
        new = np.empty_like(self.now)
        _advance(self._relax, self._forced, self._area, self.now, self.old, -BDF2[1], -BDF2[2], flow, new)
        self.old, self.now = self.now, new
        return new


def _responses(space: Discretisation, points, faces, place, area, nu) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how a profile (k,) relaxes over a step (k, k), and the profiles of unit flow: forced and steady (k,)."""
    stiffness, mass = _cap_matrices(points, faces, place, len(area))
    rate = BDF2[0] / space.dt
    inverse = np.linalg.inv(rate * mass + nu * stiffness)
    forced, steady = inverse @ area, np.linalg.solve(stiffness, area)
    return np.ascontiguousarray(inverse @ mass) / space.dt, forced / (area @ forced), steady / (area @ steady)


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
