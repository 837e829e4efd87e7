"""Projection: divergence, gradient and stabilisation kernels around the one pressure factor."""

import numba as nb
import numpy as np

from coronaryuq.flow3d.lanes import LANES


@nb.njit(cache=True, error_model="numpy")
def divergence(start, column, dx, dy, dz, spread, u, scale, pi, p, b):
    """b_i = Σ_j ∫∂N_i N_j · (u_j + scale_j π_j) − spread_ij p_j, for b (n, LANES).

    dx, dy, dz hold ∫ ∂N_i/∂x_k N_j. The last two terms are the pressure stabilisation by orthogonal subscales,
    τ ∫∇q·(∇p − π) with π the projected pressure gradient (Codina 2000).
    """
    for i in range(start.shape[0] - 1):
        for s in range(LANES):
            b[i, s] = 0.0
        for k in range(start[i], start[i + 1]):
            j = column[k]
            gx, gy, gz, l, t = dx[k], dy[k], dz[k], spread[k], scale[j]
            for s in range(LANES):
                b[i, s] += (
                    gx * (u[j, 0, s] + t * pi[j, 0, s])
                    + gy * (u[j, 1, s] + t * pi[j, 1, s])
                    + gz * (u[j, 2, s] + t * pi[j, 2, s])
                ) - l * p[j, s]


@nb.njit(cache=True, error_model="numpy")
def correct(start, column, gx, gy, gz, phi, inverse_mass, free, cap, normal, factor, u, pi):
    """Add M⁻¹∫N∇φ to π everywhere and take `factor` times it from u at free nodes (its normal part on caps)."""
    t = np.empty((3, LANES))
    for i in range(start.shape[0] - 1):
        t[:] = 0.0
        for k in range(start[i], start[i + 1]):
            j = column[k]
            a, b, c = gx[k], gy[k], gz[k]
            for s in range(LANES):
                q = phi[j, s]
                t[0, s] += a * q
                t[1, s] += b * q
                t[2, s] += c * q
        m = inverse_mass[i]
        for c in range(3):
            for s in range(LANES):
                t[c, s] *= m
                pi[i, c, s] += t[c, s]
        if not free[i]:
            continue
        at = cap[i]
        if at >= 0:
            for s in range(LANES):
                along = t[0, s] * normal[at, 0] + t[1, s] * normal[at, 1] + t[2, s] * normal[at, 2]
                for c in range(3):
                    u[i, c, s] -= factor * along * normal[at, c]
        else:
            for c in range(3):
                for s in range(LANES):
                    u[i, c, s] -= factor * t[c, s]


@nb.njit(cache=True, error_model="numpy")
def cap_sums(node, weight, field, total):
    """total (caps, LANES) = Σ weight (caps, k) · field over the flattened rows listed in `node` (k,), in fixed order."""
    total[:] = 0.0
    for c in range(weight.shape[0]):
        for k in range(node.shape[0]):
            w = weight[c, k]
            if w != 0.0:
                i = node[k]
                for s in range(LANES):
                    total[c, s] += w * field[i, s]
