"""Steady axisymmetric Navier-Stokes flow through a tube or nozzle: an independent reference for the 3D solver.

Taylor-Hood triangles (quadratic velocity, linear pressure) in the (z, r) half plane, Newton's method with continuation
in density, direct solves. It has no code in common with the 3D solver.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

_A, _B, _C, _D = 0.249286745170910, 0.063089014491502, 0.310352451033785, 0.053145049844816
POINTS = np.array(
    [
        *[(1 - 2 * _A, _A, _A), (_A, 1 - 2 * _A, _A), (_A, _A, 1 - 2 * _A)],
        *[(1 - 2 * _B, _B, _B), (_B, 1 - 2 * _B, _B), (_B, _B, 1 - 2 * _B)],
        *[(_C, _D, 1 - _C - _D), (_D, _C, 1 - _C - _D), (_C, 1 - _C - _D, _D)],
        *[(_D, 1 - _C - _D, _C), (1 - _C - _D, _C, _D), (1 - _C - _D, _D, _C)],
    ]
)
_WEIGHTS = np.repeat([0.116786275726379, 0.050844906370207, 0.082851075618374], [3, 3, 6])
"""Dunavant's rule of degree 6 with 12 points: barycentric coordinates and weights."""


@dataclass(frozen=True)
class AxisymmetricFlow:
    """Axisymmetric flow at the node levels z (k,).

    pressure: (k,) dyn/cm2, mean over the cross-section. axial: (k,) velocity on the axis, cm/s. wall_pressure,
    wall_shear: (k,) dyn/cm2. At a step in radius the wall is the inner corner, with the wall shear of the neighbouring
    wall.
    """

    z: np.ndarray
    wall_shear: np.ndarray
    pressure: np.ndarray
    axial: np.ndarray
    wall_pressure: np.ndarray


@dataclass(frozen=True)
class Grid:
    """Node coordinates of the axisymmetric mesh, and the rings with fluid.

    z: (levels,) cm. r: (levels, rings + 1) cm, from the axis outwards. wet: (levels − 1,) number of rings with fluid
    between two levels, counted from the axis.
    """

    z: np.ndarray
    r: np.ndarray
    wet: np.ndarray


def graded(rings: int) -> np.ndarray:
    """Return radii (rings + 1,) from 0 to 1 that lie closer together towards the wall."""
    return 1.0 - (1.0 - np.linspace(0.0, 1.0, rings + 1)) ** 1.4


def solve(
    radius: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    rings: int,
    flow: float,
    density: float,
    viscosity: float,
) -> AxisymmetricFlow:
    """Compute the flow (mL/s) through a tube along z (cm levels, increasing) of `radius`(z), developed at the inlet."""
    grid = Grid(z, np.outer(radius(z), graded(rings)), np.full(len(z) - 1, rings))
    return solve_on(grid, flow, density, viscosity)


@dataclass(frozen=True)
class Elements:
    """Triangles of the fluid. z, r: of the m velocity nodes, cm, the n corners first, then a middle of every edge.

    corners (e, 3) and nodes (e, 6) of the elements. edges (k, 2): their corners. number (levels, rings + 1): the
    corner at each point of the grid, −1 where it is dry. wall (m,): whether a node lies on it.
    """

    z: np.ndarray
    r: np.ndarray
    n: int
    corners: np.ndarray
    nodes: np.ndarray
    edges: np.ndarray
    number: np.ndarray
    wall: np.ndarray

    @property
    def m(self) -> int:
        return len(self.z)


@dataclass(frozen=True)
class Rule:
    """Quadrature rule on every element.

    shape: (q, 6) quadratic shape functions. grad: (e, q, 6, 2) their gradients, 1/cm. r: (e, q) radius of the points,
    cm. weight: (e, q) weights that include that radius, cm3.
    """

    shape: np.ndarray
    grad: np.ndarray
    r: np.ndarray
    weight: np.ndarray


def solve_on(
    grid: Grid,
    flow: float,
    density: float,
    viscosity: float,
    continuation: tuple[float, ...] = (0.0, 0.1, 0.3, 0.6, 1.0),
) -> AxisymmetricFlow:
    """Compute the flow (mL/s) from the first level, where it is developed, to the last, where it leaves freely."""
    elements = _triangulated(grid)
    rule = rule_on(elements)
    solution, free = _start(grid, elements, flow)
    for share in continuation:
        for _ in range(25):
            matrix, residual = _assemble(elements, rule, solution, share * density, viscosity)
            step = splu(matrix[free][:, free].tocsc()).solve(residual[free])
            solution[free] -= step
            if np.abs(step[step.size // 2 :]).max() == 0 or np.linalg.norm(step) < 1e-9 * np.linalg.norm(solution):
                break
        else:
            raise RuntimeError(f"Newton's method did not converge at {share} of the density")
    _, force = _assemble(elements, rule, solution, density, viscosity)
    return _measure(grid, elements, solution, force)


def _triangulated(grid: Grid) -> Elements:
    nodes_z, nodes_r = np.repeat(grid.z, grid.r.shape[1]), grid.r.ravel()
    number = np.arange(len(nodes_z)).reshape(grid.r.shape)
    wet = (np.arange(grid.r.shape[1] - 1) < grid.wet[:, None]).ravel()
    a, b, c, d = (x.ravel()[wet] for x in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    corners = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    used, corners = np.unique(corners, return_inverse=True)
    corners = corners.reshape(-1, 3)
    nodes_z, nodes_r = nodes_z[used], nodes_r[used]
    place = np.full(number.size, -1)
    place[used] = np.arange(len(used))
    return quadratic(nodes_z, nodes_r, corners, place[number], (grid.z[0], grid.z[-1]))


def quadratic(
    z: np.ndarray, r: np.ndarray, corners: np.ndarray, number: np.ndarray, ends: tuple[float, ...] = ()
) -> Elements:
    """Give triangles with corners (e, 3) at z, r (n,) a node in the middle of every edge.

    number: see `Elements`. ends: z of borders that, like the axis, are no walls.
    """
    pairs = np.sort(np.concatenate([corners[:, [1, 2]], corners[:, [2, 0]], corners[:, [0, 1]]]), axis=1)
    edges, edge = np.unique(pairs, axis=0, return_inverse=True)
    n = len(z)
    rim = np.bincount(edge.ravel(), minlength=len(edges)) == 1
    end_z, end_r = z[edges], r[edges]
    for border in (end_r == 0, *(end_z == end for end in ends)):
        rim &= ~border.all(axis=1)
    wall = np.zeros(n + len(edges), bool)
    wall[edges[rim]] = wall[n + np.flatnonzero(rim)] = True
    return Elements(
        z=np.concatenate([z, end_z.mean(axis=1)]),
        r=np.concatenate([r, end_r.mean(axis=1)]),
        n=n,
        corners=corners,
        nodes=np.concatenate([corners, n + edge.reshape(3, len(corners)).T], axis=1),
        edges=edges,
        number=number,
        wall=wall,
    )


def rule_on(elements: Elements) -> Rule:
    """Return the rule on triangles whose corners run the same way round."""
    l1, l2, l3 = POINTS.T
    shape = np.stack(
        [l1 * (2 * l1 - 1), l2 * (2 * l2 - 1), l3 * (2 * l3 - 1), 4 * l2 * l3, 4 * l3 * l1, 4 * l1 * l2], axis=1
    )
    zero = np.zeros_like(l1)
    by_l = np.stack(
        [
            np.stack([4 * l1 - 1, zero, zero, zero, 4 * l3, 4 * l2], axis=1),
            np.stack([zero, 4 * l2 - 1, zero, 4 * l3, zero, 4 * l1], axis=1),
            np.stack([zero, zero, 4 * l3 - 1, 4 * l2, 4 * l1, zero], axis=1),
        ],
        axis=2,
    )
    cz, cr = elements.z[elements.corners], elements.r[elements.corners]
    twice = (cz[:, 1] - cz[:, 0]) * (cr[:, 2] - cr[:, 0]) - (cz[:, 2] - cz[:, 0]) * (cr[:, 1] - cr[:, 0])
    grad_l = np.stack(
        [
            np.stack([cr[:, 1] - cr[:, 2], cr[:, 2] - cr[:, 0], cr[:, 0] - cr[:, 1]], axis=1),
            np.stack([cz[:, 2] - cz[:, 1], cz[:, 0] - cz[:, 2], cz[:, 1] - cz[:, 0]], axis=1),
        ],
        axis=2,
    ) / twice[:, None, None]  # fmt: skip
    grad = np.einsum("qil,elk->eqik", by_l, grad_l)
    r = np.einsum("ql,el->eq", POINTS, cr)
    return Rule(shape, grad, r, 0.5 * np.abs(twice)[:, None] * _WEIGHTS[None] * r)


def _start(grid: Grid, elements: Elements, flow: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the unknowns (2 m + n,) at rest except for the inlet's parabola, and which of them are free.

    Unknowns are axial and radial velocity and pressure; fixed are velocities on the wall and at the inlet, and radial
    velocity on the axis.
    """
    m, wall, inlet = elements.m, elements.wall, elements.z == grid.z[0]
    outer = grid.r[0, grid.wet[0]]
    inflow = 2 * flow / (np.pi * outer**2) * (1 - (elements.r / outer) ** 2)
    fixed = np.concatenate([wall | inlet, wall | inlet | (elements.r == 0), np.zeros(elements.n, bool)])
    solution = np.zeros(2 * m + elements.n)
    solution[:m][inlet & ~wall] = inflow[inlet & ~wall]
    return solution, np.flatnonzero(~fixed)


def _assemble(
    elements: Elements, rule: Rule, solution: np.ndarray, rho: float, viscosity: float
) -> tuple[sp.csc_matrix, np.ndarray]:
    """Return Jacobian and residual of the weak form in all unknowns, boundary values included."""
    m, n, corners, every = elements.m, elements.n, elements.corners, elements.nodes
    shape, grad, r, weight = rule.shape, rule.grad, rule.r, rule.weight
    u = np.stack([solution[:m][every], solution[m : 2 * m][every]], axis=2)
    p = solution[2 * m :][corners]
    at = np.einsum("qi,eic->eqc", shape, u)
    slope = np.einsum("eqik,eic->eqck", grad, u)
    pressure = np.einsum("ql,el->eq", POINTS, p)
    hoop = at[:, :, 1] / r
    through = slope[:, :, 0, 0] + slope[:, :, 1, 1] + hoop
    carried = np.einsum("eqk,eqck->eqc", at, slope)
    residual = np.einsum("eq,qi,eqc->eic", weight, shape, rho * carried)
    residual += np.einsum("eq,eqik,eqck->eic", weight * viscosity, grad, slope)
    residual -= np.einsum("eq,eqic->eic", weight * pressure, grad)
    residual[:, :, 1] += np.einsum("eq,qi->ei", weight * (viscosity * hoop - pressure) / r, shape)
    total = np.zeros(2 * m + n)
    np.add.at(total, every, residual[:, :, 0])
    np.add.at(total, every + m, residual[:, :, 1])
    np.add.at(total, corners + 2 * m, -np.einsum("eq,ql->el", weight * through, POINTS))
    return _jacobian(elements, rule, at, slope, rho, viscosity), total


def _jacobian(
    elements: Elements, rule: Rule, at: np.ndarray, slope: np.ndarray, rho: float, viscosity: float
) -> sp.csc_matrix:
    """Return the Jacobian; at (e, q, 2): velocity at the quadrature points, slope (e, q, 2, 2): its gradient."""
    m, corners, every = elements.m, elements.corners, elements.nodes
    shape, grad, r, weight = rule.shape, rule.grad, rule.r, rule.weight
    stiff = viscosity * np.einsum("eq,eqik,eqjk->eij", weight, grad, grad)
    stiff += rho * np.einsum("eq,qi,eqk,eqjk->eij", weight, shape, at, grad)
    parts = []  # rows, columns and values of blocks [test, trial]
    for x in range(2):
        for y in range(2):
            value = rho * np.einsum("eq,qi,qj->eij", weight * slope[:, :, x, y], shape, shape)
            if x == y:
                value = value + stiff
            if x == y == 1:
                value = value + np.einsum("eq,qi,qj->eij", weight * viscosity / r**2, shape, shape)
            parts.append((every + x * m, every + y * m, value))
    divergence = [grad[..., 0], grad[..., 1] + shape[None] / r[:, :, None]]
    for x in range(2):
        value = -np.einsum("eq,eqi,ql->eil", weight, divergence[x], POINTS)
        parts.append((every + x * m, corners + 2 * m, value))
        parts.append((corners + 2 * m, every + x * m, value.transpose(0, 2, 1)))
    return summed(parts, 2 * m + elements.n)


def summed(parts: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]], size: int) -> sp.csc_matrix:
    """Return the matrix (size, size) whose entries are the sums of element matrices.

    parts: numbers of test functions (e, i), of trial functions (e, j), and values (e, i, j).
    """
    parts = list(parts)
    rows = np.concatenate([np.repeat(i, j.shape[1], axis=1).ravel() for i, j, _ in parts])
    columns = np.concatenate([np.tile(j, (1, i.shape[1])).ravel() for i, j, _ in parts])
    data = np.concatenate([value.ravel() for _, _, value in parts])
    return sp.csc_matrix((data, (rows, columns)), shape=(size, size))


def _measure(grid: Grid, elements: Elements, solution: np.ndarray, force: np.ndarray) -> AxisymmetricFlow:
    """Return wall shear from the consistent nodal forces on the wall, axial and radial, spread over the arc."""
    z, n, m, number = grid.z, elements.n, elements.m, elements.number
    top = np.minimum(np.r_[grid.wet, grid.wet[-1]], np.r_[grid.wet[0], grid.wet])
    wall = number[np.arange(len(z)), top]
    lookup = {tuple(edge): n + k for k, edge in enumerate(elements.edges.tolist())}
    pairs = [tuple(sorted(pair)) for pair in zip(wall[:-1].tolist(), wall[1:].tolist(), strict=True)]
    along_wall = np.array([pair in lookup for pair in pairs])
    between = np.array([lookup[pair] for pair in pairs if pair in lookup])
    radii = elements.r[wall]
    dz, dr = np.diff(z)[along_wall], np.diff(radii)[along_wall]
    length = np.hypot(dz, dr)
    along = (dz * force[between] + dr * force[m + between]) / length
    # A quadratic edge gives 2/3 of its length to its middle node; the ring's radius comes with the axisymmetric weight.
    shear = np.abs(along) / (2.0 / 3.0 * length * 0.5 * (radii[1:] + radii[:-1])[along_wall])
    shear = np.interp(z, 0.5 * (z[1:] + z[:-1])[along_wall], shear)
    p = solution[2 * m :]
    pressure = np.empty(len(z))
    for level, outermost in enumerate(top):
        row = number[level, : outermost + 1]
        r = elements.r[row]
        step, weight = np.diff(r), np.zeros(len(r))
        weight[:-1] += step * (2 * r[:-1] + r[1:]) / 6
        weight[1:] += step * (r[:-1] + 2 * r[1:]) / 6
        pressure[level] = (weight * p[row]).sum() / weight.sum()
    return AxisymmetricFlow(z, shear, pressure, solution[number[:, 0]], p[wall])
