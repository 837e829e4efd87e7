"""Projection: divergence, gradient and stabilisation kernels around the one pressure factor."""

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.core.simd import fma, store
from coronaryuq.flow3d.fem.lanes import entry, load, splat


@njit(cache=True, error_model="numpy")
def divergence(pattern, derivatives, spread, u, scale, pi, p, b):
    """Compute b_i = Σ_j ∫∂N_i N_j · (u_j + scale_j π_j) − spread_ij p_j, for b (n, LANES).

    derivatives: three arrays (nnz,) as `rows`, of ∫ ∂N_i/∂x_k N_j. The last two terms are the pressure stabilisation by
    orthogonal subscales, τ ∫∇q·(∇p − π) with π the projected pressure gradient (Codina 2000).
    """
    start, column, (dx, dy, dz) = pattern.start, pattern.column, derivatives
    for i in range(start.shape[0] - 1):
        total = splat(0.0)
        for k in range(start[i], start[i + 1]):
            j = np.int64(column[k])
            t = entry(scale, j)
            total = fma(entry(dx, k), fma(t, load(pi, 3 * j), load(u, 3 * j)), total)
            total = fma(entry(dy, k), fma(t, load(pi, 3 * j + 1), load(u, 3 * j + 1)), total)
            total = fma(entry(dz, k), fma(t, load(pi, 3 * j + 2), load(u, 3 * j + 2)), total)
            total = fma(-1.0 * entry(spread, k), load(p, j), total)
        store(b, i, total)


@njit(cache=True, error_model="numpy")
def correct(pattern, derivatives, phi, inverse_mass, motion, factor, u, pi):
    """Add M⁻¹∫N∇φ to π everywhere and subtract `factor` times it from u at free nodes (its normal part on caps).

    derivatives: three arrays (nnz,) of ∫ N_i ∂N_j/∂x_k.
    """
    start, column, (gx, gy, gz) = pattern.start, pattern.column, derivatives
    free, cap, normal = motion.free, motion.cap, motion.normal
    for i in range(start.shape[0] - 1):
        x, y, z = splat(0.0), splat(0.0), splat(0.0)
        for k in range(start[i], start[i + 1]):
            q = load(phi, np.int64(column[k]))
            x, y, z = fma(entry(gx, k), q, x), fma(entry(gy, k), q, y), fma(entry(gz, k), q, z)
        m = entry(inverse_mass, i)
        x, y, z = m * x, m * y, m * z
        store(pi, 3 * i, load(pi, 3 * i) + x)
        store(pi, 3 * i + 1, load(pi, 3 * i + 1) + y)
        store(pi, 3 * i + 2, load(pi, 3 * i + 2) + z)
        if not free[i]:
            continue
        at = cap[i]
        if at >= 0:
            nx, ny, nz = normal[at, 0], normal[at, 1], normal[at, 2]
            along = fma(nz, z, fma(ny, y, nx * x))
            x, y, z = nx * along, ny * along, nz * along
        store(u, 3 * i, fma(-factor, x, load(u, 3 * i)))
        store(u, 3 * i + 1, fma(-factor, y, load(u, 3 * i + 1)))
        store(u, 3 * i + 2, fma(-factor, z, load(u, 3 * i + 2)))
