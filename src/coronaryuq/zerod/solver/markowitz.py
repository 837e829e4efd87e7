"""Compiled elimination of a sparse matrix by Markowitz with threshold pivoting, entry by entry.

Entries are numbered as they appear, original ones first, then fill-in. Those of a row, and those of a column, are
linked in lists, and a knock-out tournament among the rows finds the next pivot: nothing has n² elements.
"""

from typing import NamedTuple

import numpy as np

from coronaryuq.core.jit import njit, njit_inner

THRESHOLD = 1e-3
"""Least size of a pivot against the largest entry of its scaled row, in every scenario (threshold pivoting)."""


class _Matrix(NamedTuple):
    """Entries of a matrix with n rows and `width` columns."""

    place: np.ndarray  # (room, 2): row and column of each entry
    following: np.ndarray  # (room, 2): next entry of the row, next entry of the column
    value: np.ndarray  # (room, scenarios)
    worth: np.ndarray  # (room,): size over the largest of the row, the least over all scenarios
    first: np.ndarray  # (2, width): first entry of each row and of each column
    filled: np.ndarray  # (2, width): number of entries of each row and column among those that are left
    done: np.ndarray  # (2, width): rows and columns that are eliminated


class _Search(NamedTuple):
    """Best pivot of each row, and the tournament among the rows; -1 where there is none."""

    allowed: np.ndarray  # (2, width): rows and columns that may have pivots
    best: np.ndarray  # (n,): entry
    cost: np.ndarray  # (n,): its bound on fill-in
    winner: np.ndarray  # (2 leaves,): row; that of node k is the better one of those of nodes 2k and 2k + 1


@njit(cache=True, nogil=True)
def eliminate(places, values, n, width, inner):
    """Choose pivots and list the operations of the elimination.

    places: (entries, 2) row and column. values: (entries, scenarios); columns from n on are carried along, and their
    values do not count. inner: (2, width) rows and columns that may have pivots of the interior.

    Returns the place of every entry (slots, 2); pivots (steps, 3): row, column, entry; how many are of the interior;
    the number of entries after these; `divide`, `update` and `forward` of a tape; entries to the right of the pivots;
    and where the operations of each pivot begin in `divide` and in `update`, and those entries, (3, steps + 1). There
    are fewer steps than n if no admissible pivot is left.
    """
    m, count = _linked(places, values, n, width)
    search = _searched(m, inner.copy(), n)
    interior, inside, inner_slots = 0, True, count
    pivots, firsts = np.empty((n, 3), np.int64), np.zeros((3, n + 1), np.int64)
    divide, update, forward, right_of = [(0, 0)], [(0, 0, 0)], [(0, 0, 0)], [0]
    entry_at, step_of = np.full(width, -1, np.int64), np.full(n, -1, np.int64)
    steps = 0
    while steps < n:
        if inside and search.winner[1] < 0:
            inside = False
            search = _searched(m, np.ones_like(inner), n)
        row = search.winner[1]
        if row < 0:
            break
        pivot = search.best[row]
        column = m.place[pivot, 1]
        pivots[steps, 0], pivots[steps, 1], pivots[steps, 2] = row, column, pivot
        m.done[0, row] = m.done[1, column] = True
        _rate(m, search, row)
        # Carried columns take part in the interior's elimination only.
        right = _left_in(m, 0, row, width if inside else n)
        below = _left_in(m, 1, column, n)
        m = _with_room(m, count + len(right) * len(below))
        for entry in right:
            right_of.append(entry)
            m.filled[1, m.place[entry, 1]] -= 1
        for factor in below:
            i = m.place[factor, 0]
            m.filled[0, i] -= 1
            step_of[i] = steps
            divide.append((factor, pivot))
            forward.append((i, factor, row))
            own = _left_in(m, 0, i, width)
            for entry in own:
                entry_at[m.place[entry, 1]] = entry
            for entry in right:
                j = m.place[entry, 1]
                target = entry_at[j]
                if target < 0:
                    target = count
                    _link(m, target, i, j, n)
                    count += 1
                update.append((target, factor, entry))
                for k in range(m.value.shape[1]):
                    m.value[target, k] -= m.value[factor, k] / m.value[pivot, k] * m.value[entry, k]
            for entry in own:
                entry_at[m.place[entry, 1]] = -1
            _judge(m, i, n)
        for factor in below:
            _rate(m, search, m.place[factor, 0])
        # Fill-in of other rows depends on the columns in which entries came or went.
        for entry in right:
            if m.place[entry, 1] < n:
                for other in _left_in(m, 1, m.place[entry, 1], n):
                    i = m.place[other, 0]
                    if step_of[i] < steps:
                        step_of[i] = steps
                        _rate(m, search, i)
        steps += 1
        if inside:
            interior, inner_slots = steps, count
        firsts[0, steps], firsts[1, steps], firsts[2, steps] = len(divide) - 1, len(update) - 1, len(right_of) - 1
    return (
        m.place[:count].copy(), pivots[:steps].copy(), interior, inner_slots, np.array(divide)[1:],
        np.array(update)[1:], np.array(forward)[1:], np.array(right_of)[1:], firsts[:, : steps + 1].copy(),
    )  # fmt: skip


@njit_inner(cache=True)
def _linked(places, values, n, width):
    """Return the matrix of some entries, and their number."""
    count = len(places)
    m = _Matrix(
        np.full((count, 2), -1, np.int64), np.full((count, 2), -1, np.int64), values.copy(), np.zeros(count),
        np.full((2, width), -1, np.int64), np.zeros((2, width), np.int64), np.zeros((2, width), np.bool_),
    )  # fmt: skip
    for entry in range(count):
        _link(m, entry, places[entry, 0], places[entry, 1], n)
    for i in range(n):
        _judge(m, i, n)
    return m, count


@njit_inner(cache=True)
def _with_room(m, size):
    """Return the matrix with room for a number of entries."""
    room = len(m.worth)
    if size <= room:
        return m
    room = max(size, 2 * room)
    place, following = np.full((room, 2), -1, np.int64), np.full((room, 2), -1, np.int64)
    value, worth = np.zeros((room, m.value.shape[1])), np.zeros(room)
    place[: len(m.worth)], following[: len(m.worth)] = m.place, m.following
    value[: len(m.worth)], worth[: len(m.worth)] = m.value, m.worth
    return _Matrix(place, following, value, worth, m.first, m.filled, m.done)


@njit_inner(cache=True)
def _link(m, entry, row, column, n):
    """Enter an entry in the lists of its row and column; carried columns count for no fill-in."""
    for axis, line in enumerate((row, column)):
        m.place[entry, axis] = line
        m.following[entry, axis] = m.first[axis, line]
        m.first[axis, line] = entry
        m.filled[axis, line] += column < n


@njit_inner(cache=True)
def _left_in(m, axis, line, end):
    """Return the entries of a row (axis 0) or column (1) in columns or rows below `end` that are left, in order.

    Those in columns or rows that are done are taken from the list.
    """
    size, before, entry = 0, -1, m.first[axis, line]
    while entry >= 0:
        following = m.following[entry, axis]
        if m.done[1 - axis, m.place[entry, 1 - axis]]:
            if before < 0:
                m.first[axis, line] = following
            else:
                m.following[before, axis] = following
        else:
            size += m.place[entry, 1 - axis] < end
            before = entry
        entry = following
    found, across = np.empty(size, np.int64), np.empty(size, np.int64)
    entry = m.first[axis, line]
    while entry >= 0:
        if m.place[entry, 1 - axis] < end:
            size -= 1
            found[size], across[size] = entry, m.place[entry, 1 - axis]
        entry = m.following[entry, axis]
    return found[np.argsort(across)]


@njit_inner(cache=True)
def _judge(m, row, n):
    """Rate the entries of a row as pivots: size over the largest of the row, the least over all scenarios."""
    entries = _left_in(m, 0, row, n)
    for entry in entries:
        m.worth[entry] = np.inf
    for k in range(m.value.shape[1]):
        largest = 0.0
        for entry in entries:
            largest = max(largest, abs(m.value[entry, k]))
        for entry in entries:
            share = abs(m.value[entry, k]) / largest if largest > 0.0 else 0.0
            m.worth[entry] = min(m.worth[entry], share)


@njit_inner(cache=True)
def _searched(m, allowed, n):
    """Return the search among all rows that are left."""
    leaves = 1
    while leaves < n:
        leaves *= 2
    search = _Search(allowed, np.full(n, -1, np.int64), np.zeros(n, np.int64), np.full(2 * leaves, -1, np.int64))
    for i in range(n):
        _rate(m, search, i)
    return search


@njit_inner(cache=True)
def _rate(m, search, row):
    """Find the admissible entry of a row with the least fill-in, ties by worth, then by place; enter it."""
    search.best[row] = -1
    if search.allowed[0, row] and not m.done[0, row]:
        entry = m.first[0, row]
        while entry >= 0:
            column = m.place[entry, 1]
            if m.worth[entry] > THRESHOLD and search.allowed[1, column] and not m.done[1, column]:
                cost = (m.filled[0, row] - 1) * (m.filled[1, column] - 1)
                best = search.best[row]
                if best < 0 or _precedes(cost, entry, search.cost[row], best, m):
                    search.best[row], search.cost[row] = entry, cost
            entry = m.following[entry, 0]
    node = len(search.winner) // 2 + row
    search.winner[node] = row if search.best[row] >= 0 else -1
    node //= 2
    while node >= 1:
        one, other = search.winner[2 * node], search.winner[2 * node + 1]
        better = one
        if one < 0 or (
            other >= 0 and _precedes(search.cost[other], search.best[other], search.cost[one], search.best[one], m)
        ):
            better = other
        search.winner[node] = better
        node //= 2


@njit_inner(cache=True)
def _precedes(cost, entry, other_cost, other, m):
    if cost != other_cost:
        return cost < other_cost
    if m.worth[entry] != m.worth[other]:
        return m.worth[entry] > m.worth[other]
    if m.place[entry, 0] != m.place[other, 0]:
        return m.place[entry, 0] < m.place[other, 0]
    return m.place[entry, 1] < m.place[other, 1]
