"""From the elements' terms to the kernels' tables: structure once per network, values once per group of samples."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.errors import InputError
from coronaryuq.zerod.assembly import Assembly, Context, Terms
from coronaryuq.zerod.elements import ELEMENTS
from coronaryuq.zerod.elimination import Singular, Tape, eliminate
from coronaryuq.zerod.kernels import Scheme, Structure, Values, Work, condense
from coronaryuq.zerod.lanes import LANES, table
from coronaryuq.zerod.model import Model

_SCENARIOS = 8


def write_elements(model: Model, at: Context) -> Assembly:
    """All elements' terms for the parameters in `at`."""
    system = Assembly()
    for block in model.blocks.values():
        ELEMENTS[block.kind](block, at, system)
    return system


@dataclass(frozen=True)
class Program:
    """Structure of one network, for parameters whose zeros are known.

    kept: for each kind of term, which of the elements' terms are not identically zero. order: of the linear terms
    (f, e, f_lagged) in the structure. slots: of the same in the matrix. border_rows: length of the border's table.
    """

    size: int
    structure: Structure
    kept: dict[str, np.ndarray]
    order: np.ndarray
    slots: np.ndarray
    tape: Tape
    border_rows: int


_KINDS = (
    "e",
    "f",
    "f_lagged",
    "constant",
    "e_time",
    "f_time",
    "constant_time",
    "f_valve",
    "square",
    "square_rate",
    "exponentials",
)


def _kept(terms: Terms) -> np.ndarray:
    return np.array([k for k, c in enumerate(terms.coefficients) if np.any(np.asarray(c[0]) != 0.0)], dtype=np.int64)


def make_program(model: Model, at: Context, scheme: Scheme, step: float, own: Context | None = None) -> Program:
    """Analyse the network as written for `at` (one sample, nonzero wherever a sample may be nonzero).

    step: time step (s) at which pivots are judged. own: the network's own values, by which they are judged where the
    network has a solution so: an entry that is nought in some samples must be no pivot. Raises `InputError` when the
    equations have no solution.
    """
    n, system = model.size, write_elements(model, at)
    kept = {kind: _kept(getattr(system, kind)) for kind in _KINDS}

    def rows(kind: str, columns: int) -> np.ndarray:
        terms = getattr(system, kind)
        return np.array([terms.where[k] for k in kept[kind]], dtype=np.int64).reshape(-1, columns)

    e, f, f_lagged = rows("e", 2), rows("f", 2), rows("f_lagged", 2)
    lagged = np.unique(f_lagged[:, 1])
    e_time, f_time = rows("e_time", 3), rows("f_time", 3)
    square, square_rate = rows("square", 2), rows("square_rate", 2)
    exponential, valve_term = rows("exponentials", 3), rows("f_valve", 3)
    changing = np.zeros((n, n), bool)
    for part in (e_time, f_time, square, square_rate, exponential, valve_term):
        changing[part[:, 0], part[:, 1]] = True
    pattern = np.concatenate([changing, np.zeros((n, len(lagged)), bool)], axis=1)
    for part in (e, f, np.stack([f_lagged[:, 0], n + np.searchsorted(lagged, f_lagged[:, 1])], axis=1)):
        pattern[part[:, 0], part[:, 1]] = True
    inner_columns = ~changing.any(axis=0)
    inner_columns[lagged] = False
    # The unknowns that decide a valve's state must be known inside Newton's loop.
    inner_columns[[column for valve in system.valves for column in valve]] = False

    def tape_of(judged: Assembly) -> Tape:
        scenarios = _scenarios(n, lagged, judged, kept, scheme, step)
        return eliminate(scenarios, pattern, ~changing.any(axis=1), inner_columns)

    try:
        try:
            tape = tape_of(system if own is None else write_elements(model, own))
        except Singular:
            tape = tape_of(system)
    except Singular as error:
        block = model.equations[error.row]
        raise InputError(model.file, block, None, "system is singular; check its connections and parameters") from None
    structure, order = _structure(n, tape, lagged, system, kept, rows)
    place = {(int(r), int(c)): k for k, (r, c) in enumerate(zip(tape.slot_row, tape.slot_column, strict=True))}
    late = np.stack([f_lagged[:, 0], n + np.searchsorted(lagged, f_lagged[:, 1])], axis=1)
    slots = np.array([place[int(r), int(c)] for r, c in np.concatenate([f, e, late])], dtype=np.int64)
    return Program(n, structure, kept, order, slots, tape, _Border(tape, rows).size)


def _scenarios(n: int, lagged: np.ndarray, system: Assembly, kept, scheme: Scheme, step: float) -> np.ndarray:
    """Jacobians at states that a run may meet: valves open and shut, activation high and low, flows small and large."""
    to_y = scheme.alpha_f * scheme.gamma * step
    matrices = np.zeros((_SCENARIOS, n, n + len(lagged)))
    random = np.random.Generator(np.random.Philox(key=22))
    for kind, weight in (("e", scheme.alpha_m), ("f", to_y)):
        terms = getattr(system, kind)
        for k in kept[kind]:
            row, column = terms.where[k]
            matrices[:, row, column] += weight * _first(terms.coefficients[k][0])
    for k in kept["f_lagged"]:
        row, column = system.f_lagged.where[k]
        matrices[:, row, n + np.searchsorted(lagged, column)] += to_y * _first(system.f_lagged.coefficients[k][0])
    for number, matrix in enumerate(matrices):
        for kind, weight in (("e_time", scheme.alpha_m), ("f_time", to_y)):
            terms = getattr(system, kind)
            for k in kept[kind]:
                row, column, shape = terms.where[k]
                values = system.shapes[shape][0]
                time = number * (values.size - 1) // max(_SCENARIOS - 1, 1)
                matrix[row, column] += weight * _first(terms.coefficients[k][0]) * values[time]
        for kind, scale in (("square", to_y), ("square_rate", scheme.alpha_m)):
            terms = getattr(system, kind)
            for k in kept[kind]:
                row, column = terms.where[k]
                flow = 0.0 if number == 0 else 10.0 ** random.uniform(-2, 2)
                matrix[row, column] += scale * _first(terms.coefficients[k][0]) * flow
        for k in kept["f_valve"]:
            row, column, valve = system.f_valve.where[k]
            if (number >> (valve % 3)) & 1 == 0:
                matrix[row, column] += to_y * _first(system.f_valve.coefficients[k][0])
    return matrices


def _first(value) -> float:
    return float(np.ravel(value)[0])


def _structure(n: int, tape: Tape, lagged: np.ndarray, system: Assembly, kept, rows) -> tuple[Structure, np.ndarray]:
    """Index tables for the kernels, and in which order the linear terms (f, e, f_lagged) stand in them."""
    border = _Border(tape, rows)
    position = np.empty(n, dtype=np.int64)
    position[tape.pivots[:, 0]] = np.arange(n)
    entries = np.concatenate([rows("f", 2), rows("e", 2) + np.array([0, n]), rows("f_lagged", 2)])
    order = np.argsort(position[entries[:, 0]], kind="stable")
    constant_time = rows("constant_time", 2)[_by_row(kept, system)]
    constant_rows, constant_first = np.unique(constant_time[:, 0], return_index=True)
    f_time, e_time = rows("f_time", 3), rows("e_time", 3)
    matrix_time = np.concatenate([f_time, e_time + np.array([0, n, 0])])
    time_entries = [border.entry(r, c) for r, c in np.concatenate([f_time, e_time])[:, :2]]
    matrix_time = np.column_stack([position[matrix_time[:, 0]] - tape.interior, matrix_time[:, 1:], time_entries])
    forward, forward_first = _lists(
        [[(slot, position[pivot_row]) for slot, pivot_row in found] for found in _forward_of(tape, 0, tape.interior)], 2
    )
    backward, backward_first = _lists([_backward_of(tape, p) for p in range(tape.interior - 1, -1, -1)], 2)
    lagged_border = [
        (slot, position[row] - tape.interior, column - n)
        for slot, (row, column) in enumerate(zip(tape.slot_row, tape.slot_column, strict=True))
        if column >= n and position[row] >= tape.interior
    ]

    def dependent(kind: str, columns: int) -> np.ndarray:
        part = rows(kind, columns)
        found = [
            (position[r] - tape.interior, c, border.entry(r, c), border.sloped[int(r), int(c)], *rest)
            for r, c, *rest in part
        ]
        return np.array(found, dtype=np.int64).reshape(-1, columns + 2)

    structure = Structure(
        pivots=tape.pivots[:, :2],
        terms_first=np.searchsorted(position[entries[order, 0]], np.arange(n + 1)),
        terms=entries[order, 1],
        constant_rows=constant_rows,
        constant_first=np.append(constant_first, len(constant_time)),
        constant_shape=constant_time[:, 1],
        matrix_time=matrix_time,
        forward_first=forward_first,
        forward=forward,
        backward_first=backward_first,
        backward=backward,
        border=border.slots,
        product_first=border.product_first,
        product=border.product,
        lagged=lagged,
        lagged_border=np.array(lagged_border, dtype=np.int64).reshape(-1, 3),
        square=dependent("square", 2),
        square_rate=dependent("square_rate", 2),
        exponential=dependent("exponentials", 3),
        valve=np.array(system.valves, dtype=np.int64).reshape(-1, 3),
        valve_term=dependent("f_valve", 3),
        factor_first=border.factor_first,
        factor=border.factor,
        pairs_first=border.pairs_first,
        pairs=border.pairs,
        border_forward_first=border.forward_first,
        border_forward=border.forward,
        border_backward_first=border.backward_first,
        border_backward=border.backward,
    )
    return Structure(*(np.ascontiguousarray(part, dtype=np.uint32) for part in structure)), order


def _by_row(kept: dict[str, np.ndarray], system: Assembly) -> np.ndarray:
    """Order in which the constants that change in time stand in the structure: those of one row side by side."""
    return np.argsort([system.constant_time.where[k][0] for k in kept["constant_time"]], kind="stable").astype(np.int64)


def _forward_of(tape: Tape, first: int, last: int) -> list[list[tuple[int, int]]]:
    """For each pivot's row, the (slot, pivot row) that pivots `first` to `last` subtract from its right-hand side."""
    position = {int(row): p for p, row in enumerate(tape.pivots[:, 0])}
    found = [[] for _ in tape.pivots]
    for row, slot, pivot_row in tape.forward[tape.forward_first[first] : tape.forward_first[last]]:
        found[position[int(row)]].append((int(slot), int(pivot_row)))
    return found


def _backward_of(tape: Tape, p: int) -> list[tuple[int, int]]:
    """(slot, column) of pivot p's row to the right of its pivot."""
    part = tape.backward[tape.backward_first[p] : tape.backward_first[p + 1]]
    return [(int(slot), int(column)) for _, slot, column in part]


def _lists(lists: list[list[tuple[int, ...]]], columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Lists of tuples as one table and the place where each list begins (one more than there are lists)."""
    flat = np.array([item for found in lists for item in found], dtype=np.int64).reshape(-1, columns)
    return flat, np.concatenate([[0], np.cumsum([len(found) for found in lists], dtype=np.int64)]).astype(np.int64)


class _Border:
    """The border's part of a tape, as tables for Crout's factorisation.

    Its matrix of one step is one table of rows: `size` entries as they stand at the start of a step, one row of
    noughts, the `sloped` entries that get derivatives added, and what the factorisation computes.
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
        nought = len(inner)
        dependent = [
            tuple(map(int, place))
            for kind, width in (("f_valve", 3), ("square", 2), ("square_rate", 2), ("exponentials", 3))
            for place in rows(kind, width)[:, :2]
        ]
        if len(set(dependent)) < len(dependent):
            raise ValueError("two solution-dependent terms share an entry of the Jacobian")
        self.sloped = {place: nought + 1 + k for k, place in enumerate(dependent)}
        updates: dict[int, list[tuple[int, int]]] = {}
        for target, factor, entry in tape.update[tape.update_first[m] : tape.update_first[n]]:
            updates.setdefault(int(target), []).append((int(factor), int(entry)))
        first_free = nought + 1 + len(dependent)
        computed: dict[int, int] = {}

        def source(slot: int) -> int:
            place = places[slot]
            return self.sloped[place] if place in self.sloped else self._entry.get(place, nought)

        def place_of(slot: int) -> int:
            return computed[slot] if slot in computed else source(slot)

        factor, pairs, factor_first = [], [], []
        for p in range(m, n):
            upper = [slot for slot, _ in _backward_of(tape, p)]
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
        self.pairs, self.pairs_first = _lists(pairs, 2)
        self.size = first_free + len(computed)
        pivot = {int(row): p for p, row in enumerate(tape.pivots[m:, 0])}
        self.forward, self.forward_first = _lists(
            [[(place_of(slot), pivot[row]) for slot, row in found] for found in _forward_of(tape, m, n)[m:]], 2
        )
        self.backward, self.backward_first = _lists(
            [[(place_of(slot), column) for slot, column in _backward_of(tape, p)] for p in range(n - 1, m - 1, -1)], 2
        )
        self.product, self.product_first = self._product(rows, places, n - m)

    def entry(self, row: int, column: int) -> int:
        """Number of a border entry."""
        return self._entry[int(row), int(column)]

    def _product(self, rows, places, size: int) -> tuple[np.ndarray, np.ndarray]:
        """Entries that are not nought before the solution-dependent terms are added, row by row."""
        tape = self._tape
        filled = {
            tuple(map(int, place))
            for kind, width in (("e", 2), ("f", 2), ("e_time", 3), ("f_time", 3))
            for place in rows(kind, width)[:, :2]
        }
        filled |= {places[int(slot)] for slot in tape.update[: tape.update_first[tape.interior], 0]}
        found = [[] for _ in range(size)]
        for (row, column), entry in self._entry.items():
            if (row, column) in filled:
                found[self._position[row]].append((entry, column))
        return _lists(found, 2)


@dataclass(frozen=True)
class Group:
    """Tables of one group of at most LANES samples; idle lanes repeat the group's first sample."""

    values: Values
    work: Work


def fill(program: Program, system: Assembly, periods: np.ndarray, times: int, scheme: Scheme, samples: slice) -> Group:
    """Values of the samples in `samples` from a batch's assembled terms.

    periods: (batch,) time that `times` steps take (s).
    """
    n, s, kept = program.size, program.structure, program.kept
    lanes = np.arange(samples.start, samples.start + LANES)
    lanes = np.where(lanes < samples.stop, lanes, samples.start)

    def rows(kind: str, part: int = 0) -> np.ndarray:
        coefficients = getattr(system, kind).coefficients
        return _spread_rows([coefficients[k][part] for k in kept[kind]], lanes)

    step = table(1)
    step[0] = scheme.gamma * periods[lanes] / times
    f, e, f_lagged = rows("f"), rows("e"), rows("f_lagged")
    to_y = scheme.alpha_f * step[0]
    matrix = table(len(program.tape.slot_row))
    np.add.at(matrix, program.slots, np.concatenate([f * to_y, e * scheme.alpha_m, f_lagged * to_y]))
    inverse = table(program.tape.interior)
    condense(*_interior(program.tape), matrix, inverse)
    linear = np.concatenate([f, e, f_lagged])
    terms = table(len(linear))
    terms[:] = linear[program.order]
    rates = s.terms >= n
    terms[rates] *= 1.0 - scheme.alpha_m / scheme.gamma
    lagged = table(len(s.lagged))
    for k, coefficient in zip(kept["f_lagged"], np.abs(rows("f_lagged")), strict=True):
        unknown = np.searchsorted(s.lagged, system.f_lagged.where[k][1])
        lagged[unknown] = np.maximum(lagged[unknown], coefficient * scheme.alpha_f * step[0])
    constant = table(n)
    for k in kept["constant"]:
        (row,) = system.constant.where[k]
        constant[row] += _lanes_of(system.constant.coefficients[k][0], lanes)
    shapes = table(len(system.shapes) * times)
    for k, shape in enumerate(system.shapes):
        shapes[k * times : (k + 1) * times] = (shape[lanes] if len(shape) > 1 else shape).T
    exponential = table(3 * len(kept["exponentials"]))
    for part in range(3):
        exponential[part::3] = rows("exponentials", part)
    values = Values(
        terms=terms,
        matrix=matrix,
        inverse=inverse,
        constant=constant,
        constant_time=_aligned(rows("constant_time")[_by_row(program.kept, system)]),
        matrix_time=_aligned(np.concatenate([rows("f_time"), rows("e_time")])),
        shapes=shapes,
        square=_aligned(rows("square")),
        square_rate=_aligned(rows("square_rate")),
        exponential=exponential,
        valve_term=_aligned(rows("f_valve")),
        lagged=lagged,
        step=step,
    )
    border = n - program.tape.interior
    work = Work(
        constant=table(n),
        reduced=table(n),
        linear=table(border),
        residual=table(border),
        increment=table(n),
        total=table(n + len(s.lagged)),
        matrix=table(program.border_rows),
        inverse=table(border),
        slope=table(len(s.valve_term) + len(s.square) + len(s.square_rate) + len(s.exponential)),
        open=table(len(s.valve)),
        factored=table(len(s.valve)),
        flow=table(len(s.valve)),
    )
    return Group(values, work)


def seat(groups: list[Group], places: list[tuple[int, int]]) -> Group:
    """A group whose lanes are taken from others: (group, lane) for each, at most LANES; idle lanes repeat the first."""
    places = [*places, *[places[0]] * (LANES - len(places))]
    values = []
    for tables in zip(*(group.values for group in groups), strict=True):
        values.append(table(len(tables[0])))
        for lane, (group, from_lane) in enumerate(places):
            values[-1][:, lane] = tables[group][:, from_lane]
    return Group(Values(*values), Work(*(table(len(part)) for part in groups[0].work)))


def _interior(tape: Tape) -> tuple[np.ndarray, ...]:
    """What `condense` needs of a tape."""
    m = tape.interior
    first = np.stack([tape.divide_first[: m + 1], tape.update_first[: m + 1]], axis=1)
    return tuple(
        np.ascontiguousarray(part, dtype=np.uint32)
        for part in (tape.pivots[:m, 2], tape.divide[: first[-1, 0], 0], tape.update[: first[-1, 1]], first)
    )


def _lanes_of(value, lanes: np.ndarray):
    """Values (LANES,) of a coefficient (batch,), or the one number that it is."""
    if isinstance(value, float):
        return value
    return value[lanes] if value.size > 1 else value[0]


def _spread_rows(values: list, lanes: np.ndarray) -> np.ndarray:
    rows = np.empty((len(values), LANES))
    for row, value in zip(rows, values, strict=True):
        row[:] = _lanes_of(value, lanes)
    return rows


def _aligned(rows: np.ndarray) -> np.ndarray:
    aligned = table(len(rows))
    aligned[:] = rows
    return aligned
