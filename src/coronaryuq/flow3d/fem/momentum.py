"""Momentum: the linearised system of a time step for every sample, and its Gauss-Seidel solution.

The increment δ = u* − u from the velocity u at the step's beginning solves A(u) δ = r(u). r is exact in double
precision; A is kept in single precision, since δ is of the order of the time step and its error enters as a product.
"""

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.core.simd import absolute, fma, square_root, store
from coronaryuq.flow3d.fem.element_kernels import average, centre, corners, dot, gradient, hats, part, vector
from coronaryuq.flow3d.fem.lanes import LANES, entry, lanes, load, splat


@njit(cache=True, error_model="numpy")
def system(elements, slot, tau_viscous, nu, mass_rate, u, rate, p, constant, r, matrix):
    """Compute the residual r (n, 3, LANES) and the matrix (nnz, LANES) at velocity u, per unit density.

    rate: time derivative at u (n, 3, LANES); p: pressure over density (n, LANES). mass_rate: the time scheme's a0/Δt.
    Galerkin convection in skew-symmetric form, exact quadrature, with streamline-upwind Petrov-Galerkin stabilisation
    by the whole residual: τ = ((2|u|/h)² + viscous²)^(-1/2), 2|u|/h = Σ|u·∇N| (Brooks & Hughes 1982; Tezduyar & Osawa
    2000), without their term in Δt, so that a steady flow does not depend on the time step.
    """
    tets, grad, volume = elements
    r[:] = 0.0
    for k in range(matrix.shape[0]):
        store(matrix, k, lanes(entry(constant, k)))
    for e in range(tets.shape[0]):
        i0, i1, i2, i3 = corners(tets, e)
        ga, gb, gc, gd = hats(grad, e)
        ua, ub, uc, ud = vector(u, i0), vector(u, i1), vector(u, i2), vector(u, i3)
        v = entry(volume, e)
        um = centre(ua, ub, uc, ud)
        along_a, along_b, along_c, along_d = dot(ga, um), dot(gb, um), dot(gc, um), dot(gd, um)
        speed = (absolute(along_a) + absolute(along_b)) + (absolute(along_c) + absolute(along_d))
        tau = v / square_root(fma(speed, speed, lanes(entry(tau_viscous, e))))
        half = 0.5 * (dot(ga, ua) + dot(gb, ub) + dot(gc, uc) + dot(gd, ud))
        push = gradient(ga, gb, gc, gd, load(p, i0), load(p, i1), load(p, i2), load(p, i3))
        w, quarter, nv = v / 20.0, 0.25 * v, entry(nu, 0) * v
        for c in range(3):
            qa, qb, qc, qd = part(ua, c), part(ub, c), part(uc, c), part(ud, c)
            s = gradient(ga, gb, gc, gd, qa, qb, qc, qd)
            ta, tb, tc, td = (
                load(rate, 3 * i0 + c),
                load(rate, 3 * i1 + c),
                load(rate, 3 * i2 + c),
                load(rate, 3 * i3 + c),
            )
            carried = dot(um, s)
            force = tau * (average(ta, tb, tc, td) + (carried + part(push, c)))
            common = (4.0 * w) * fma(half, part(um, c), carried) + quarter * part(push, c)
            own, shear = w * fma(half, qa, dot(ua, s)), nv * dot(ga, s)
            k = 3 * i0 + c
            store(r, k, load(r, k) - ((common + own) + (shear + fma(along_a, force, quarter * ta))))
            own, shear = w * fma(half, qb, dot(ub, s)), nv * dot(gb, s)
            k = 3 * i1 + c
            store(r, k, load(r, k) - ((common + own) + (shear + fma(along_b, force, quarter * tb))))
            own, shear = w * fma(half, qc, dot(uc, s)), nv * dot(gc, s)
            k = 3 * i2 + c
            store(r, k, load(r, k) - ((common + own) + (shear + fma(along_c, force, quarter * tc))))
            own, shear = w * fma(half, qd, dot(ud, s)), nv * dot(gd, s)
            k = 3 * i3 + c
            store(r, k, load(r, k) - ((common + own) + (shear + fma(along_d, force, quarter * td))))
        constant_rate = 0.25 * mass_rate
        swell = quarter * half
        for a in range(4):
            if a == 0:
                along = along_a
            elif a == 1:
                along = along_b
            elif a == 2:
                along = along_c
            else:
                along = along_d
            upwind = tau * along
            weight = quarter + upwind
            lump = constant_rate * upwind
            k = slot[e, a, 0]
            store(matrix, k, load(matrix, k) + fma(weight, along_a, lump))
            k = slot[e, a, 1]
            store(matrix, k, load(matrix, k) + fma(weight, along_b, lump))
            k = slot[e, a, 2]
            store(matrix, k, load(matrix, k) + fma(weight, along_c, lump))
            k = slot[e, a, 3]
            store(matrix, k, load(matrix, k) + fma(weight, along_d, lump))
            k = slot[e, a, a]
            store(matrix, k, load(matrix, k) + swell)


@njit(cache=True, error_model="numpy")
def gauss_seidel(pattern, motion, matrix, r, delta, active, tolerance, sweeps):
    """Sweep symmetric Gauss-Seidel over δ (n, 3, LANES) on the free nodes; return the sweeps of each lane.

    A lane stops when a sweep changes it by less than `tolerance` times its norm; the others go on without it, so that
    a sample's numbers do not depend on its neighbours. On cap nodes δ keeps its component along the normal only.
    active (1, LANES) is 1 for lanes to solve; those that remain 1 have not converged.
    """
    start, column, diagonal = pattern
    free, cap, normal = motion.free_nodes, motion.cap, motion.normal
    used = np.zeros(LANES, np.int64)
    sums = np.empty((2, LANES))
    for sweep in range(sweeps):
        going = load(active, 0)
        change, norm = splat(0.0), splat(0.0)
        for position in range(free.shape[0]):
            i = np.int64(free[position] if sweep % 2 == 0 else free[free.shape[0] - 1 - position])
            x, y, z = load(r, 3 * i), load(r, 3 * i + 1), load(r, 3 * i + 2)
            d = diagonal[i]
            for k in range(start[i], d):
                j = 3 * np.int64(column[k])
                m = -1.0 * load(matrix, k)
                x, y, z = fma(m, load(delta, j), x), fma(m, load(delta, j + 1), y), fma(m, load(delta, j + 2), z)
            for k in range(d + 1, start[i + 1]):
                j = 3 * np.int64(column[k])
                m = -1.0 * load(matrix, k)
                x, y, z = fma(m, load(delta, j), x), fma(m, load(delta, j + 1), y), fma(m, load(delta, j + 2), z)
            inverse = 1.0 / load(matrix, d)
            x, y, z = x * inverse, y * inverse, z * inverse
            at = cap[i]
            if at >= 0:
                nx, ny, nz = normal[at, 0], normal[at, 1], normal[at, 2]
                projected = fma(nz, z, fma(ny, y, nx * x))
                x, y, z = nx * projected, ny * projected, nz * projected
            x0, y0, z0 = load(delta, 3 * i), load(delta, 3 * i + 1), load(delta, 3 * i + 2)
            x1, y1, z1 = going * (x - x0), going * (y - y0), going * (z - z0)
            store(delta, 3 * i, x0 + x1)
            store(delta, 3 * i + 1, y0 + y1)
            store(delta, 3 * i + 2, z0 + z1)
            change = fma(x1, x1, fma(y1, y1, fma(z1, z1, change)))
            norm = fma(x, x, fma(y, y, fma(z, z, norm)))
        store(sums, 0, change)
        store(sums, 1, norm)
        running = False
        for s in range(LANES):
            if active[0, s] > 0:
                used[s] += 1
                if sums[0, s] <= tolerance * tolerance * sums[1, s]:
                    active[0, s] = 0.0
                else:
                    running = True
        if not running:
            break
    return used
