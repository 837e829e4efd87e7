"""Tables that the kernels work on: index tables of a network, values and scratch of a group of samples, its record."""

from typing import NamedTuple

import numpy as np


class Scheme(NamedTuple):
    """Constants of generalised-α and of Newton's loop."""

    alpha_m: float
    alpha_f: float
    gamma: float
    tolerance: float
    iterations: int


class Structure(NamedTuple):
    """Index tables of one network, uint32; rows and columns number equations and unknowns, pivots the elimination.

    Stacked unknowns are y, then ẏ, so that n + j is ẏ_j. A list "of x" has its ends in `x_first`, one more than there
    are x. The border's matrix of one step is one table: its entries as they stand at the start of the step, then those
    entries that depend on the solution, then the entries of its factors.
    """

    pivots: np.ndarray  # (n, 2) row, column, interior first
    terms_first: np.ndarray
    terms: np.ndarray  # stacked unknown of each term, of pivots' rows
    constant_rows: np.ndarray  # rows whose constant changes in time
    constant_first: np.ndarray
    constant_shape: np.ndarray
    matrix_time: np.ndarray  # row, stacked column, shape, border entry
    forward_first: np.ndarray
    forward: np.ndarray  # slot, pivot: interior pivots that a pivot's row needs
    backward_first: np.ndarray
    backward: np.ndarray  # slot, column, of interior pivots
    border: np.ndarray  # slot of each border entry
    product_first: np.ndarray
    product: np.ndarray  # border entry, column, of border rows
    lagged: np.ndarray  # unknowns whose increments some rows see one iteration late
    lagged_border: np.ndarray  # slot, border row, number in `lagged`
    square: np.ndarray  # border row, column, entry, place in table
    square_rate: np.ndarray
    exponential: np.ndarray  # border row, column, entry, place in table, shape
    valve: np.ndarray  # upstream pressure, downstream pressure, flow
    valve_term: np.ndarray  # border row, column, entry, place in table, valve
    gate: np.ndarray  # upstream pressure, downstream pressure
    gate_term: np.ndarray  # border row, column, entry, place in table, gate
    gate_constant: np.ndarray  # border row, gate
    gate_slope: np.ndarray  # border row, pressure, entry, place in table, gate, column of the term (none: beyond n)
    factor_first: np.ndarray  # (pivots + 1, 2): first upper and first lower target of each border pivot
    factor: np.ndarray  # source, destination of each target, in order: pivot, upper row, lower column
    pairs_first: np.ndarray
    pairs: np.ndarray  # lower, upper: what each target subtracts
    border_forward_first: np.ndarray
    border_forward: np.ndarray  # place, border pivot
    border_backward_first: np.ndarray
    border_backward: np.ndarray  # place, column


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
    gate: np.ndarray  # steepness, 0 for a step
    gate_term: np.ndarray
    gate_constant: np.ndarray
    gate_slope: np.ndarray
    lagged: np.ndarray  # largest coefficient by which a row sees each lagged unknown's increment
    step: np.ndarray  # one row: γ Δt, factor from ẏ's increment to y's


class Work(NamedTuple):
    """Scratch tables of one group, (·, LANES)."""

    constant: np.ndarray  # c of each row at the step
    reduced: np.ndarray  # right-hand side of each pivot, interior eliminated
    linear: np.ndarray  # border rows: residual without the solution-dependent terms
    residual: np.ndarray  # border rows: residual, then right-hand side of the solve
    increment: np.ndarray
    total: np.ndarray  # sums of increments; after the unknowns, those of the lagged ones that have been seen
    matrix: np.ndarray  # see `Structure`
    inverse: np.ndarray  # one over each border pivot
    slope: np.ndarray  # derivatives of the solution-dependent terms, in order
    open: np.ndarray  # valve positions
    factored: np.ndarray  # valve positions when the border was factorised
    flow: np.ndarray  # valve flows at the end of the step
    shut: np.ndarray  # two rows for each gate: degree of closure, and its derivative


class Record(NamedTuple):
    """Record of a march: trapezoidal mean, minimum, maximum and waveform of `unknowns` (stacked).

    waves: (steps + 1, unknowns, LANES), or empty. floor, ceiling: minimum and maximum of every y, sampled every
    `kernels.STRIDE` steps.
    """

    unknowns: np.ndarray
    mean: np.ndarray
    least: np.ndarray
    greatest: np.ndarray
    waves: np.ndarray
    floor: np.ndarray
    ceiling: np.ndarray
