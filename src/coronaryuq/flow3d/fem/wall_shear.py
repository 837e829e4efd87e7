"""Wall shear stress from the consistent traction: the momentum equation's own residual on the wall's nodes.

Testing the momentum equation with a hat function on the wall leaves ∮ N_i µ ∂u/∂n dA, which is as accurate as the
solution's energy, while element gradients lose an order (Gresho et al. 1987; Melbø & Kvamsdal 2003). Only Galerkin
terms are used: the stabilisation weights a residual that lacks the viscous force (zero for linear elements), whereas
the exact residual is zero, so its contribution on the wall is pure error, up to 10 % of the mean at R/h 2. The traction
is divided by the lumped area and averaged twice over neighbouring triangles.

`coronaryuq.bench.flow3d.unstructured` gives the accuracy by R/h. Elements must be thinner than the boundary layer:
otherwise the pressure gradient across the first element counts as friction and wall shear comes out too high.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from coronaryuq.core.jit import njit
from coronaryuq.core.simd import fma, square_root, store
from coronaryuq.flow3d.fem.arrays import Elements
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.element_kernels import centre, corners, dot, gradient, hats, part, vector
from coronaryuq.flow3d.fem.elements import face_vectors
from coronaryuq.flow3d.fem.lanes import LANES, entry, load, rows, splat


@njit(cache=True, error_model="numpy")
def _wall_force(elements, nu, u, p, at, force):
    """Write −∫ of the momentum residual with hats on the wall, per unit density, into force (wall nodes, 3, LANES)."""
    tets, grad, volume = elements
    force[:] = 0.0
    for e in range(tets.shape[0]):
        i0, i1, i2, i3 = corners(tets, e)
        ga, gb, gc, gd = hats(grad, e)
        ua, ub, uc, ud = vector(u, i0), vector(u, i1), vector(u, i2), vector(u, i3)
        v = entry(volume, e)
        um = centre(ua, ub, uc, ud)
        half = 0.5 * (dot(ga, ua) + dot(gb, ub) + dot(gc, uc) + dot(gd, ud))
        push = gradient(ga, gb, gc, gd, load(p, i0), load(p, i1), load(p, i2), load(p, i3))
        w, quarter, nv = v / 20.0, 0.25 * v, entry(nu, 0) * v
        for c in range(3):
            s = gradient(ga, gb, gc, gd, part(ua, c), part(ub, c), part(uc, c), part(ud, c))
            common = (4.0 * w) * fma(half, part(um, c), dot(um, s)) + quarter * part(push, c)
            for a in range(4):
                i = at[tets[e, a]]
                if i < 0:
                    continue
                # The velocity is zero on the wall, and so is its own part of the convection.
                h = 12 * e + 3 * a
                shear = nv * dot((entry(grad, h), entry(grad, h + 1), entry(grad, h + 2)), s)
                k = 3 * i + c
                store(force, k, load(force, k) - (common + shear))


@njit(cache=True, error_model="numpy")
def _tangential(force, normal, density, stress):
    for i in range(force.shape[0]):
        nx, ny, nz = entry(normal, 3 * i), entry(normal, 3 * i + 1), entry(normal, 3 * i + 2)
        x, y, z = load(force, 3 * i), load(force, 3 * i + 1), load(force, 3 * i + 2)
        through = fma(nz, z, fma(ny, y, nx * x))
        store(stress, 3 * i, density * fma(-1.0 * nx, through, x))
        store(stress, 3 * i + 1, density * fma(-1.0 * ny, through, y))
        store(stress, 3 * i + 2, density * fma(-1.0 * nz, through, z))


@njit(cache=True, error_model="numpy")
def _accumulate(stress, weight, magnitude, vector):
    for i in range(magnitude.shape[0]):
        x, y, z = load(stress, 3 * i), load(stress, 3 * i + 1), load(stress, 3 * i + 2)
        size = square_root(fma(z, z, fma(y, y, x * x)))
        store(magnitude, i, fma(weight, size, load(magnitude, i)))
        store(vector, 3 * i, fma(weight, x, load(vector, 3 * i)))
        store(vector, 3 * i + 1, fma(weight, y, load(vector, 3 * i + 1)))
        store(vector, 3 * i + 2, fma(weight, z, load(vector, 3 * i + 2)))


@njit(cache=True, error_model="numpy")
def _multiply(start, column, value, x, y):
    """Compute y = A x for x, y (n, 3, LANES)."""
    for i in range(start.shape[0] - 1):
        for c in range(3):
            total = splat(0.0)
            for k in range(start[i], start[i + 1]):
                total = fma(entry(value, k), load(x, 3 * np.int64(column[k]) + c), total)
            store(y, 3 * i + c, total)


def _compressed(matrices: Sequence[sp.csr_matrix]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row starts, columns and values, as `rows`, of matrices of one pattern."""
    first = matrices[0]
    values = np.stack([matrix.data for matrix in matrices], axis=-1)
    return first.indptr.astype(np.int64), first.indices.astype(np.int32), rows(values)


def _smoothing(
    points: np.ndarray, mesh_faces: np.ndarray, faces: np.ndarray, w: int
) -> tuple[np.ndarray, np.ndarray, sp.csr_matrix]:
    """Return lumped area (w,), unit normal (w, 3) and averaging matrix (w, w) of a wall's nodes."""
    vector = face_vectors(points, mesh_faces)
    size = np.linalg.norm(vector, axis=1)
    area = np.bincount(faces.ravel(), np.repeat(size / 3.0, 3), w)
    normal = np.stack([np.bincount(faces.ravel(), np.repeat(vector[:, c], 3), w) for c in range(3)], axis=1)
    first, second = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    local = size[:, None, None] * (np.ones((3, 3)) + np.eye(3)) / 12.0
    mass = sp.csr_matrix((local.ravel(), (first, second)), shape=(w, w))
    return area, normal / np.linalg.norm(normal, axis=1)[:, None], (sp.diags(1.0 / area) @ mass).tocsr()


class WallShear:
    """Wall shear stress of LANES samples on the wall's nodes, and its integrals over time.

    nodes: (w,) solver's node numbers; area: (w, 1 or LANES) lumped, cm2; normal: (w, 3, 1 or LANES), outward unit;
    faces: (k, 3) into `nodes`.
    """

    def __init__(self, space: Discretisation):
        self.space = space
        self.nodes = np.flatnonzero(space.wall)
        place = np.full(space.nodes, -1, np.int64)
        place[self.nodes] = np.arange(len(self.nodes))
        self._place = place
        tets, grad, volume = space.elements
        touching = (place[tets] >= 0).any(axis=1)
        inner = np.repeat(touching, 12)
        self._elements = Elements(tets[touching], np.ascontiguousarray(grad[inner]), volume[touching])
        self.faces = place[space.wall_faces]
        w = len(self.nodes)
        geometries = range(space.places.shape[-1])
        areas, normals, smoothings = zip(
            *(_smoothing(space.places[..., k], space.wall_faces, self.faces, w) for k in geometries), strict=True
        )
        self.area = np.stack(areas, axis=-1)
        self.normal = np.stack(normals, axis=-1)
        self._normal = rows(self.normal)
        self._smooth = _compressed(smoothings)
        spread = [smoothing @ sp.diags(1.0 / area) for smoothing, area in zip(smoothings, areas, strict=True)]
        self._spread = _compressed(spread)
        self._force, self._smoothed = np.zeros((w, 3, LANES)), np.zeros((w, 3, LANES))
        self.stress = np.zeros((w, 3, LANES))
        self.reset()

    def reset(self) -> None:
        """Start the integrals of a new cycle."""
        self.time = 0.0
        self.magnitude = np.zeros((len(self.nodes), LANES))
        self.vector = np.zeros((len(self.nodes), 3, LANES))

    def sample(self, stepper, weight: float) -> None:
        """Compute the stress of the stepper's state and add it to the integrals for `weight` seconds."""
        space = self.space
        _wall_force(
            self._elements, rows(space.nu[None]), stepper.u, stepper.kinematic_pressure, self._place,
            self._force,
        )  # fmt: skip
        _multiply(*self._spread, self._force, self._smoothed)
        _multiply(*self._smooth, self._smoothed, self._force)
        _tangential(self._force, self._normal, space.density, self.stress)
        _accumulate(self.stress, weight, self.magnitude, self.vector)
        self.time += weight

    def tawss(self) -> np.ndarray:
        """Return (1/T) ∫|τ| dt, (w, LANES), dyn/cm2."""
        return self.magnitude / self.time

    def osi(self) -> np.ndarray:
        """Return ½ (1 − |∫τ dt| / ∫|τ| dt), (w, LANES)."""
        resultant = np.sqrt((self.vector**2).sum(axis=1))
        return 0.5 * (1.0 - resultant / np.maximum(self.magnitude, np.finfo(float).tiny))
