"""What a time step needs of the mesh: operators, the pressure factor, and what each cap needs.

All samples share one geometry, or each has its own nodes on one topology. Topology, node order, sparsity patterns and
the elimination order are shared in both cases; the values of the operators and of the factor are each sample's own in
the second, and computed once per sample.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components, reverse_cuthill_mckee

from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.fem import elements
from coronaryuq.flow3d.fem.arrays import Elements, Motion, Pattern
from coronaryuq.flow3d.fem.cholesky import Cholesky
from coronaryuq.flow3d.fem.lanes import rows

BDF2 = (1.5, -2.0, 0.5)
"""Second-order backward difference: (1.5 u_new − 2 u + 0.5 u_old)/Δt."""


@dataclass(frozen=True)
class Cap:
    """A flat end: triangles, outward unit `normal`, `nodes` (k,) off the wall and their lumped area (k, 1 or LANES)."""

    name: str
    inlet: bool
    faces: np.ndarray
    nodes: np.ndarray
    nodal_area: np.ndarray
    normal: np.ndarray


class Discretisation:
    """Operators of one mesh for one time step, in the solver's own node order (reverse Cuthill-McKee).

    `node_of[i]` is the mesh node of the solver's node i. Arrays that follow from the nodes' places have a last axis of
    1, or of LANES after `of_lanes`: places (n, 3, ·), mass (n, ·), tau (n, ·), lift (n, caps, ·), admittance
    (caps, caps, ·), nu (·,).

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
        self.density, self.dt = density, dt
        nu = viscosity / density
        self.nu = np.array([nu])
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
        self.places, self.nodes = points[..., None], n
        self.elements = Elements(tets.astype(np.int32), rows(grad[..., None]), rows(volume[..., None]))
        mass = elements.lumped_mass(tets, volume, n)
        self.mass = mass[:, None]

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
        self.gradient = tuple(rows(g.data[:, None]) for g in derivatives)
        # The pattern is symmetric, so the transposed operators have it too.
        self.divergence = tuple(rows(g.T.tocsr().data[:, None]) for g in derivatives)

        rate = BDF2[0] / dt
        self.mass_rate = rate
        constant = nu * stiffness.data
        constant[diagonal] += rate * mass
        self.constant = rows(constant[:, None])
        metric = np.einsum("eak,eak->e", grad, grad)
        viscous = (3.0 * nu * metric) ** 2
        self.tau_viscous = rows(viscous[:, None])
        tau_element = 1.0 / np.sqrt(reference_speed**2 * metric / 1.5 + viscous)
        tau = np.bincount(tets.ravel(), np.repeat(tau_element * volume / 4.0, 4), n) / mass
        self.tau = tau[:, None]
        spread = elements.laplacian(tets, volume, grad, n, tau[tets].mean(axis=1)).data
        self.spread = rows(spread[:, None])
        pressure = sp.csr_matrix((stiffness.data / rate + spread, column, start), shape=(n, n))
        self._pressure(pressure)

    def _inside_pattern(self) -> sp.csr_matrix:
        n, (start, column, _) = self.nodes, self.pattern
        whole = sp.csr_matrix((np.ones(len(column)), column, start), shape=(n, n))
        return whole[self.inside][:, self.inside]

    @property
    def points(self) -> np.ndarray:
        """Nodes of the one geometry that all samples share, (n, 3) cm, in the solver's order."""
        if self.places.shape[-1] != 1:
            raise ValueError("each sample has its own nodes: see `places`")
        return self.places[..., 0]

    def _pressure(self, matrix: sp.csr_matrix) -> None:
        """Factor the pressure matrix inside the caps, lift each cap's pressure, and compute the caps' admittance."""
        cap_nodes = [np.unique(cap.faces) for cap in self.caps]
        inside = np.ones(self.nodes, bool)
        for nodes in cap_nodes:
            inside[nodes] = False
        self.inside = np.flatnonzero(inside)
        self.factor = Cholesky(matrix[self.inside][:, self.inside], places=self.inside)
        self.cap_nodes = cap_nodes
        lift = np.zeros((self.nodes, len(self.caps)))
        edge = np.zeros((self.nodes, len(self.caps)))
        for c, nodes in enumerate(cap_nodes):
            lift[nodes, c] = 1.0
            edge[:, c] = np.asarray(matrix[:, nodes].sum(axis=1)).ravel()
        lift[self.inside] = -self.factor.solve_columns(edge[self.inside])
        self.lift, self.admittance = lift[..., None], (lift.T @ (matrix @ lift))[..., None]
        self.nominal_admittance = self.admittance[..., 0]
        beside = np.zeros(self.nodes, bool)
        for nodes in cap_nodes:
            beside[matrix[:, nodes].tocoo().row] = True
        near = np.flatnonzero(inside & beside)
        self.near_caps, self.near_weight = near, edge[near][..., None]

    @classmethod
    def of_lanes(cls, spaces: Sequence["Discretisation"], common: "Discretisation") -> "Discretisation":
        """Return the operators of LANES meshes of one topology, each for its own sample.

        Parameters
        ----------
        spaces
            (LANES,) operators for the same time step, density and viscosity; the same object may stand for several.
        common
            Those of the mesh that the others' nodes were moved from.

        Raises
        ------
        ValueError
            If the meshes differ in more than the places of their nodes.
        """
        first = common
        distinct = list({id(space): space for space in spaces}.values())
        for other in distinct:
            if not all(
                np.array_equal(one, two)
                for one, two in ((first.elements.tets, other.elements.tets), (first.node_of, other.node_of))
            ):
                raise ValueError("meshes of different topology cannot share one block")
            if not all(np.allclose(a.normal, b.normal, atol=1e-9) for a, b in zip(first.caps, other.caps, strict=True)):
                raise ValueError("meshes whose caps point elsewhere cannot share one block")
        joined = copy(first)

        def stacked(get: Callable[["Discretisation"], np.ndarray]) -> np.ndarray:
            return np.concatenate([get(space) for space in spaces], axis=-1)

        def as_rows(get: Callable[["Discretisation"], np.ndarray]) -> np.ndarray:
            return rows(np.stack([get(space) for space in spaces], axis=-1))

        joined.places, joined.mass = stacked(lambda s: s.places), stacked(lambda s: s.mass)
        joined.tau, joined.lift = stacked(lambda s: s.tau), stacked(lambda s: s.lift)
        joined.admittance, joined.near_weight = stacked(lambda s: s.admittance), stacked(lambda s: s.near_weight)
        grad, volume = as_rows(lambda s: s.elements.grad), as_rows(lambda s: s.elements.volume)
        joined.elements = Elements(first.elements.tets, grad, volume)
        joined.constant, joined.spread = as_rows(lambda s: s.constant), as_rows(lambda s: s.spread)
        joined.tau_viscous = as_rows(lambda s: s.tau_viscous)
        joined.gradient = tuple(rows(np.stack(own, axis=-1)) for own in zip(*(s.gradient for s in spaces), strict=True))
        joined.divergence = tuple(
            rows(np.stack(own, axis=-1)) for own in zip(*(s.divergence for s in spaces), strict=True)
        )
        joined.caps = [
            replace(own[0], nodal_area=np.concatenate([cap.nodal_area for cap in own], axis=-1))
            for own in zip(*(space.caps for space in spaces), strict=True)
        ]
        joined.nu = np.concatenate([space.nu for space in spaces])
        joined.nominal_admittance = common.nominal_admittance
        joined.factor = Cholesky.of_lanes([space.factor for space in spaces], first._inside_pattern())
        return joined


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
        normal = total / np.linalg.norm(total)
        out.append(Cap(name, name in inlets, mine, nodes, nodal[nodes][:, None], normal))
    return out, wall_faces
