"""What all samples share: mesh, operators, one pressure factor, and what each cap needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.fem import elements
from coronaryuq.flow3d.fem.arrays import Elements, Motion, Pattern
from coronaryuq.flow3d.fem.cholesky import Cholesky

BDF2 = (1.5, -2.0, 0.5)
"""Second-order backward difference: (1.5 u_new − 2 u + 0.5 u_old)/Δt."""


@dataclass(frozen=True)
class Cap:
    """A flat end: `area` cm2, outward unit `normal`, `centre`, `nodes` off the wall with their lumped area."""

    name: str
    inlet: bool
    faces: np.ndarray
    nodes: np.ndarray
    nodal_area: np.ndarray
    normal: np.ndarray
    centre: np.ndarray
    area: float


class Discretisation:
    """Operators of one mesh for one time step, in the solver's own node order (reverse Cuthill-McKee).

    `node_of[i]` is the mesh node of the solver's node i.

    Parameters
    ----------
    points, tets
        (n, 3) nodes in cm and (m, 4) tetrahedra.
    caps
        Cap name → (k, 3) triangles; the other boundary faces are wall.
    inlets
        Names of the caps where blood enters; their flow prescribes the velocity profile.
    dt
        Time step, s.
    density, viscosity
        g/cm3 and poise.
    reference_speed
        cm/s; sets the pressure stabilisation, h / (2 speed) where convection dominates; one for all samples.
    """

    def __init__(
        self,
        points: np.ndarray,
        tets: np.ndarray,
        caps: Mapping[str, np.ndarray],
        inlets: Sequence[str],
        dt: float,
        density: float,
        viscosity: float,
        reference_speed: float = 100.0,
    ):
        for name in inlets:
            if name not in caps:
                raise InputError("mesh", "inlet", name, f"no such cap; the mesh has {', '.join(caps)}")
        self.density, self.viscosity, self.nu, self.dt = density, viscosity, viscosity / density, dt
        n = len(points)
        tets = elements.oriented(points, tets)
        volume, grad = elements.gradients(points, tets)
        order = _node_order(elements.laplacian(tets, volume, grad, n))
        self.node_of = order
        place = np.empty(n, np.int64)
        place[order] = np.arange(n)
        points = points[order]
        tets = place[tets]
        sort = np.argsort(tets.min(axis=1), kind="stable")
        tets, volume, grad = tets[sort], volume[sort], grad[sort]
        self.points, self.nodes = points, n
        self.elements = Elements(tets.astype(np.int32), np.ascontiguousarray(grad), volume)
        self.mass = elements.lumped_mass(tets, volume, n)

        faces = elements.boundary_faces(tets)
        self.caps, self.wall_faces = _caps(points, faces, {k: place[v] for k, v in caps.items()}, set(inlets))
        self.wall = np.zeros(n, bool)
        self.wall[self.wall_faces] = True
        cap_of = np.full(n, -1, np.int32)
        free = ~self.wall
        for c, cap in enumerate(self.caps):
            cap_of[cap.nodes] = c
            if cap.inlet:
                free[cap.nodes] = False
        normal = np.array([cap.normal for cap in self.caps]).reshape(-1, 3)
        self.motion = Motion(free, np.flatnonzero(free).astype(np.int32), cap_of, normal)

        stiffness = elements.laplacian(tets, volume, grad, n)
        start, column = stiffness.indptr.astype(np.int64), stiffness.indices.astype(np.int32)
        diagonal = np.flatnonzero(np.repeat(np.arange(n), np.diff(start)) == column)
        self.pattern = Pattern(start, column, diagonal)
        self.slot = _slots(start, column, tets)
        derivatives = elements.gradient_operators(tets, volume, grad, n)
        self.gradient = tuple(g.data for g in derivatives)
        # The pattern is symmetric, so the transposed operators have it too.
        self.divergence = tuple(g.T.tocsr().data for g in derivatives)

        rate = BDF2[0] / dt
        self.mass_rate = rate
        self.constant = self.nu * stiffness.data
        self.constant[diagonal] += rate * self.mass
        metric = np.einsum("eak,eak->e", grad, grad)
        self.tau_viscous = (3.0 * self.nu * metric) ** 2
        tau_element = 1.0 / np.sqrt(reference_speed**2 * metric / 1.5 + self.tau_viscous)
        self.tau = np.bincount(tets.ravel(), np.repeat(tau_element * volume / 4.0, 4), n) / self.mass
        tau_element = self.tau[tets].mean(axis=1)
        self.spread = elements.laplacian(tets, volume, grad, n, tau_element).data
        pressure = sp.csr_matrix((stiffness.data / rate + self.spread, column, start), shape=(n, n))
        self._pressure(pressure)

    def _pressure(self, matrix: sp.csr_matrix) -> None:
        """Factor the pressure matrix inside the caps, lift each cap's pressure, and compute the caps' admittance."""
        cap_nodes = [np.unique(cap.faces) for cap in self.caps]
        inside = np.ones(self.nodes, bool)
        for nodes in cap_nodes:
            inside[nodes] = False
        self.inside = np.flatnonzero(inside)
        self.factor = Cholesky(matrix[self.inside][:, self.inside], rows=self.inside)
        self.cap_nodes = cap_nodes
        self.lift = np.zeros((self.nodes, len(self.caps)))
        edge = np.zeros((self.nodes, len(self.caps)))
        for c, nodes in enumerate(cap_nodes):
            self.lift[nodes, c] = 1.0
            edge[:, c] = np.asarray(matrix[:, nodes].sum(axis=1)).ravel()
        self.lift[self.inside] = -self.factor.solve_columns(edge[self.inside])
        self.admittance = self.lift.T @ (matrix @ self.lift)
        near = np.flatnonzero(inside & (edge != 0).any(axis=1))
        self.near_caps, self.near_weight = near, np.ascontiguousarray(edge[near])


def _node_order(pattern: sp.csr_matrix) -> np.ndarray:
    """Return the reverse Cuthill-McKee order, one connected part after the other."""
    parts, label = connected_components(pattern, directed=False)
    order = []
    for part in range(parts):
        nodes = np.flatnonzero(label == part)
        order.append(nodes[reverse_cuthill_mckee(pattern[nodes][:, nodes].tocsr(), symmetric_mode=True)])
    return np.concatenate(order)


def _slots(start: np.ndarray, column: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Return where entry (tets[e, a], tets[e, b]) lies in the data of the sparse pattern, (m, 4, 4)."""
    n = len(start) - 1
    key = np.repeat(np.arange(n, dtype=np.int64), np.diff(start)) * n + column
    wanted = tets[:, :, None].astype(np.int64) * n + tets[:, None, :]
    return np.searchsorted(key, wanted).astype(np.int32)


def _caps(
    points: np.ndarray, faces: np.ndarray, caps: Mapping[str, np.ndarray], inlets: set[str]
) -> tuple[list[Cap], np.ndarray]:
    key = {tuple(sorted(face)): k for k, face in enumerate(faces.tolist())}
    of_cap = np.full(len(faces), -1)
    names = list(caps)
    for c, name in enumerate(names):
        for face in caps[name].tolist():
            k = key.get(tuple(sorted(face)))
            if k is None:
                raise InputError("mesh", f"cap {name}", None, "has a triangle that is not on the mesh's boundary")
            of_cap[k] = c
    wall_faces = faces[of_cap < 0]
    on_wall = np.zeros(len(points), bool)
    on_wall[wall_faces] = True
    out = []
    for c, name in enumerate(names):
        mine = faces[of_cap == c]
        vector = elements.face_vectors(points, mine)
        size = np.linalg.norm(vector, axis=1)
        if not len(mine):
            raise InputError("mesh", f"cap {name}", None, "has no triangles")
        nodal = np.bincount(mine.ravel(), np.repeat(size / 3.0, 3), len(points))
        nodes = np.flatnonzero((nodal > 0) & ~on_wall)
        if not len(nodes):
            raise InputError("mesh", f"cap {name}", None, "has no node off the wall; refine the mesh there")
        total = vector.sum(axis=0)
        centre = (points[mine].mean(axis=1) * size[:, None]).sum(axis=0) / size.sum()
        out.append(
            Cap(
                name,
                name in inlets,
                mine,
                nodes,
                nodal[nodes],
                total / np.linalg.norm(total),
                centre,
                float(np.linalg.norm(total)),
            )  # fmt: skip
        )
    return out, wall_faces
