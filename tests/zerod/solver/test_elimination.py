"""The operations of a tape solve any sparse system."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from coronaryuq.zerod.solver.elimination import Entries, Singular, Tape, eliminate, equilibrated
from coronaryuq.zerod.solver.markowitz import THRESHOLD


def solved(tape: Tape, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve matrix x = right by the operations of a tape."""
    values = np.zeros(len(tape.slot_row))
    original = tape.slot_column < len(matrix)
    values[original] = matrix[tape.slot_row[original], tape.slot_column[original]]
    right = right.copy()
    for p in range(len(tape.pivots)):
        for entry, pivot in tape.divide[tape.divide_first[p] : tape.divide_first[p + 1]]:
            values[entry] /= values[pivot]
        for target, factor, entry in tape.update[tape.update_first[p] : tape.update_first[p + 1]]:
            values[target] -= values[factor] * values[entry]
        for row, slot, pivot_row in tape.forward[tape.forward_first[p] : tape.forward_first[p + 1]]:
            right[row] -= values[slot] * right[pivot_row]
    x = np.zeros(len(matrix))
    for p in reversed(range(len(tape.pivots))):
        row, column, pivot = tape.pivots[p]
        for slot, other in tape.backward_of(p):
            if other < len(matrix):
                right[row] -= values[slot] * x[other]
        x[column] = right[row] / values[pivot]
    return x


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 14), st.integers(0, 2))
def test_a_tape_solves_any_sparse_system(seed, n, carried):
    random = np.random.default_rng(seed)
    pattern = random.random((n, n + carried)) < 0.3
    pattern[np.arange(n), random.permutation(n)] = True
    scenarios = np.where(pattern, random.standard_normal((3, n, n + carried)), 0.0)
    inner = random.random((2, n)) < 0.7
    assume(min(np.abs(np.linalg.det(matrix[:, :n])) for matrix in scenarios) > 1e-3)
    entries = Entries.at(np.argwhere(pattern), n, n + carried)
    try:
        tape = eliminate(entries, scenarios[:, pattern], *inner)
    except Singular:
        assume(False)  # no entry serves all scenarios
    assert sorted(tape.pivots[:, 0]) == sorted(tape.pivots[:, 1]) == list(range(n))
    assert all(inner[0, row] and inner[1, column] for row, column, _ in tape.pivots[: tape.interior])
    for matrix in scenarios:
        right = random.standard_normal(n)
        assert solved(tape, matrix[:, :n], right) == pytest.approx(np.linalg.solve(matrix[:, :n], right), rel=1e-6)


def test_a_system_without_solution_names_its_equation():
    matrix = np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    with pytest.raises(Singular) as error:
        eliminate(
            Entries.at(np.argwhere(matrix), 3, 3), matrix[None, matrix != 0.0], np.ones(3, bool), np.ones(3, bool)
        )
    assert error.value.row == 1


def markowitz(matrix: np.ndarray) -> list[tuple[int, int]]:
    """Order the pivots of a dense matrix as defined: least bound on fill-in, largest share of the row, first place."""
    left, matrix, order = matrix != 0.0, matrix.copy(), []
    while left.any():
        largest = np.abs(np.where(left, matrix, 0.0)).max(axis=1, keepdims=True)
        worth = np.where(left, np.abs(matrix), 0.0) / np.where(largest > 0.0, largest, 1.0)
        cost = np.outer(left.sum(axis=1) - 1, left.sum(axis=0) - 1)
        row, column = min(np.argwhere(worth > THRESHOLD), key=lambda at: (cost[*at], -worth[*at], *at))
        order.append((row, column))
        below, right = left[:, column] & (np.arange(len(left)) != row), left[row] & (np.arange(len(left)) != column)
        matrix[np.ix_(below, right)] -= np.outer(matrix[below, column] / matrix[row, column], matrix[row, right])
        left |= np.outer(below, right)
        left[row] = left[:, column] = False
    return order


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20))
def test_pivots_are_those_of_the_definition(seed, n):
    random = np.random.default_rng(seed)
    matrix = np.where(random.random((n, n)) < 0.25, random.choice([-1.0, 0.5, 1.0, 1.5], (n, n)), 0.0)
    matrix[np.arange(n), random.permutation(n)] = 1.0
    assume(np.abs(np.linalg.det(matrix)) > 1e-3)
    entries = Entries.at(np.argwhere(matrix), n, n)
    scaled = np.zeros((n, n))
    scaled[matrix != 0.0] = equilibrated(entries, matrix[None, matrix != 0.0])[0]
    tape = eliminate(entries, matrix[None, matrix != 0.0], np.ones(n, bool), np.ones(n, bool))
    assert [tuple(pivot) for pivot in tape.pivots[:, :2]] == markowitz(scaled)


def test_a_chain_of_ten_thousand_unknowns_has_as_many_operations_as_a_short_one_for_each_unknown():
    def operations(n):
        k = np.arange(n)
        entries = Entries.at(np.column_stack([np.r_[k, k[1:], k[:-1]], np.r_[k, k[:-1], k[1:]]]), n, n)
        values = np.where(entries.places[:, 0] == entries.places[:, 1], 2.5, -1.0)[None]
        return len(eliminate(entries, values, np.ones(n, bool), np.ones(n, bool)).update)

    assert operations(10_000) <= 10_000 / 100 * (operations(100) + 1)
