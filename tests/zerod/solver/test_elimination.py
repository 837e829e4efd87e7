"""The operations of a tape solve any sparse system."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from coronaryuq.zerod.solver.elimination import Singular, Tape, eliminate


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
    try:
        tape = eliminate(scenarios, pattern, *inner)
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
        eliminate(matrix[None], matrix != 0.0, np.ones(3, bool), np.ones(3, bool))
    assert error.value.row == 1
