"""Momentum: the linearised system of a time step for every sample, and its Gauss-Seidel solution.

The increment δ = u* − ū from the extrapolated velocity ū solves A(ū) δ = r(ū). r is exact in double precision; A is
kept in single precision, since δ is of the order of the time step squared and its error enters as a product.
"""

import numba as nb
import numpy as np

from coronaryuq.flow3d.lanes import LANES


@nb.njit(cache=True, error_model="numpy")
def system(tets, grad, volume, slot, tau_viscous, nu, mass_rate, u, rate, p, constant, r, matrix):
    """Residual r (n, 3, LANES) and matrix (nnz, LANES) at velocity u, per unit density.

    rate: time derivative at u (n, 3, LANES); p: pressure over density (n, LANES). mass_rate: the time scheme's a0/Δt.
    Galerkin convection in skew-symmetric form, exact quadrature, with streamline-upwind Petrov-Galerkin stabilisation
    by the whole residual: τ = ((2 a0/Δt)² + (2|u|/h)² + viscous²)^(-1/2), 2|u|/h = Σ|u·∇N| (Brooks & Hughes 1982;
    Tezduyar & Osawa 2000).
    """
    r[:] = 0.0
    for k in range(matrix.shape[0]):
        start = constant[k]
        for s in range(LANES):
            matrix[k, s] = start
    mean = np.empty((3, LANES))
    slope = np.empty((3, 3, LANES))
    along = np.empty((4, LANES))
    force = np.empty((3, LANES))
    convection = np.empty((3, LANES))
    tau = np.empty(LANES)
    half_divergence = np.empty(LANES)
    node = np.empty(4, np.int64)
    inertia = (2.0 * mass_rate) ** 2
    for e in range(tets.shape[0]):
        for a in range(4):
            node[a] = tets[e, a]
        i0, i1, i2, i3 = node[0], node[1], node[2], node[3]
        v = volume[e]
        tv = tau_viscous[e]
        for c in range(3):
            g0, g1, g2, g3 = grad[e, 0, c], grad[e, 1, c], grad[e, 2, c], grad[e, 3, c]
            for s in range(LANES):
                mean[c, s] = 0.25 * ((u[i0, c, s] + u[i1, c, s]) + (u[i2, c, s] + u[i3, c, s]))
                force[c, s] = (
                    0.25 * ((rate[i0, c, s] + rate[i1, c, s]) + (rate[i2, c, s] + rate[i3, c, s]))
                    + (g0 * p[i0, s] + g1 * p[i1, s])
                    + (g2 * p[i2, s] + g3 * p[i3, s])
                )
            for k in range(3):
                for s in range(LANES):
                    slope[k, c, s] = (g0 * u[i0, k, s] + g1 * u[i1, k, s]) + (g2 * u[i2, k, s] + g3 * u[i3, k, s])
        for s in range(LANES):
            tau[s] = 0.0
            half_divergence[s] = 0.5 * (slope[0, 0, s] + slope[1, 1, s] + slope[2, 2, s])
        for a in range(4):
            g0, g1, g2 = grad[e, a, 0], grad[e, a, 1], grad[e, a, 2]
            for s in range(LANES):
                along[a, s] = g0 * mean[0, s] + g1 * mean[1, s] + g2 * mean[2, s]
                tau[s] += abs(along[a, s])
        for s in range(LANES):
            tau[s] = v / np.sqrt(inertia + tau[s] * tau[s] + tv)
        for c in range(3):
            for s in range(LANES):
                convection[c, s] = (
                    mean[0, s] * slope[c, 0, s] + mean[1, s] * slope[c, 1, s] + mean[2, s] * slope[c, 2, s]
                )
                force[c, s] += convection[c, s]
                convection[c, s] = 0.2 * v * (convection[c, s] + half_divergence[s] * mean[c, s])
        w = v / 20.0
        nv = nu * v
        quarter = 0.25 * v
        for a in range(4):
            i = node[a]
            g0, g1, g2 = grad[e, a, 0], grad[e, a, 1], grad[e, a, 2]
            for c in range(3):
                q0, q1, q2, q3 = grad[e, 0, c], grad[e, 1, c], grad[e, 2, c], grad[e, 3, c]
                for s in range(LANES):
                    r[i, c, s] -= (
                        convection[c, s]
                        + w
                        * (
                            u[i, 0, s] * slope[c, 0, s]
                            + u[i, 1, s] * slope[c, 1, s]
                            + u[i, 2, s] * slope[c, 2, s]
                            + half_divergence[s] * u[i, c, s]
                        )
                        + nv * (g0 * slope[c, 0, s] + g1 * slope[c, 1, s] + g2 * slope[c, 2, s])
                        + quarter * (rate[i, c, s] + (q0 * p[i0, s] + q1 * p[i1, s]) + (q2 * p[i2, s] + q3 * p[i3, s]))
                        + tau[s] * along[a, s] * force[c, s]
                    )
            diagonal = slot[e, a, a]
            for s in range(LANES):
                matrix[diagonal, s] += quarter * half_divergence[s]
            for b in range(4):
                k = slot[e, a, b]
                for s in range(LANES):
                    matrix[k, s] += (quarter + tau[s] * along[a, s]) * along[b, s] + tau[s] * along[a, s] * (
                        0.25 * mass_rate
                    )


@nb.njit(cache=True, error_model="numpy")
def gauss_seidel(start, column, diagonal, matrix, r, free, cap, normal, delta, active, tolerance, sweeps):
    """Symmetric Gauss-Seidel sweeps on δ (n, 3, LANES) over the `free` nodes; returns the sweeps of each lane.

    A lane stops when a sweep changes it by less than `tolerance` times its norm; the others go on without it, so that
    a sample's numbers do not depend on its neighbours. On cap nodes δ keeps its component along `normal` only.
    """
    used = np.zeros(LANES, np.int64)
    value = np.empty((3, LANES), np.float32)
    change = np.empty(LANES)
    norm = np.empty(LANES)
    for sweep in range(sweeps):
        change[:] = 0.0
        norm[:] = 0.0
        for position in range(free.shape[0]):
            i = free[position] if sweep % 2 == 0 else free[free.shape[0] - 1 - position]
            for c in range(3):
                for s in range(LANES):
                    value[c, s] = r[i, c, s]
            d = diagonal[i]
            for k in range(start[i], start[i + 1]):
                if k == d:
                    continue
                j = column[k]
                for c in range(3):
                    for s in range(LANES):
                        value[c, s] -= matrix[k, s] * delta[j, c, s]
            for c in range(3):
                for s in range(LANES):
                    value[c, s] /= matrix[d, s]
            at = cap[i]
            if at >= 0:
                for s in range(LANES):
                    projected = value[0, s] * normal[at, 0] + value[1, s] * normal[at, 1] + value[2, s] * normal[at, 2]
                    for c in range(3):
                        value[c, s] = projected * normal[at, c]
            for c in range(3):
                for s in range(LANES):
                    step = active[s] * (value[c, s] - delta[i, c, s])
                    delta[i, c, s] += step
                    change[s] += step * step
                    norm[s] += value[c, s] * value[c, s]
        running = False
        for s in range(LANES):
            if active[s] > 0:
                used[s] += 1
                if change[s] <= tolerance * tolerance * norm[s]:
                    active[s] = 0.0
                else:
                    running = True
        if not running:
            break
    return used
