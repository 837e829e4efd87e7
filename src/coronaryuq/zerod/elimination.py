"""Elimination order of a sparse system, found once and written out as flat lists of operations (a tape).

Unknowns are split in two. The interior has equations and unknowns whose coefficients never change in time; it is
eliminated first and once per sample, leaving its Schur complement on the border, where heart, valves, stenoses and
whatever else changes live. Only the border is factorised and solved again in each Newton iteration.
"""

from dataclasses import dataclass

import numpy as np

THRESHOLD = 1e-3
"""Least size of a pivot against the largest entry of its scaled row, in every scenario (threshold pivoting)."""


@dataclass(frozen=True)
class Tape:
    """Slots hold the matrix entries, original ones first, then fill-in; row numbers and columns are the system's own.

    slot_row, slot_column: (slots,) where each slot sits.
    divide: (·, 2) slots: entry, pivot. update: (·, 3) slots: target −= factor × entry.
    Both are in order; `divide_first[k]` and `update_first[k]` say where pivot k's operations start.
    forward: (·, 3): row, slot, pivot row: b[row] −= a[slot] b[pivot row].
    backward: (·, 3): pivot row, slot, column: b[pivot row] −= a[slot] x[column].
    pivots: (n, 3): row, column, slot, in order of elimination. interior: how many of them are interior.
    inner_slots: how many slots there are once the interior is eliminated; later ones are the border's own fill-in.
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
        """For each pivot's row, the (slot, pivot row) that pivots `first` to `last` subtract from its right side."""
        position = {int(row): p for p, row in enumerate(self.pivots[:, 0])}
        found = [[] for _ in self.pivots]
        for row, slot, pivot_row in self.forward[self.forward_first[first] : self.forward_first[last]]:
            found[position[int(row)]].append((int(slot), int(pivot_row)))
        return found

    def backward_of(self, p: int) -> list[tuple[int, int]]:
        """(slot, column) of pivot p's row to the right of its pivot."""
        part = self.backward[self.backward_first[p] : self.backward_first[p + 1]]
        return [(int(slot), int(column)) for _, slot, column in part]


class Singular(ValueError):
    """No admissible pivot is left; `row` is the equation that cannot be solved for."""

    def __init__(self, row: int):
        self.row = row
        super().__init__(f"no pivot for equation {row}")


def eliminate(scenarios: np.ndarray, pattern: np.ndarray, inner_rows: np.ndarray, inner_columns: np.ndarray) -> Tape:
    """Order by Markowitz with threshold pivoting, interior before border.

    scenarios: (k, n, n + m) matrices that the order must suit, all of them. pattern: (n, n + m) where entries may be
    nonzero. The last m columns are carried through the interior's elimination and left alone by the border's.
    inner_rows, inner_columns: (n,) which equations and unknowns may belong to the interior. Raises `Singular`.
    """
    n, width = pattern.shape
    matrix, pattern = _equilibrated(scenarios), pattern.copy()
    slots: dict[tuple[int, int], int] = {}
    for row, column in zip(*np.nonzero(pattern), strict=True):
        slots[int(row), int(column)] = len(slots)
    carried = np.arange(n, width)
    candidates = _Candidates(matrix[:, :, :n], pattern[:, :n])
    inner = np.outer(inner_rows, inner_columns)
    pivots, divide, update, forward = [], [], [], []
    firsts = {"divide": [0], "update": [0], "forward": [0]}
    interior, inner_slots = 0, 0
    for step in range(n):
        found = candidates.best(inner) if interior == step else None
        if found is not None:
            interior += 1
        else:
            inner_slots = inner_slots or len(slots)
            found = candidates.best()
        if found is None:
            raise Singular(int(np.nonzero(candidates.rows)[0][0]))
        row, column = found
        pivot = slots[row, column]
        pivots.append((row, column, pivot))
        below, right = candidates.take(row, column)
        if step < interior:
            right = np.append(right, carried[pattern[row, carried]])
        for i in map(int, below):
            divide.append((slots[i, column], pivot))
            forward.append((i, slots[i, column], row))
            for j in map(int, right):
                target = slots.setdefault((i, j), len(slots))
                update.append((target, slots[i, column], slots[row, j]))
        pattern[np.ix_(below, right)] = True
        factors = matrix[:, below, column] / matrix[:, row, column][:, None]
        matrix[np.ix_(range(len(matrix)), below, right)] -= factors[:, :, None] * matrix[:, row, right][:, None, :]
        candidates.refresh(below, right[right < n])
        for name, operations in (("divide", divide), ("update", update), ("forward", forward)):
            firsts[name].append(len(operations))
    order = {column: step for step, (_, column, _) in enumerate(pivots)}
    of_row: dict[int, list[tuple[int, int]]] = {}
    for (row, column), slot in slots.items():
        of_row.setdefault(row, []).append((column, slot))
    backward, backward_first = [], [0]
    for step, (row, _, _) in enumerate(pivots):
        # Carried columns count as eliminated last, and only by the interior.
        last = n if step < interior else -1
        places = [(order.get(column, last), column, slot) for column, slot in of_row[row]]
        later = [place for place in places if place[0] > step]
        backward += [(row, slot, column) for _, column, slot in sorted(later, reverse=True)]
        backward_first.append(len(backward))
    where = np.array(list(slots), dtype=np.int64).reshape(-1, 2)
    return Tape(
        where[:, 0],
        where[:, 1],
        np.array(pivots, dtype=np.int64),
        interior,
        inner_slots or len(slots),
        _table(divide, 2),
        np.array(firsts["divide"]),
        _table(update, 3),
        np.array(firsts["update"]),
        _table(forward, 3),
        np.array(firsts["forward"]),
        _table(backward, 3),
        np.array(backward_first),
    )


class _Candidates:
    """Entries of the rows and columns that are left, and what each is worth as a pivot.

    worth: (n, n) least size over the largest entry of its row, over all scenarios; nought where there is no entry.
    """

    def __init__(self, matrix: np.ndarray, pattern: np.ndarray):
        self._matrix, self._left = matrix, pattern.copy()
        self._worth = np.zeros(pattern.shape)
        self._in_row, self._in_column = self._left.sum(axis=1), self._left.sum(axis=0)
        self.rows = np.ones(len(pattern), bool)
        self.refresh(np.arange(len(pattern)), np.empty(0, dtype=np.int64))

    def refresh(self, rows: np.ndarray, filled: np.ndarray) -> None:
        """Judge `rows` anew; their entries in columns `filled` exist from now on."""
        self._left[np.ix_(rows, filled)] = True
        self._in_row[rows], self._in_column[filled] = self._left[rows].sum(axis=1), self._left[:, filled].sum(axis=0)
        size = np.where(self._left[rows], np.abs(self._matrix[:, rows]), 0.0)
        largest = size.max(axis=2, keepdims=True)
        self._worth[rows] = np.where(largest > 0, size / np.where(largest > 0, largest, 1.0), 0.0).min(axis=0)

    def best(self, among: np.ndarray | None = None) -> tuple[int, int] | None:
        """The admissible entry (of `among`, (n, n)) that creates the least fill-in, ties by worth, then by place."""
        admissible = self._worth > THRESHOLD
        if among is not None:
            admissible &= among
        # Flat: several times as fast as places in two dimensions, and this is most of what a new network costs.
        rows, columns = np.divmod(np.flatnonzero(admissible), admissible.shape[1])
        if not len(rows):
            return None
        cost = (self._in_row[rows] - 1) * (self._in_column[columns] - 1)
        cheapest = np.flatnonzero(cost == cost.min())
        chosen = cheapest[np.argmax(self._worth[rows[cheapest], columns[cheapest]])]
        return int(rows[chosen]), int(columns[chosen])

    def take(self, row: int, column: int) -> tuple[np.ndarray, np.ndarray]:
        """Remove a pivot's row and column; rows below it and columns right of it."""
        self._left[row, column] = False
        below, right = np.nonzero(self._left[:, column])[0], np.nonzero(self._left[row])[0]
        self._left[row] = self._left[:, column] = False
        self._in_row[below] -= 1
        self._in_column[right] -= 1
        self._worth[row] = self._worth[:, column] = 0.0
        self.rows[row] = False
        return below, right


def _equilibrated(scenarios: np.ndarray, sweeps: int = 5) -> np.ndarray:
    """Rows and columns scaled so that entries of different units can be compared."""
    matrix = scenarios.astype(float).copy()
    for _ in range(sweeps):
        for axis in (2, 1):
            largest = np.abs(matrix).max(axis=(0, axis), keepdims=True)
            matrix /= np.sqrt(np.where(largest > 0, largest, 1.0))
    return matrix


def _table(operations: list[tuple[int, ...]], columns: int) -> np.ndarray:
    return np.array(operations, dtype=np.int64).reshape(-1, columns)
