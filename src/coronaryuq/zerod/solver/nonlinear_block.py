"""The border of a network's equations: the solution-dependent terms, as tables for Crout's factorisation."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.zerod.solver.elimination import Tape

SLOPED = (
    *(("f_valve", 3), ("square", 2), ("square_rate", 2), ("exponentials", 3)),
    *(("f_gate", 3), ("gate_slope", 4)),
)
"""Kinds of terms whose derivatives change from iteration to iteration, and how many numbers give the place of each."""


class Border:
    """The border's part of a tape; `rows` returns the places of a kind of term.

    Its matrix of one step is one table of rows: the entries at the start of a step, one row of zeros, the `sloped`
    entries to which derivatives are added, and the entries of the factors; `size` rows in all.
    """

    def __init__(self, tape: Tape, rows):
        self._position = {int(row): p - tape.interior for p, row in enumerate(tape.pivots[:, 0])}
        self._tape = tape
        m, n = tape.interior, len(tape.pivots)
        columns = {int(column) for column in tape.pivots[m:, 1]}
        places = [(int(r), int(c)) for r, c in zip(tape.slot_row, tape.slot_column, strict=True)]
        inner = [
            slot
            for slot in range(tape.inner_slots)
            if self._position[places[slot][0]] >= 0 and places[slot][1] in columns
        ]
        self.slots = np.array(inner, dtype=np.int64)
        self._entry = {places[slot]: k for k, slot in enumerate(inner)}
        zero_row = len(inner)
        dependent = [tuple(map(int, place)) for kind, width in SLOPED for place in rows(kind, width)[:, :2]]
        if len(set(dependent)) < len(dependent):
            raise ValueError("two solution-dependent terms share an entry of the Jacobian")
        self.sloped = {place: zero_row + 1 + k for k, place in enumerate(dependent)}
        updates: dict[int, list[tuple[int, int]]] = {}
        for target, factor, entry in tape.update[tape.update_first[m] : tape.update_first[n]]:
            updates.setdefault(int(target), []).append((int(factor), int(entry)))
        first_free = zero_row + 1 + len(dependent)
        computed: dict[int, int] = {}

        def source(slot: int) -> int:
            place = places[slot]
            return self.sloped[place] if place in self.sloped else self._entry.get(place, zero_row)

        def place_of(slot: int) -> int:
            return computed[slot] if slot in computed else source(slot)

        factor, pairs, factor_first = [], [], []
        for p in range(m, n):
            upper = [slot for slot, _ in tape.backward_of(p)]
            lower = [int(slot) for slot, _ in tape.divide[tape.divide_first[p] : tape.divide_first[p + 1]]]
            upper = [slot for slot in upper if slot in updates]
            factor_first.append((len(factor), len(factor) + 1 + len(upper)))
            for slot in (int(tape.pivots[p, 2]), *upper, *lower):
                pairs.append([(place_of(left), place_of(right)) for left, right in updates.get(slot, [])])
                destination = first_free + len(computed)
                if slot != tape.pivots[p, 2]:
                    computed[slot] = destination
                factor.append((source(slot), destination))
        factor_first.append((len(factor), len(factor)))
        self.factor_first = np.array(factor_first, dtype=np.int64)
        self.factor = np.array(factor, dtype=np.int64).reshape(-1, 2)
        self.pairs, self.pairs_first = flatten(pairs, 2)
        self.size = first_free + len(computed)
        pivot = {int(row): p for p, row in enumerate(tape.pivots[m:, 0])}
        self.forward, self.forward_first = flatten(
            [[(place_of(slot), pivot[row]) for slot, row in operations] for operations in tape.forward_of(m, n)[m:]], 2
        )
        self.backward, self.backward_first = flatten(
            [[(place_of(slot), column) for slot, column in tape.backward_of(p)] for p in range(n - 1, m - 1, -1)], 2
        )
        self.product, self.product_first = self._product(rows, places, n - m)

    def entry(self, row: int, column: int) -> int:
        """Return the number of a border entry."""
        return self._entry[int(row), int(column)]

    def _product(self, rows, places, size: int) -> tuple[np.ndarray, np.ndarray]:
        """List, row by row, the entries that are nonzero before the solution-dependent terms are added."""
        tape = self._tape
        filled = {
            tuple(map(int, place))
            for kind, width in (("e", 2), ("f", 2), ("e_time", 3), ("f_time", 3))
            for place in rows(kind, width)[:, :2]
        }
        filled |= {places[int(slot)] for slot in tape.update[: tape.update_first[tape.interior], 0]}
        by_row: list[list[tuple[int, int]]] = [[] for _ in range(size)]
        for (row, column), entry in self._entry.items():
            if (row, column) in filled:
                by_row[self._position[row]].append((entry, column))
        return flatten(by_row, 2)


def flatten(lists: Sequence[Sequence[tuple[int, ...]]], columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Concatenate lists of tuples into one table; also return where each list begins (one more than lists)."""
    flat = np.array([item for part in lists for item in part], dtype=np.int64).reshape(-1, columns)
    return flat, np.concatenate([[0], np.cumsum([len(part) for part in lists], dtype=np.int64)]).astype(np.int64)
