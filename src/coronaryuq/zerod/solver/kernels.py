"""Compiled time stepping of one group of samples (`LANES` at a time): generalised-α with Newton on the border.

The scheme is that of svZeroDSolver (Jansen, Whiting & Hulbert 2000): predictor with constant y, residual at
y_αf and ẏ_αm, Newton until max|residual| < tolerance, checked before each solve. Equations of the interior are linear
with constant coefficients, so that once their residual at the predictor is known, one forward and one backward pass per
step solve them exactly; Newton's loop sees only the border.
"""

from typing import Any

from coronaryuq.core.jit import njit, njit_inner
from coronaryuq.core.simd import absolute, any_lane, both, choose, less, less_equal, nearest, power_of_two, store
from coronaryuq.zerod.solver.lanes import load, splat

STRIDE = 8
_FRESH = 2
"""First Newton solves of a step, which factorise the border anew; later ones do so only where a valve has moved or the
residual has grown: a vessel with a strong quadratic loss may start far from its solution."""
_PATIENCE = 10
"""Solves of a step after which every further one factorises anew: with a strong quadratic loss, slopes change too much
for the first iterations' factors."""


@njit(inline="always")
def _exponential(x):
    """Compute exp(x) to about one unit in the last place: 2^k exp(r), |r| ≤ ln 2 / 2, by Taylor's series."""
    x = choose(less(x, splat(-700.0)), splat(-700.0), choose(less(splat(700.0), x), splat(700.0), x))
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


KERNEL: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}
"""Options of every kernel; without numba's runtime a kernel that would allocate does not compile."""


@njit(**KERNEL)
def condense(pivots, divide, update, first, matrix, inverse):
    """Eliminate the interior from `matrix` (slots, LANES) in place; `inverse` gets one over each interior pivot.

    pivots: slots. divide: slots. update: target, factor, entry. first: (pivots + 1, 2) where each pivot's begin.
    """
    for p in range(inverse.shape[0]):
        reciprocal = 1.0 / load(matrix, pivots[p])
        store(inverse, p, reciprocal)
        for k in range(first[p, 0], first[p + 1, 0]):
            store(matrix, divide[k], load(matrix, divide[k]) * reciprocal)
        for k in range(first[p, 1], first[p + 1, 1]):
            product = load(matrix, update[k, 1]) * load(matrix, update[k, 2])
            store(matrix, update[k, 0], load(matrix, update[k, 0]) - product)


@njit_inner(**KERNEL)
def _predict(s, v, w, state, scheme, time, times):
    """Compute residuals at the predictor without solution-dependent terms, with the interior eliminated.

    Also sets up the border's matrix of the step. Returns the largest residual of the interior.
    """
    n, interior = v.constant.shape[0], v.inverse.shape[0]
    for k in range(s.constant_rows.shape[0]):
        row = s.constant_rows[k]
        sum_ = load(v.constant, row)
        for j in range(s.constant_first[k], s.constant_first[k + 1]):
            sum_ = sum_ + load(v.constant_time, j) * load(v.shapes, s.constant_shape[j] * times + time)
        store(w.constant, row, sum_)
    largest, poison = splat(0.0), splat(0.0)
    for p in range(n):
        sum_ = splat(0.0) - load(w.constant, s.pivots[p, 0])
        for k in range(s.terms_first[p], s.terms_first[p + 1]):
            sum_ = sum_ - load(v.terms, k) * load(state, s.terms[k])
        if p < interior:
            # A maximum drops NaN; zero times the value keeps it.
            poison = poison + sum_ * 0.0
            size = absolute(sum_)
            largest = choose(less(largest, size), size, largest)
        else:
            store(w.residual, p - interior, sum_)
        for k in range(s.forward_first[p], s.forward_first[p + 1]):
            sum_ = sum_ - load(v.matrix, s.forward[k, 0]) * load(w.reduced, s.forward[k, 1])
        store(w.reduced, p, sum_)
    for k in range(s.border.shape[0]):
        store(w.matrix, k, load(v.matrix, s.border[k]))
    to_y, to_rate = (load(v.step, 0) * scheme.alpha_f, 1.0 - scheme.alpha_m / scheme.gamma)
    for k in range(s.matrix_time.shape[0]):
        row, column, entry = (s.matrix_time[k, 0], s.matrix_time[k, 1], s.matrix_time[k, 3])
        coefficient = load(v.matrix_time, k) * load(v.shapes, s.matrix_time[k, 2] * times + time)
        if column >= n:
            product = coefficient * load(state, column) * to_rate
            store(w.matrix, entry, load(w.matrix, entry) + coefficient * scheme.alpha_m)
        else:
            product = coefficient * load(state, column)
            store(w.matrix, entry, load(w.matrix, entry) + coefficient * to_y)
        store(w.residual, row, load(w.residual, row) - product)
        store(w.reduced, interior + row, load(w.reduced, interior + row) - product)
    return largest + poison


@njit_inner(**KERNEL)
def _subtract_solution_dependent(s, v, w, state, scheme, time, times):
    """Subtract the solution-dependent terms at the present iterate from w.residual; write derivatives to w.slope."""
    n = v.constant.shape[0]
    to_y, to_rate = (load(v.step, 0) * scheme.alpha_f, 1.0 - scheme.alpha_m / scheme.gamma)
    slope = 0
    for k in range(s.valve.shape[0]):
        up = load(state, s.valve[k, 0]) + load(w.total, s.valve[k, 0]) * to_y
        down = load(state, s.valve[k, 1]) + load(w.total, s.valve[k, 1]) * to_y
        old = load(state, s.valve[k, 2])
        flow = old + (load(w.flow, k) - old) * scheme.alpha_f
        shut = both(less_equal(up, down), less_equal(flow, splat(0.0)))
        store(w.open, k, choose(shut, splat(0.0), splat(1.0)))
    for k in range(s.valve_term.shape[0]):
        row, valve = s.valve_term[k, 0], s.valve_term[k, 4]
        old = load(state, s.valve_term[k, 1])
        flow = old + (load(w.flow, valve) - old) * scheme.alpha_f
        coefficient = load(v.valve_term, k) * load(w.open, valve)
        store(w.residual, row, load(w.residual, row) - coefficient * flow)
        store(w.slope, slope, coefficient * to_y)
        slope += 1
    for k in range(s.square.shape[0]):
        row, column = s.square[k, 0], s.square[k, 1]
        y = load(state, column) + load(w.total, column) * to_y
        product = load(v.square, k) * absolute(y)
        store(w.residual, row, load(w.residual, row) - product * y)
        store(w.slope, slope, product * 2.0 * to_y)
        slope += 1
    for k in range(s.square_rate.shape[0]):
        row, column = s.square_rate[k, 0], s.square_rate[k, 1]
        y = load(state, column) + load(w.total, column) * to_y
        rate = load(state, n + column) * to_rate + load(w.total, column) * scheme.alpha_m
        coefficient = load(v.square_rate, k)
        store(w.residual, row, load(w.residual, row) - coefficient * absolute(y) * rate)
        sign = choose(less(y, splat(0.0)), splat(-1.0), splat(1.0))
        store(w.slope, slope, coefficient * (sign * rate * to_y + absolute(y) * scheme.alpha_m))
        slope += 1
    for k in range(s.exponential.shape[0]):
        row, column = s.exponential[k, 0], s.exponential[k, 1]
        y = load(state, column) + load(w.total, column) * to_y
        scale = load(v.exponential, 3 * k) * load(v.shapes, s.exponential[k, 4] * times + time)
        rate = load(v.exponential, 3 * k + 1)
        grown = _exponential(rate * (y - load(v.exponential, 3 * k + 2)))
        store(w.residual, row, load(w.residual, row) - scale * (grown - 1.0))
        store(w.slope, slope, scale * grown * rate * to_y)
        slope += 1
    _subtract_gates(s, v, w, state, to_y)


@njit_inner(**KERNEL)
def _subtract_gates(s, v, w, state, to_y):
    """Take the terms of gates from w.residual; their derivatives follow those of the other terms in w.slope."""
    n = v.constant.shape[0]
    # Counted anew: a number passed on would be a literal or not, and the kernel be compiled for both.
    slope = s.valve_term.shape[0] + s.square.shape[0] + s.square_rate.shape[0] + s.exponential.shape[0]
    for k in range(s.gate.shape[0]):
        up = load(state, s.gate[k, 0]) + load(w.total, s.gate[k, 0]) * to_y
        down = load(state, s.gate[k, 1]) + load(w.total, s.gate[k, 1]) * to_y
        steepness = load(v.gate, k)
        smooth = 1.0 / (_exponential(steepness * (up - down) * 2.0) + 1.0)
        step = choose(less(down, up), splat(0.0), splat(1.0))
        share = choose(less(splat(0.0), steepness), smooth, step)
        store(w.shut, 2 * k, share)
        store(w.shut, 2 * k + 1, steepness * share * (1.0 - share) * 2.0 * to_y)
    for k in range(s.gate_term.shape[0]):
        row, column, gate = s.gate_term[k, 0], s.gate_term[k, 1], s.gate_term[k, 4]
        y = load(state, column) + load(w.total, column) * to_y
        coefficient = load(v.gate_term, k) * load(w.shut, 2 * gate)
        store(w.residual, row, load(w.residual, row) - coefficient * y)
        store(w.slope, slope, coefficient * to_y)
        slope += 1
    for k in range(s.gate_constant.shape[0]):
        row, gate = s.gate_constant[k, 0], s.gate_constant[k, 1]
        store(w.residual, row, load(w.residual, row) - load(v.gate_constant, k) * load(w.shut, 2 * gate))
    for k in range(s.gate_slope.shape[0]):
        gate, column = s.gate_slope[k, 4], s.gate_slope[k, 5]
        coefficient = load(v.gate_slope, k) * load(w.shut, 2 * gate + 1)
        if column < n:
            coefficient = coefficient * (load(state, column) + load(w.total, column) * to_y)
        store(w.slope, slope, coefficient)
        slope += 1


@njit(inline="always")
def _put(table, row, value, which, everywhere):
    if everywhere:
        store(table, row, value)
    else:
        store(table, row, choose(which, value, load(table, row)))


@njit(inline="always")
def _put_slopes(terms, w, first, which, everywhere):
    """Add the derivatives of one kind of term to the matrix; every such entry belongs to one term only."""
    for k in range(terms.shape[0]):
        value = load(w.matrix, terms[k, 2]) + load(w.slope, first + k)
        _put(w.matrix, terms[k, 3], value, which, everywhere)
    return first + terms.shape[0]


@njit_inner(**KERNEL)
def _factorise(s, w, which, everywhere):
    """Factorise the border's matrix at the present slopes (Crout's order), in the lanes of `which` or everywhere."""
    slope = _put_slopes(s.valve_term, w, 0, which, everywhere)
    slope = _put_slopes(s.square, w, slope, which, everywhere)
    slope = _put_slopes(s.square_rate, w, slope, which, everywhere)
    slope = _put_slopes(s.exponential, w, slope, which, everywhere)
    slope = _put_slopes(s.gate_term, w, slope, which, everywhere)
    slope = _put_slopes(s.gate_slope, w, slope, which, everywhere)
    for p in range(w.inverse.shape[0]):
        upper, lower, end = (s.factor_first[p, 0], s.factor_first[p, 1], s.factor_first[p + 1, 0])
        reciprocal = splat(0.0)
        for k in range(upper, end):
            sum_ = load(w.matrix, s.factor[k, 0])
            for j in range(s.pairs_first[k], s.pairs_first[k + 1]):
                sum_ = sum_ - load(w.matrix, s.pairs[j, 0]) * load(w.matrix, s.pairs[j, 1])
            if k == upper:
                reciprocal = 1.0 / sum_
                _put(w.inverse, p, reciprocal, which, everywhere)
            elif k < lower:
                _put(w.matrix, s.factor[k, 1], sum_, which, everywhere)
            else:
                _put(w.matrix, s.factor[k, 1], sum_ * reciprocal, which, everywhere)


@njit_inner(**KERNEL)
def _solve_border(s, w, interior, going):
    """Solve the border for w.residual; add the increments of lanes that are `going` to their totals."""
    size = w.inverse.shape[0]
    for p in range(size):
        sum_ = load(w.residual, p)
        for k in range(s.border_forward_first[p], s.border_forward_first[p + 1]):
            sum_ = sum_ - load(w.matrix, s.border_forward[k, 0]) * load(w.residual, s.border_forward[k, 1])
        store(w.residual, p, sum_)
    for place in range(size):
        p = size - 1 - place
        sum_ = load(w.residual, p)
        for k in range(s.border_backward_first[place], s.border_backward_first[place + 1]):
            sum_ = sum_ - load(w.matrix, s.border_backward[k, 0]) * load(w.increment, s.border_backward[k, 1])
        column = s.pivots[interior + p, 1]
        increment = choose(going, sum_ * load(w.inverse, p), splat(0.0))
        store(w.increment, column, increment)
        store(w.total, column, load(w.total, column) + increment)


@njit_inner(**KERNEL)
def _finish(s, v, w, state, scheme, moving):
    """Compute interior increments from those of the border, and the new state of both."""
    n, interior = v.constant.shape[0], v.inverse.shape[0]
    to_y, keep = load(v.step, 0), 1.0 - 1.0 / scheme.gamma
    for place in range(interior):
        p = interior - 1 - place
        sum_ = load(w.reduced, p)
        for k in range(s.backward_first[place], s.backward_first[place + 1]):
            sum_ = sum_ - load(v.matrix, s.backward[k, 0]) * load(w.total, s.backward[k, 1])
        column = s.pivots[p, 1]
        store(w.total, column, choose(moving, sum_ * load(v.inverse, p), splat(0.0)))
    for column in range(n):
        increment = load(w.total, column)
        store(state, column, load(state, column) + increment * to_y)
        store(state, n + column, load(state, n + column) * keep + increment)
    for k in range(s.valve.shape[0]):
        store(state, s.valve[k, 2], load(w.flow, k))


@njit_inner(**KERNEL)
def _step(s, v, w, state, scheme, time, times, sound):
    """Take one time step; return the number of solves and the lanes that did not converge."""
    n, interior = v.constant.shape[0], v.inverse.shape[0]
    size = n - interior
    to_y = load(v.step, 0)
    largest = _predict(s, v, w, state, scheme, time, times)
    for p in range(interior, n):
        store(w.total, s.pivots[p, 1], splat(0.0))
    for k in range(s.lagged.shape[0]):
        store(w.total, n + k, splat(0.0))
    for k in range(s.valve.shape[0]):
        store(w.flow, k, load(state, s.valve[k, 2]))
    for p in range(size):
        store(w.linear, p, load(w.residual, p))
    _subtract_solution_dependent(s, v, w, state, scheme, time, times)
    poison = splat(0.0)
    for p in range(size):
        # The residual before the interior is eliminated decides whether to move at all.
        value, without = load(w.residual, p), load(w.linear, p)
        poison = poison + value * 0.0
        size_ = absolute(value)
        largest = choose(less(largest, size_), size_, largest)
        reduced = load(w.reduced, interior + p)
        store(w.linear, p, reduced)
        store(w.residual, p, reduced + (value - without))
    settled = choose(less(largest + poison, splat(scheme.tolerance)), splat(0.0), splat(1.0))
    going = less(splat(0.5), choose(sound, settled, splat(0.0)))
    moving, grown = going, splat(0.0)
    solves = 0
    while solves < scheme.iterations - 1 and any_lane(going):
        if solves < _FRESH:
            _factorise(s, w, going, True)
            for k in range(s.valve.shape[0]):
                store(w.factored, k, load(w.open, k))
        else:
            moved = splat(0.0)
            for k in range(s.valve.shape[0]):
                moved = moved + absolute(load(w.open, k) - load(w.factored, k))
            late = splat(1.0) if solves >= _PATIENCE or s.gate.shape[0] > 0 else moved + grown
            which = both(less(splat(0.5), late), going)
            if any_lane(which):
                _factorise(s, w, which, False)
                for k in range(s.valve.shape[0]):
                    store(w.factored, k, choose(which, load(w.open, k), load(w.factored, k)))
        _solve_border(s, w, interior, going)
        solves += 1
        for k in range(s.valve.shape[0]):
            shut = both(less(load(w.open, k), splat(0.5)), going)
            flow = choose(shut, splat(0.0), load(w.flow, k))
            store(w.flow, k, flow + load(w.increment, s.valve[k, 2]) * to_y)
        for p in range(size):
            sum_ = load(w.linear, p)
            for k in range(s.product_first[p], s.product_first[p + 1]):
                sum_ = sum_ - load(w.matrix, s.product[k, 0]) * load(w.increment, s.product[k, 1])
            store(w.linear, p, sum_)
            store(w.residual, p, sum_)
        _subtract_solution_dependent(s, v, w, state, scheme, time, times)
        before, largest, poison = largest, splat(0.0), splat(0.0)
        for p in range(size):
            value = load(w.residual, p)
            poison = poison + value * 0.0
            value = absolute(value)
            largest = choose(less(largest, value), value, largest)
        for k in range(s.lagged.shape[0]):
            increment = load(w.increment, s.lagged[k])
            value = absolute(load(v.lagged, k) * increment)
            largest = choose(less(largest, value), value, largest)
            seen = load(w.total, s.lagged[k]) - increment
            store(w.total, n + k, choose(going, seen, load(w.total, n + k)))
        grown = choose(less(before, largest), splat(1.0), splat(0.0))
        settled = choose(less(largest + poison, splat(scheme.tolerance)), splat(0.0), splat(1.0))
        going = less(splat(0.5), choose(going, settled, splat(0.0)))
        for k in range(s.lagged_border.shape[0]):
            row = s.lagged_border[k, 1]
            seen = load(w.increment, s.lagged[s.lagged_border[k, 2]])
            product = load(v.matrix, s.lagged_border[k, 0]) * seen
            store(w.linear, row, load(w.linear, row) - product)
            store(w.residual, row, load(w.residual, row) - product)
    _finish(s, v, w, state, scheme, moving)
    return solves, going


@njit(**KERNEL)
def march(s, v, w, state, scheme, steps, times, failed, record, counts):
    """Advance `state` (2n, LANES) by `steps` steps from the start of a cycle; `times` steps make a cycle.

    failed: (1, LANES), step (from 1) at which a lane did not converge, or 0; failed lanes are no longer advanced.
    counts: [solves] of this group, incremented.
    """
    share = 1.0 / steps
    for row in range(v.constant.shape[0]):
        store(w.constant, row, load(v.constant, row))
    for k in range(record.unknowns.shape[0]):
        value = load(state, record.unknowns[k])
        store(record.mean, k, value * (0.5 * share))
        store(record.least, k, value)
        store(record.greatest, k, value)
        if record.waves.shape[0] > 0:
            store(record.waves[0], k, value)
    for k in range(record.floor.shape[0]):
        store(record.floor, k, load(state, k))
        store(record.ceiling, k, load(state, k))
    for step in range(steps):
        sound = less_equal(load(failed, 0), splat(0.0))
        solves, unconverged = _step(s, v, w, state, scheme, step % times, times, sound)
        counts[0] += solves
        if any_lane(unconverged):
            store(failed, 0, choose(unconverged, splat(step + 1.0), load(failed, 0)))
        weight = share if step < steps - 1 else 0.5 * share
        for k in range(record.unknowns.shape[0]):
            value = load(state, record.unknowns[k])
            store(record.mean, k, load(record.mean, k) + value * weight)
            low, high = load(record.least, k), load(record.greatest, k)
            store(record.least, k, choose(less(value, low), value, low))
            store(record.greatest, k, choose(less(high, value), value, high))
            if record.waves.shape[0] > 0:
                store(record.waves[step + 1], k, value)
        if (step + 1) % STRIDE == 0:
            for k in range(record.floor.shape[0]):
                value = load(state, k)
                low, high = load(record.floor, k), load(record.ceiling, k)
                store(record.floor, k, choose(less(value, low), value, low))
                store(record.ceiling, k, choose(less(high, value), value, high))
