"""Compiled time stepping of one group of samples (`LANES` at a time): generalised-α with Newton on the border.

The scheme is that of svZeroDSolver (Jansen, Whiting & Hulbert 2000): predictor with constant y, residual at
y_αf and ẏ_αm, Newton until max|residual| < tolerance, checked before each solve. Equations of the interior are linear
with constant coefficients, so that once their residual at the predictor is known, one forward and one backward pass per
step solve them exactly; Newton's loop sees only the border.
"""

from typing import NamedTuple

import numba
import numpy as np

from coronaryuq.zerod.lanes import (
    any_lane,
    both,
    choose,
    less,
    less_equal,
    load,
    magnitude,
    nearest,
    power_of_two,
    spread,
    store,
)


class Structure(NamedTuple):
    """Integer tables of one network, (·, columns) int64; rows and columns number equations and unknowns.

    stacked unknowns: y first, then ẏ, so that column n + j is ẏ_j.
    """

    linear: np.ndarray  # row starts of `terms`, (n + 1,)
    terms: np.ndarray  # stacked column, sorted by row
    assemble: np.ndarray  # slot, number of constant entry, 1 if it multiplies ẏ
    constant_time: np.ndarray  # row, shape
    matrix_time: np.ndarray  # row, stacked column, shape, slot
    lagged: np.ndarray  # unknowns whose increments some rows see one iteration late
    lagged_border: np.ndarray  # slot in whole matrix, row, number in `lagged`
    square: np.ndarray  # row, column, slot
    square_rate: np.ndarray  # row, column, slot
    exponential: np.ndarray  # row, column, shape, slot
    valve: np.ndarray  # upstream pressure, downstream pressure, flow
    valve_term: np.ndarray  # row, column, valve, slot
    pivots: np.ndarray  # row, column, slot
    inner_divide: np.ndarray  # slot, pivot number
    inner_order: np.ndarray  # for each interior pivot: first division, first update (with an end row)
    inner_update: np.ndarray  # target, factor, entry
    inner_forward: np.ndarray  # row, slot, pivot row
    inner_backward: np.ndarray  # slot, column; interior pivots last to first
    inner_backward_first: np.ndarray  # start of each interior pivot's entries, same order
    border: np.ndarray  # slots of the border in use: slot in whole matrix, row, column
    border_divide: np.ndarray  # border slot, pivot number
    border_order: np.ndarray
    border_update: np.ndarray
    border_forward: np.ndarray
    border_backward: np.ndarray
    border_backward_first: np.ndarray


class Values(NamedTuple):
    """Float tables of one group of samples, (·, LANES)."""

    terms: np.ndarray  # coefficients of `Structure.terms` at the predictor
    matrix: np.ndarray  # slots: constant part of the Jacobian, interior eliminated
    inverse: np.ndarray  # one over each interior pivot
    constant: np.ndarray  # c of each row
    constant_time: np.ndarray
    matrix_time: np.ndarray
    shapes: np.ndarray  # (shapes × times)
    square: np.ndarray
    square_rate: np.ndarray
    exponential: np.ndarray  # three rows each: scale, rate, rest
    valve_term: np.ndarray
    lagged: np.ndarray  # largest coefficient by which a row sees each lagged unknown's increment
    step: np.ndarray  # one row: γ Δt, factor from ẏ's increment to y's


class Work(NamedTuple):
    """Scratch tables of one group, (·, LANES)."""

    residual: np.ndarray
    nonlinear: np.ndarray
    increment: np.ndarray
    total: np.ndarray  # sums of increments; after the unknowns, those of the lagged ones that have been seen
    new: np.ndarray  # stacked, border unknowns only in use
    border: np.ndarray  # border matrix of the step
    factor: np.ndarray  # the same, factorised
    inverse: np.ndarray
    slope: np.ndarray  # derivatives of the nonlinear terms, in order
    open: np.ndarray  # valve positions


class Scheme(NamedTuple):
    """Constants of generalised-α and of Newton's loop."""

    alpha_m: float
    alpha_f: float
    gamma: float
    tolerance: float
    iterations: int


@numba.njit(inline="always")
def _exponential(x):
    """exp(x) to about one unit in the last place: 2^k exp(r), |r| ≤ ln 2 / 2, by Taylor's series."""
    x = choose(less(x, spread(-700.0)), spread(-700.0), choose(less(spread(700.0), x), spread(700.0), x))
    k = nearest(x * 1.4426950408889634)
    r = x - k * 0.6931471803691238
    r = r - k * 1.9082149292705877e-10
    p = r * (1.0 / 6227020800.0) + 1.0 / 479001600.0
    p = p * r + 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    return (p * r + 1.0) * power_of_two(k)


@numba.njit(cache=True, nogil=True)
def condense(s, matrix, inverse):
    """Eliminate the interior from `matrix` (slots, LANES) in place; fills `inverse` with one over each pivot."""
    interior = inverse.shape[0]
    for p in range(interior):
        reciprocal = 1.0 / load(matrix, s.pivots[p, 2])
        store(inverse, p, reciprocal)
        for k in range(s.inner_order[p, 0], s.inner_order[p + 1, 0]):
            slot = s.inner_divide[k, 0]
            store(matrix, slot, load(matrix, slot) * reciprocal)
        for k in range(s.inner_order[p, 1], s.inner_order[p + 1, 1]):
            target = s.inner_update[k, 0]
            product = load(matrix, s.inner_update[k, 1]) * load(matrix, s.inner_update[k, 2])
            store(matrix, target, load(matrix, target) - product)


@numba.njit(inline="always")
def _midpoint(old, new, weight):
    return old + (new - old) * weight


@numba.njit(cache=True, nogil=True)
def _nonlinear(s, v, w, state, scheme, time, times):
    """Solution-dependent terms at the present iterate into w.nonlinear, their Jacobian into w.slope."""
    n = v.constant.shape[0]
    to_y = load(v.step, 0) * scheme.alpha_f
    for k in range(s.border.shape[0]):
        store(w.nonlinear, s.border[k, 1], spread(0.0))
    slope = 0
    for k in range(s.valve.shape[0]):
        up = _midpoint(load(state, s.valve[k, 0]), load(w.new, s.valve[k, 0]), scheme.alpha_f)
        down = _midpoint(load(state, s.valve[k, 1]), load(w.new, s.valve[k, 1]), scheme.alpha_f)
        flow = _midpoint(load(state, s.valve[k, 2]), load(w.new, s.valve[k, 2]), scheme.alpha_f)
        shut = both(less_equal(up, down), less_equal(flow, spread(0.0)))
        store(w.open, k, choose(shut, spread(0.0), spread(1.0)))
    for k in range(s.valve_term.shape[0]):
        row, column = s.valve_term[k, 0], s.valve_term[k, 1]
        y = _midpoint(load(state, column), load(w.new, column), scheme.alpha_f)
        coefficient = load(v.valve_term, k) * load(w.open, s.valve_term[k, 2])
        store(w.nonlinear, row, load(w.nonlinear, row) + coefficient * y)
        store(w.slope, slope, coefficient * to_y)
        slope += 1
    for k in range(s.square.shape[0]):
        row, column = s.square[k, 0], s.square[k, 1]
        y = _midpoint(load(state, column), load(w.new, column), scheme.alpha_f)
        product = load(v.square, k) * magnitude(y)
        store(w.nonlinear, row, load(w.nonlinear, row) + product * y)
        store(w.slope, slope, product * 2.0 * to_y)
        slope += 1
    for k in range(s.square_rate.shape[0]):
        row, column = s.square_rate[k, 0], s.square_rate[k, 1]
        y = _midpoint(load(state, column), load(w.new, column), scheme.alpha_f)
        rate = _midpoint(load(state, n + column), load(w.new, n + column), scheme.alpha_m)
        coefficient = load(v.square_rate, k)
        store(w.nonlinear, row, load(w.nonlinear, row) + coefficient * magnitude(y) * rate)
        sign = choose(less(y, spread(0.0)), spread(-1.0), spread(1.0))
        store(w.slope, slope, coefficient * (sign * rate * to_y + magnitude(y) * scheme.alpha_m))
        slope += 1
    for k in range(s.exponential.shape[0]):
        row, column = s.exponential[k, 0], s.exponential[k, 1]
        y = _midpoint(load(state, column), load(w.new, column), scheme.alpha_f)
        scale = load(v.exponential, 3 * k) * load(v.shapes, s.exponential[k, 2] * times + time)
        rate = load(v.exponential, 3 * k + 1)
        grown = _exponential(rate * (y - load(v.exponential, 3 * k + 2)))
        store(w.nonlinear, row, load(w.nonlinear, row) + scale * (grown - 1.0))
        store(w.slope, slope, scale * grown * rate * to_y)
        slope += 1


@numba.njit(cache=True, nogil=True)
def _predictor_residual(s, v, w, state, time, times, scheme):
    """−(E ẏ + F y + c) of every row at the predictor, solution-dependent terms left out."""
    n = v.constant.shape[0]
    for row in range(n):
        sum_ = spread(0.0) - load(v.constant, row)
        for k in range(s.linear[row], s.linear[row + 1]):
            sum_ = sum_ - load(v.terms, k) * load(state, s.terms[k])
        store(w.residual, row, sum_)
    for k in range(s.constant_time.shape[0]):
        row = s.constant_time[k, 0]
        shape = load(v.shapes, s.constant_time[k, 1] * times + time)
        store(w.residual, row, load(w.residual, row) - load(v.constant_time, k) * shape)
    to_rate = 1.0 - scheme.alpha_m / scheme.gamma
    for k in range(s.matrix_time.shape[0]):
        row, column = s.matrix_time[k, 0], s.matrix_time[k, 1]
        coefficient = load(v.matrix_time, k) * load(v.shapes, s.matrix_time[k, 2] * times + time)
        value = load(state, column)
        if column >= n:
            value = value * to_rate
        store(w.residual, row, load(w.residual, row) - coefficient * value)


@numba.njit(cache=True, nogil=True)
def _border_of_step(s, v, w, time, times, scheme):
    """Border matrix with the entries that change in time, but not with the solution."""
    n = v.constant.shape[0]
    for k in range(s.border.shape[0]):
        store(w.border, k, load(v.matrix, s.border[k, 0]))
    to_y = load(v.step, 0) * scheme.alpha_f
    for k in range(s.matrix_time.shape[0]):
        slot = s.matrix_time[k, 3]
        coefficient = load(v.matrix_time, k) * load(v.shapes, s.matrix_time[k, 2] * times + time)
        if s.matrix_time[k, 1] >= n:
            store(w.border, slot, load(w.border, slot) + coefficient * scheme.alpha_m)
        else:
            store(w.border, slot, load(w.border, slot) + coefficient * to_y)


@numba.njit(cache=True, nogil=True)
def _factorise(s, w, interior):
    """Border matrix with the present slopes, factorised."""
    for k in range(s.border.shape[0]):
        store(w.factor, k, load(w.border, k))
    slope = 0
    for k in range(s.valve_term.shape[0]):
        slot = s.valve_term[k, 3]
        store(w.factor, slot, load(w.factor, slot) + load(w.slope, slope))
        slope += 1
    for k in range(s.square.shape[0]):
        slot = s.square[k, 2]
        store(w.factor, slot, load(w.factor, slot) + load(w.slope, slope))
        slope += 1
    for k in range(s.square_rate.shape[0]):
        slot = s.square_rate[k, 2]
        store(w.factor, slot, load(w.factor, slot) + load(w.slope, slope))
        slope += 1
    for k in range(s.exponential.shape[0]):
        slot = s.exponential[k, 3]
        store(w.factor, slot, load(w.factor, slot) + load(w.slope, slope))
        slope += 1
    for p in range(w.inverse.shape[0]):
        reciprocal = 1.0 / load(w.factor, s.pivots[interior + p, 2])
        store(w.inverse, p, reciprocal)
        for k in range(s.border_order[p, 0], s.border_order[p + 1, 0]):
            slot = s.border_divide[k, 0]
            store(w.factor, slot, load(w.factor, slot) * reciprocal)
        for k in range(s.border_order[p, 1], s.border_order[p + 1, 1]):
            target = s.border_update[k, 0]
            product = load(w.factor, s.border_update[k, 1]) * load(w.factor, s.border_update[k, 2])
            store(w.factor, target, load(w.factor, target) - product)


@numba.njit(cache=True, nogil=True)
def _solve_border(s, w, interior):
    """w.increment of the border unknowns from the border rows of w.nonlinear, which hold the residual."""
    for k in range(s.border_forward.shape[0]):
        row = s.border_forward[k, 0]
        product = load(w.factor, s.border_forward[k, 1]) * load(w.nonlinear, s.border_forward[k, 2])
        store(w.nonlinear, row, load(w.nonlinear, row) - product)
    for p in range(w.inverse.shape[0] - 1, -1, -1):
        sum_ = load(w.nonlinear, s.pivots[interior + p, 0])
        place = w.inverse.shape[0] - 1 - p
        for k in range(s.border_backward_first[place], s.border_backward_first[place + 1]):
            sum_ = sum_ - load(w.factor, s.border_backward[k, 0]) * load(w.increment, s.border_backward[k, 1])
        store(w.increment, s.pivots[interior + p, 1], sum_ * load(w.inverse, p))


@numba.njit(cache=True, nogil=True)
def _recover_interior(s, v, w, state, scheme, moving):
    """Interior increments from those of the border, and the new state of both."""
    n, interior = v.constant.shape[0], v.inverse.shape[0]
    to_y, keep = load(v.step, 0), 1.0 - 1.0 / scheme.gamma
    for p in range(interior - 1, -1, -1):
        sum_ = load(w.residual, s.pivots[p, 0])
        place = interior - 1 - p
        for k in range(s.inner_backward_first[place], s.inner_backward_first[place + 1]):
            sum_ = sum_ - load(v.matrix, s.inner_backward[k, 0]) * load(w.total, s.inner_backward[k, 1])
        column = s.pivots[p, 1]
        increment = choose(moving, sum_ * load(v.inverse, p), spread(0.0))
        store(w.total, column, increment)
        store(state, column, load(state, column) + increment * to_y)
        store(state, n + column, load(state, n + column) * keep + increment)
    for p in range(interior, n):
        column = s.pivots[p, 1]
        store(state, column, load(w.new, column))
        store(state, n + column, load(w.new, n + column))


@numba.njit(cache=True, nogil=True)
def march(s, v, w, state, scheme, steps, times, failed, recorded, means, lows, highs, waves, counts):
    """Advance `state` (2n, LANES) by `steps` steps from the start of a cycle; `times` steps make a cycle.

    failed: (1, LANES), nonzero in lanes that did not converge and are no longer advanced; it takes the number of the
    step (from 1) at which a lane failed. recorded: stacked unknowns of which means (trapezoidal), lows and highs over
    the steps are kept, (·, LANES). waves: (steps + 1, ·, LANES) of the same unknowns, or empty.
    counts: [solves]: lane-group Newton solves, added to.
    """
    n, interior = v.constant.shape[0], v.inverse.shape[0]
    to_y, keep = load(v.step, 0), 1.0 - 1.0 / scheme.gamma
    share = 1.0 / steps
    for k in range(recorded.shape[0]):
        value = load(state, recorded[k])
        store(means, k, value * (0.5 * share))
        store(lows, k, value)
        store(highs, k, value)
        if waves.shape[0] > 0:
            store(waves[0], k, value)
    for step in range(steps):
        time = step % times
        sound = less_equal(load(failed, 0), spread(0.0))
        _predictor_residual(s, v, w, state, time, times, scheme)
        _border_of_step(s, v, w, time, times, scheme)
        for p in range(interior, n):
            column = s.pivots[p, 1]
            store(w.new, column, load(state, column))
            store(w.new, n + column, load(state, n + column) * keep)
            store(w.total, column, spread(0.0))
        for k in range(s.lagged.shape[0]):
            store(w.total, n + k, spread(0.0))
        _nonlinear(s, v, w, state, scheme, time, times)
        largest, poison = spread(0.0), spread(0.0)
        for p in range(n):
            row = s.pivots[p, 0]
            value = load(w.residual, row)
            if p >= interior:
                value = value - load(w.nonlinear, row)
            # Maxima forget NaN; nought times the value does not.
            poison = poison + value * 0.0
            value = magnitude(value)
            largest = choose(less(largest, value), value, largest)
        settled = choose(less(largest + poison, spread(scheme.tolerance)), spread(0.0), spread(1.0))
        active = choose(sound, settled, spread(0.0))
        moving = less(spread(0.5), active)
        for k in range(s.inner_forward.shape[0]):
            row = s.inner_forward[k, 0]
            product = load(v.matrix, s.inner_forward[k, 1]) * load(w.residual, s.inner_forward[k, 2])
            store(w.residual, row, load(w.residual, row) - product)
        for p in range(interior, n):
            row = s.pivots[p, 0]
            store(w.nonlinear, row, load(w.residual, row) - load(w.nonlinear, row))
        going = moving
        for _ in range(scheme.iterations - 1):
            if not any_lane(going):
                break
            counts[0] += 1
            _factorise(s, w, interior)
            _solve_border(s, w, interior)
            for k in range(s.valve.shape[0]):
                flow = s.valve[k, 2]
                shut = both(less(load(w.open, k), spread(0.5)), going)
                store(w.new, flow, choose(shut, spread(0.0), load(w.new, flow)))
            for p in range(interior, n):
                column = s.pivots[p, 1]
                increment = choose(going, load(w.increment, column), spread(0.0))
                store(w.increment, column, increment)
                store(w.total, column, load(w.total, column) + increment)
                store(w.new, column, load(w.new, column) + increment * to_y)
                store(w.new, n + column, load(w.new, n + column) + increment)
            for k in range(s.border.shape[0]):
                row = s.border[k, 1]
                product = load(w.border, k) * load(w.increment, s.border[k, 2])
                store(w.residual, row, load(w.residual, row) - product)
            _nonlinear(s, v, w, state, scheme, time, times)
            largest, poison = spread(0.0), spread(0.0)
            for p in range(interior, n):
                row = s.pivots[p, 0]
                value = load(w.residual, row) - load(w.nonlinear, row)
                store(w.nonlinear, row, value)
                poison = poison + value * 0.0
                value = magnitude(value)
                largest = choose(less(largest, value), value, largest)
            for k in range(s.lagged.shape[0]):
                increment = load(w.increment, s.lagged[k])
                value = magnitude(load(v.lagged, k) * increment)
                largest = choose(less(largest, value), value, largest)
                store(w.total, n + k, load(w.total, s.lagged[k]) - increment)
            settled = choose(less(largest + poison, spread(scheme.tolerance)), spread(0.0), spread(1.0))
            active = choose(going, settled, spread(0.0))
            going = less(spread(0.5), active)
            for k in range(s.lagged_border.shape[0]):
                row = s.lagged_border[k, 1]
                seen = load(w.increment, s.lagged[s.lagged_border[k, 2]])
                product = load(v.matrix, s.lagged_border[k, 0]) * seen
                store(w.residual, row, load(w.residual, row) - product)
                store(w.nonlinear, row, load(w.nonlinear, row) - product)
        if any_lane(going):
            store(failed, 0, choose(going, spread(step + 1.0), load(failed, 0)))
        _recover_interior(s, v, w, state, scheme, moving)
        weight = share if step < steps - 1 else 0.5 * share
        for k in range(recorded.shape[0]):
            value = load(state, recorded[k])
            store(means, k, load(means, k) + value * weight)
            low, high = load(lows, k), load(highs, k)
            store(lows, k, choose(less(value, low), value, low))
            store(highs, k, choose(less(high, value), value, high))
            if waves.shape[0] > 0:
                store(waves[step + 1], k, value)
