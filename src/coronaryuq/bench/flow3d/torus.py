"""Developed flow in a curved tube: an independent reference for the 3D solver in bends.

In a torus with a pressure that falls evenly with the angle, the developed flow is the same in every cross-section: the
Navier-Stokes equations need two dimensions, as axisymmetric flow with swirl about the axis of the torus. They are
solved on Taylor-Hood triangles of the disc by Newton's method with continuation in density, without any code of the 3D
solver.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from coronaryuq.bench.flow3d.axisymmetric import POINTS, Elements, Rule, quadratic, rule_on, summed
from coronaryuq.flow3d.verification.tube import disc


@dataclass(frozen=True)
class CurvedFlow:
    """Developed flow in a torus.

    flow: mL/s. angle: (k,) of places on the wall, from the inside of the bend, where they are nearest to its axis.
    along, around: (k,) components of wall shear stress on the wall, dyn/cm2: along the tube, and in the plane of the
    cross-section, positive towards the outside of the bend.
    """

    flow: float
    angle: np.ndarray
    along: np.ndarray
    around: np.ndarray


CONTINUATION = (0.0, 0.05, 0.2, 0.5, 1.0)


def solve(radius: float, bend: float, gradient: float, rings: int, density: float, viscosity: float) -> CurvedFlow:
    """Compute the flow in a tube of `radius` whose axis is a circle of radius `bend` (cm).

    gradient: fall of pressure for each cm along the axis, dyn/cm3.
    """
    points, corners = disc(rings)
    sides = 6 * rings
    place = points * radius / np.sqrt(sides / (2 * np.pi) * np.sin(2 * np.pi / sides))  # a polygon of the tube's area
    elements = quadratic(place[:, 0], bend + place[:, 1], corners, np.arange(len(place)))
    rule = rule_on(elements)
    m, n = elements.m, elements.n
    fixed = np.concatenate([elements.wall] * 3 + [np.arange(n) == 0])
    free, solution = np.flatnonzero(~fixed), np.zeros(3 * m + n)
    for share in CONTINUATION:
        for _ in range(30):
            matrix, residual = _assembled(elements, rule, solution, share * density, viscosity, gradient * bend)
            step = splu(matrix[free][:, free].tocsc()).solve(residual[free])
            solution[free] -= step
            if np.linalg.norm(step) < 1e-9 * np.linalg.norm(solution):
                break
        else:
            raise RuntimeError(f"Newton's method did not converge at {share} of the density")
    _, force = _assembled(elements, rule, solution, density, viscosity, gradient * bend)
    weight = rule.weight / rule.r
    flow = float(np.einsum("eq,qi,ei->", weight, rule.shape, solution[2 * m : 3 * m][elements.nodes]))
    return CurvedFlow(flow, *_wall_shear(elements, force, bend))


def _assembled(
    elements: Elements, rule: Rule, solution: np.ndarray, rho: float, viscosity: float, drive: float
) -> tuple[sp.csc_matrix, np.ndarray]:
    """Return Jacobian and residual of the weak form in all unknowns: velocity along z, r and around, then pressure.

    drive: fall of pressure for each radian, dyn/cm2.
    """
    m, n, corners, every = elements.m, elements.n, elements.corners, elements.nodes
    shape, grad, r, weight = rule.shape, rule.grad, rule.r, rule.weight
    u = np.stack([solution[k * m : (k + 1) * m][every] for k in range(3)], axis=2)
    at, slope = np.einsum("qi,eic->eqc", shape, u), np.einsum("eqik,eic->eqck", grad, u)
    pressure = np.einsum("ql,el->eq", POINTS, solution[3 * m :][corners])
    carried = np.einsum("eqk,eqck->eqc", at[..., :2], slope)
    # Turning with the bend: centrifugal force, and the change of swirl with the distance from the axis.
    carried[..., 1] -= at[..., 2] ** 2 / r
    carried[..., 2] += at[..., 1] * at[..., 2] / r
    source = rho * carried
    source[..., 1:] += viscosity * at[..., 1:] / r[..., None] ** 2
    source[..., 1] -= pressure / r
    source[..., 2] -= drive / r
    residual = np.einsum("eq,qi,eqc->eic", weight, shape, source)
    residual += viscosity * np.einsum("eq,eqik,eqck->eic", weight, grad, slope)
    residual[..., :2] -= np.einsum("eq,eqic->eic", weight * pressure, grad)
    through = slope[..., 0, 0] + slope[..., 1, 1] + at[..., 1] / r
    total = np.zeros(3 * m + n)
    for k in range(3):
        np.add.at(total, every + k * m, residual[..., k])
    np.add.at(total, corners + 3 * m, -np.einsum("eq,ql->el", weight * through, POINTS))
    return _jacobian(elements, rule, at, slope, rho, viscosity), total


def _jacobian(
    elements: Elements, rule: Rule, at: np.ndarray, slope: np.ndarray, rho: float, viscosity: float
) -> sp.csc_matrix:
    """Return the Jacobian; at (e, q, 3): velocity at the quadrature points, slope (e, q, 3, 2): its gradient."""
    m, corners, every = elements.m, elements.corners, elements.nodes
    shape, grad, r, weight = rule.shape, rule.grad, rule.r, rule.weight

    def product(factor: np.ndarray) -> np.ndarray:
        return np.einsum("eq,qi,qj->eij", weight * factor, shape, shape)

    common = viscosity * np.einsum("eq,eqik,eqjk->eij", weight, grad, grad)
    common += rho * np.einsum("eq,qi,eqk,eqjk->eij", weight, shape, at[..., :2], grad)
    hoop = product(viscosity / r**2)
    blocks = {(x, y): product(rho * slope[..., x, y]) for x in range(3) for y in range(2)}
    blocks[1, 2] = product(-2 * rho * at[..., 2] / r)
    blocks[2, 1] = blocks[2, 1] + product(rho * at[..., 2] / r)
    blocks[2, 2] = product(rho * at[..., 1] / r)
    for k, extra in enumerate((0.0, hoop, hoop)):
        blocks[k, k] = blocks[k, k] + common + extra
    parts = [(every + x * m, every + y * m, value) for (x, y), value in blocks.items()]
    for k, gradient in enumerate((grad[..., 0], grad[..., 1] + shape / r[..., None])):
        value = -np.einsum("eq,eqi,ql->eil", weight, gradient, POINTS)
        parts.append((every + k * m, corners + 3 * m, value))
        parts.append((corners + 3 * m, every + k * m, value.transpose(0, 2, 1)))
    return summed(parts, 3 * m + elements.n)


def _wall_shear(elements: Elements, force: np.ndarray, bend: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angle and components of the mean wall shear on the wall's edges, from the consistent nodal forces."""
    m, n = elements.m, elements.n
    middle = np.flatnonzero(elements.wall[n:])
    ends, node = elements.edges[middle], n + middle
    tangent = np.stack([np.diff(elements.z[ends])[:, 0], np.diff(elements.r[ends])[:, 0]])
    length = np.hypot(*tangent)
    # Towards the outside of the bend, where r is largest.
    tangent *= np.where(tangent[1] >= 0, 1.0, -1.0) / length
    # The weights of the weak form contain r; a corner's force belongs to two edges.
    per_area = -1.0 / (length * elements.r[node])
    z, r, w = (force[k * m + node] + 0.5 * force[k * m + ends].sum(axis=1) for k in range(3))
    angle = np.arctan2(np.abs(elements.z[node]), bend - elements.r[node])
    order = np.argsort(angle)
    return angle[order], (per_area * w)[order], (per_area * (tangent[0] * z + tangent[1] * r))[order]
