"""Elimination order of a sparse system, determined once and written as flat lists of operations (a tape).

Unknowns are split in two. The interior has equations and unknowns whose coefficients never change in time; it is
eliminated first and once per sample, leaving its Schur complement on the border, where heart, valves, stenoses and
whatever else changes. Only the border is factorised and solved again in each Newton iteration.
"""

from dataclasses import dataclass

import numpy as np

from coronaryuq.zerod.solver import markowitz


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


@dataclass(frozen=True)
class Entries:
    """Places of the entries of a sparse matrix, row by row.

    keys: (entries,) row times width plus column, rising. size: number of rows, n. width: number of columns, n + m.
    """

    keys: np.ndarray
    size: int
    width: int

    @classmethod
    def at(cls, places: np.ndarray, size: int, width: int) -> "Entries":
        """Return the entries at some places (·, 2), row and column, which may be repeated."""
        return cls(np.unique(places[:, 0] * width + places[:, 1]), size, width)

    @property
    def places(self) -> np.ndarray:
        """Row and column of each entry, (entries, 2)."""
        return np.stack([self.keys // self.width, self.keys % self.width], axis=1)

    def find(self, places: np.ndarray) -> np.ndarray:
        """Return the numbers of the entries at some places (·, 2), all of which exist."""
        return np.searchsorted(self.keys, places[:, 0] * self.width + places[:, 1])


def eliminate(entries: Entries, scenarios: np.ndarray, inner_rows: np.ndarray, inner_columns: np.ndarray) -> Tape:
    """Order by Markowitz with threshold pivoting, interior before border.

    Time and memory grow with the number of entries and of operations.

    entries: possible nonzeros; the columns from n on take part in the interior's elimination, but not in the border's.
    scenarios: (k, entries) values for all of which the order must be stable. inner_rows, inner_columns: (n,) equations
    and unknowns that may belong to the interior. Raises `Singular`.
    """
    n, width = entries.size, entries.width
    inner = np.zeros((2, width), bool)
    inner[0, :n], inner[1, :n] = inner_rows, inner_columns
    values = np.ascontiguousarray(equilibrated(entries, scenarios).T)
    places, pivots, interior, inner_slots, divide, update, forward, right, firsts = markowitz.eliminate(
        entries.places, values, n, width, inner
    )
    if len(pivots) < n:
        raise Singular(int(np.setdiff1d(np.arange(n), pivots[:, 0])[0]))
    # Entries to the right of each pivot, last unknown first; carried columns count as eliminated last.
    position = np.arange(width)
    position[pivots[:, 1]] = np.arange(n)
    step = np.repeat(np.arange(n), np.diff(firsts[2]))
    right = right[np.lexsort([-position[places[right, 1]], step])]
    backward = np.column_stack([pivots[step, 0], right, places[right, 1]])
    return Tape(
        slot_row=places[:, 0].copy(),
        slot_column=places[:, 1].copy(),
        pivots=pivots,
        interior=interior,
        inner_slots=inner_slots,
        divide=divide,
        divide_first=firsts[0],
        update=update,
        update_first=firsts[1],
        forward=forward,
        forward_first=firsts[0],
        backward=backward,
        backward_first=firsts[2],
    )


def equilibrated(entries: Entries, scenarios: np.ndarray, sweeps: int = 5) -> np.ndarray:
    """Scale rows and columns of scenarios (k, entries) so that entries of different units can be compared."""
    values = scenarios.astype(float)
    for _ in range(sweeps):
        for lines in entries.places.T:
            largest = np.zeros(entries.width)
            np.maximum.at(largest, lines, np.abs(values).max(axis=0))
            values /= np.sqrt(np.where(largest > 0, largest, 1.0))[lines]
    return values
