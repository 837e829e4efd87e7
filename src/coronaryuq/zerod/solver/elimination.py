"""Elimination order of a sparse system, determined once and written as flat lists of operations (a tape).

Unknowns are split in two. The interior has equations and unknowns whose coefficients never change in time; it is
eliminated first and once per sample, leaving its Schur complement on the border, where heart, valves, stenoses and
whatever else changes. Only the border is factorised and solved again in each Newton iteration.
"""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.jit import njit, njit_inner

THRESHOLD = 1e-3
"""Least size of a pivot against the largest entry of its scaled row, in every scenario (threshold pivoting)."""


@dataclass(frozen=True)
class Tape:
    """Slots are the matrix entries, original ones first, then fill-in; row numbers and columns are the system's own.

    slot_row, slot_column: (slots,) position of each slot.
    divide: (·, 2) slots: entry, pivot. update: (·, 3) slots: target −= factor × entry.
    Both are in order; pivot k's operations start at `divide_first[k]` and `update_first[k]`.
    forward: (·, 3): row, slot, pivot row: b[row] −= a[slot] b[pivot row].
    backward: (·, 3): pivot row, slot, column: b[pivot row] −= a[slot] x[column].
    pivots: (n, 3): row, column, slot, in order of elimination. interior: number of interior ones.
    inner_slots: number of slots once the interior is eliminated; later ones are fill-in of the border.
    """

    slot_row: np.ndarray
    slot_column: np.ndarray
    pivots: np.ndarray
    interior: int
    inner_slots: int
    divide: np.ndarray
    divide_first: np.ndarray
    update: np.ndarray
    update_first: np.ndarray
    forward: np.ndarray
    forward_first: np.ndarray
    backward: np.ndarray
    backward_first: np.ndarray

    def forward_of(self, first: int, last: int) -> list[list[tuple[int, int]]]:
        """List for each row the (slot, pivot row) that pivots `first` to `last` subtract from its right side."""
        position = {int(row): p for p, row in enumerate(self.pivots[:, 0])}
        operations: list[list[tuple[int, int]]] = [[] for _ in self.pivots]
        for row, slot, pivot_row in self.forward[self.forward_first[first] : self.forward_first[last]]:
            operations[position[int(row)]].append((int(slot), int(pivot_row)))
        return operations

    def backward_of(self, p: int) -> list[tuple[int, int]]:
        """List the (slot, column) of pivot p's row to the right of its pivot."""
        part = self.backward[self.backward_first[p] : self.backward_first[p + 1]]
        return [(int(slot), int(column)) for _, slot, column in part]


class Singular(ValueError):
    """No admissible pivot is left; `row` is the equation that cannot be solved for."""

    def __init__(self, row: int):
        self.row = row
        super().__init__(f"no pivot for equation {row}")


def eliminate(scenarios: np.ndarray, pattern: np.ndarray, inner_rows: np.ndarray, inner_columns: np.ndarray) -> Tape:
    """Order by Markowitz with threshold pivoting, interior before border.

    scenarios: (k, n, n + m) matrices for all of which the order must be stable. pattern: (n, n + m) possible
    nonzero entries. The last m columns take part in the interior's elimination, but not in the border's. inner_rows,
    inner_columns: (n,) equations and unknowns that may belong to the interior. Raises `Singular`.
    """
    n = len(pattern)
    matrix = np.ascontiguousarray(_equilibrated(scenarios, pattern)[:, :, :n])
    places, interior = _order(matrix, pattern[:, :n].copy(), np.outer(inner_rows, inner_columns))
    if len(places) < n:
        raise Singular(int(np.setdiff1d(np.arange(n), places[:, 0])[0]))
    slot = np.full(pattern.shape, -1)
    slot[pattern] = np.arange(np.count_nonzero(pattern))
    inner_slots, divide, update, forward, firsts = _operations(places, interior, slot)
    backward, backward_first = _backward(places, interior, slot)
    where = np.argwhere(slot >= 0)
    where = where[np.argsort(slot[where[:, 0], where[:, 1]])]
    return Tape(
        where[:, 0].copy(),
        where[:, 1].copy(),
        np.column_stack([places, slot[places[:, 0], places[:, 1]]]),
        interior,
        inner_slots,
        divide,
        firsts[0],
        update,
        firsts[1],
        forward,
        firsts[0],
        backward,
        backward_first,
    )


@njit(cache=True, nogil=True)
def _order(matrix, left, inner):
    """Choose pivots (row, column) in order, (n, 2), and count the interior ones; stop when none is admissible.

    matrix: (k, n, n), left: (n, n) entries of the rows and columns that are left, both changed in place. inner: (n, n)
    entries that may be interior pivots.
    """
    n = len(left)
    in_row, in_column = np.zeros(n, np.int64), np.zeros(n, np.int64)
    worth = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            if left[i, j]:
                in_row[i] += 1
                in_column[j] += 1
        _judge(matrix, left, i, worth)
    places, rows, columns = np.empty((n, 2), np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    interior, inside, allowed = 0, True, inner
    for step in range(n):
        row, column = _best(worth, in_row, in_column, allowed)
        if inside and row < 0:
            inside, allowed = False, np.ones_like(inner)
            row, column = _best(worth, in_row, in_column, allowed)
        if row < 0:
            return places[:step], interior
        interior += inside
        places[step, 0], places[step, 1] = row, column
        left[row, column] = False
        below, right = 0, 0
        for i in range(n):
            worth[row, i] = worth[i, column] = 0.0
            if left[row, i]:
                columns[right] = i
                right += 1
                in_column[i] -= 1
            if left[i, column]:
                rows[below] = i
                below += 1
                in_row[i] -= 1
            left[row, i] = left[i, column] = False
        for i in rows[:below]:
            for k in range(len(matrix)):
                factor = matrix[k, i, column] / matrix[k, row, column]
                for j in columns[:right]:
                    matrix[k, i, j] -= factor * matrix[k, row, j]
            for j in columns[:right]:
                if not left[i, j]:
                    left[i, j] = True
                    in_row[i] += 1
                    in_column[j] += 1
            _judge(matrix, left, i, worth)
    return places, interior


@njit_inner(cache=True)
def _judge(matrix, left, row, worth):
    """Rate a row's entries as pivots: size over the largest of the row, the least over all scenarios."""
    n = len(left)
    for j in range(n):
        worth[row, j] = np.inf if left[row, j] else 0.0
    for k in range(len(matrix)):
        largest = 0.0
        for j in range(n):
            if left[row, j]:
                largest = max(largest, abs(matrix[k, row, j]))
        for j in range(n):
            if left[row, j]:
                worth[row, j] = min(worth[row, j], abs(matrix[k, row, j]) / largest if largest > 0.0 else 0.0)


@njit_inner(cache=True)
def _best(worth, in_row, in_column, allowed):
    """Find the admissible entry of those allowed with the least fill-in; ties by worth, then by place."""
    row, column, least = -1, -1, 0
    for i in range(len(worth)):
        for j in range(len(worth)):
            if worth[i, j] > THRESHOLD and allowed[i, j]:
                cost = (in_row[i] - 1) * (in_column[j] - 1)
                if row < 0 or cost < least or (cost == least and worth[i, j] > worth[row, column]):
                    row, column, least = i, j, cost
    return row, column


@njit(cache=True, nogil=True)
def _operations(places, interior, slot):
    """List the operations of a tape, pivot by pivot, and enter the fill-in into `slot` (n, n + m), -1 where empty.

    Returns the number of slots once the interior is eliminated, `divide`, `update`, `forward`, and where each pivot's
    operations start in `divide` and in `update`, (2, n + 1).
    """
    n, width = slot.shape
    count = slot.max() + 1
    inner_slots = count
    done_row, done_column = np.zeros(n, np.bool_), np.zeros(width, np.bool_)
    firsts = np.zeros((2, n + 1), np.int64)
    divide, update, forward = [(0, 0)], [(0, 0, 0)], [(0, 0, 0)]
    for step in range(n):
        row, column = places[step]
        done_row[row], done_column[column] = True, True
        # Carried columns take part in the interior's elimination only.
        last = width if step < interior else n
        for i in range(n):
            if done_row[i] or slot[i, column] < 0:
                continue
            divide.append((slot[i, column], slot[row, column]))
            forward.append((i, slot[i, column], row))
            for j in range(last):
                if done_column[j] or slot[row, j] < 0:
                    continue
                if slot[i, j] < 0:
                    slot[i, j] = count
                    count += 1
                update.append((slot[i, j], slot[i, column], slot[row, j]))
        firsts[0, step + 1], firsts[1, step + 1] = len(divide) - 1, len(update) - 1
        if step < interior:
            inner_slots = count
    return inner_slots, np.array(divide)[1:], np.array(update)[1:], np.array(forward)[1:], firsts


@njit(cache=True, nogil=True)
def _backward(places, interior, slot):
    """List `backward` of a tape, pivot by pivot, last unknown first, and where each pivot's part starts, (n + 1,)."""
    n, width = slot.shape
    operations, first = [(0, 0, 0)], np.zeros(n + 1, np.int64)
    for step in range(n):
        row = places[step, 0]
        # Carried columns count as eliminated last, and only by the interior.
        if step < interior:
            for column in range(width - 1, n - 1, -1):
                if slot[row, column] >= 0:
                    operations.append((row, slot[row, column], column))
        for later in range(n - 1, step, -1):
            column = places[later, 1]
            if slot[row, column] >= 0:
                operations.append((row, slot[row, column], column))
        first[step + 1] = len(operations) - 1
    return np.array(operations)[1:], first


def _equilibrated(scenarios: np.ndarray, pattern: np.ndarray, sweeps: int = 5) -> np.ndarray:
    """Scale rows and columns so that entries of different units can be compared; zero outside `pattern`."""
    rows, columns = np.nonzero(pattern)
    entries = scenarios[:, rows, columns].astype(float)
    for _ in range(sweeps):
        for lines in (rows, columns):
            largest = np.zeros(max(pattern.shape))
            np.maximum.at(largest, lines, np.abs(entries).max(axis=0))
            entries /= np.sqrt(np.where(largest > 0, largest, 1.0))[lines]
    matrix = np.zeros(scenarios.shape)
    matrix[:, rows, columns] = entries
    return matrix
