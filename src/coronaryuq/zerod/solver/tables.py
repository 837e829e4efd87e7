"""Structure of the kernels' tables, made from the elements' terms once per network."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.solver.assembly import Assembly, Context, Terms
from coronaryuq.zerod.solver.elements import ELEMENTS, Write
from coronaryuq.zerod.solver.elimination import Entries, Singular, Tape, eliminate
from coronaryuq.zerod.solver.kernel_tables import Scheme, Structure
from coronaryuq.zerod.solver.nonlinear_block import SLOPED, Border, flatten

_SCENARIOS = 8


def write_elements(model: Model, context: Context, elements: Mapping[str, Write] = ELEMENTS) -> Assembly:
    """Write all blocks for the parameters of `context`; `elements`: kind of block → function that writes it."""
    system = Assembly()
    for block in model.blocks.values():
        elements[block.kind](block, context, system)
    return system


@dataclass(frozen=True)
class Program:
    """Structure of one network, for parameters whose zeros are known.

    kept: for each kind of term, the elements' terms that are not identically zero. order: position of the linear terms
    (f, e, f_lagged) in the structure. slots: their slots in the matrix. border_rows: length of the border's table.
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
    "f_gate",
    "constant_gate",
    "gate_slope",
)


def _kept(terms: Terms) -> np.ndarray:
    return np.array([k for k, c in enumerate(terms.coefficients) if np.any(np.asarray(c[0]) != 0.0)], dtype=np.int64)


def make_program(
    model: Model,
    context: Context,
    scheme: Scheme,
    step: float,
    own: Context | None = None,
    elements: Mapping[str, Write] = ELEMENTS,
) -> Program:
    """Analyse the network as written for `context` (one sample, nonzero wherever a sample may be nonzero).

    step: time step (s) for which pivots are chosen. own: the network's own values, for which pivots are chosen if the
    network has a solution with them: an entry that is zero in some samples must not be a pivot. Raises `InputError` if
    the equations have no solution.
    """
    n, system = model.size, write_elements(model, context, elements)
    kept = {kind: _kept(getattr(system, kind)) for kind in _KINDS}

    def rows(kind: str, columns: int) -> np.ndarray:
        terms = getattr(system, kind)
        return np.array([terms.where[k] for k in kept[kind]], dtype=np.int64).reshape(-1, columns)

    e, f, f_lagged = rows("e", 2), rows("f", 2), rows("f_lagged", 2)
    lagged = np.unique(f_lagged[:, 1])
    late = np.stack([f_lagged[:, 0], n + np.searchsorted(lagged, f_lagged[:, 1])], axis=1)
    changing = np.concatenate([rows(kind, width)[:, :2] for kind, width in (("e_time", 3), ("f_time", 3), *SLOPED)])
    entries = Entries.at(np.concatenate([changing, e, f, late]), n, n + len(lagged))
    inner_rows, inner_columns = np.ones(n, bool), np.ones(n, bool)
    inner_rows[changing[:, 0]] = inner_columns[changing[:, 1]] = inner_columns[lagged] = False
    # The unknowns that determine a valve's state must be known inside Newton's loop.
    inner_columns[[column for valve in [*system.valves, *system.gates] for column in valve]] = False

    def tape_of(judged: Assembly) -> Tape:
        return eliminate(entries, _scenarios(entries, lagged, judged, kept, scheme, step), inner_rows, inner_columns)

    try:
        try:
            tape = tape_of(system if own is None else write_elements(model, own, elements))
        except Singular:
            tape = tape_of(system)
    except Singular as error:
        block = model.equations[error.row]
        raise InputError(model.file, block, None, "system is singular; check its connections and parameters") from None
    structure, order = _structure(n, tape, lagged, system, kept, rows)
    place = {(int(r), int(c)): k for k, (r, c) in enumerate(zip(tape.slot_row, tape.slot_column, strict=True))}
    slots = np.array([place[int(r), int(c)] for r, c in np.concatenate([f, e, late])], dtype=np.int64)
    return Program(n, structure, kept, order, slots, tape, Border(tape, rows).size)


def _scenarios(entries: Entries, lagged: np.ndarray, system: Assembly, kept, scheme: Scheme, step: float) -> np.ndarray:
    """Return Jacobians at possible states: valves open and shut, activation high and low, flows small and large."""
    to_y = scheme.alpha_f * scheme.gamma * step
    values = np.zeros((_SCENARIOS, len(entries.keys)))
    random = np.random.Generator(np.random.Philox(key=22))

    def terms(kind: str) -> Iterator[tuple[int, float, tuple]]:
        """Yield the entry, the coefficient and the other numbers of each term that is kept."""
        own = getattr(system, kind)
        where = [own.where[k] for k in kept[kind]]
        places = np.array([w[:2] for w in where], dtype=np.int64).reshape(-1, 2)
        if kind == "f_lagged":
            places[:, 1] = entries.size + np.searchsorted(lagged, places[:, 1])
        for k, entry, (_, _, *rest) in zip(kept[kind], entries.find(places), where, strict=True):
            yield entry, float(np.ravel(own.coefficients[k][0])[0]), tuple(rest)

    for kind, weight in (("e", scheme.alpha_m), ("f", to_y), ("f_lagged", to_y)):
        for entry, coefficient, _ in terms(kind):
            values[:, entry] += weight * coefficient
    for number, matrix in enumerate(values):
        for kind, weight in (("e_time", scheme.alpha_m), ("f_time", to_y)):
            for entry, coefficient, (shape,) in terms(kind):
                waveform = system.shapes[shape][0]
                time = number * (waveform.size - 1) // max(_SCENARIOS - 1, 1)
                matrix[entry] += weight * coefficient * waveform[time]
        for kind, scale in (("square", to_y), ("square_rate", scheme.alpha_m)):
            for entry, coefficient, _ in terms(kind):
                flow = 0.0 if number == 0 else 10.0 ** random.uniform(-2, 2)
                matrix[entry] += scale * coefficient * flow
        for kind in ("f_valve", "f_gate"):
            for entry, coefficient, (part,) in terms(kind):
                if (number >> (part % 3)) & 1 == 0:
                    matrix[entry] += to_y * coefficient
    return values


def _structure(n: int, tape: Tape, lagged: np.ndarray, system: Assembly, kept, rows) -> tuple[Structure, np.ndarray]:
    """Make the kernels' index tables; also return the order of the linear terms (f, e, f_lagged) in them."""
    border = Border(tape, rows)
    position = np.empty(n, dtype=np.int64)
    position[tape.pivots[:, 0]] = np.arange(n)
    entries = np.concatenate([rows("f", 2), rows("e", 2) + np.array([0, n]), rows("f_lagged", 2)])
    order = np.argsort(position[entries[:, 0]], kind="stable")
    constant_time = rows("constant_time", 2)[by_row(kept, system)]
    constant_rows, constant_first = np.unique(constant_time[:, 0], return_index=True)
    f_time, e_time = rows("f_time", 3), rows("e_time", 3)
    matrix_time = np.concatenate([f_time, e_time + np.array([0, n, 0])])
    time_entries = [border.entry(r, c) for r, c in np.concatenate([f_time, e_time])[:, :2]]
    matrix_time = np.column_stack([position[matrix_time[:, 0]] - tape.interior, matrix_time[:, 1:], time_entries])
    forward, forward_first = flatten(
        [
            [(slot, position[pivot_row]) for slot, pivot_row in operations]
            for operations in tape.forward_of(0, tape.interior)
        ],
        2,
    )
    backward, backward_first = flatten([tape.backward_of(p) for p in range(tape.interior - 1, -1, -1)], 2)
    lagged_border = [
        (slot, position[row] - tape.interior, column - n)
        for slot, (row, column) in enumerate(zip(tape.slot_row, tape.slot_column, strict=True))
        if column >= n and position[row] >= tape.interior
    ]

    def dependent(kind: str, columns: int) -> np.ndarray:
        part = rows(kind, columns)
        entries = [
            (position[r] - tape.interior, c, border.entry(r, c), border.sloped[int(r), int(c)], *rest)
            for r, c, *rest in part
        ]
        return np.array(entries, dtype=np.int64).reshape(-1, columns + 2)

    gate_constant = rows("constant_gate", 2)
    gate_constant[:, 0] = position[gate_constant[:, 0]] - tape.interior
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
        gate=np.array(system.gates, dtype=np.int64).reshape(-1, 2),
        gate_term=dependent("f_gate", 3),
        gate_constant=gate_constant,
        gate_slope=dependent("gate_slope", 4),
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


def by_row(kept: dict[str, np.ndarray], system: Assembly) -> np.ndarray:
    """Return the order of the time-dependent constants in the structure: those of one row side by side."""
    return np.argsort([system.constant_time.where[k][0] for k in kept["constant_time"]], kind="stable").astype(np.int64)
