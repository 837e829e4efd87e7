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

    kept: for each kind of term, which of the elements' terms are not identically zero.
    """

    size: int
    structure: Structure
    kept: dict[str, np.ndarray]
    order: np.ndarray
    tape: Tape


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


def make_program(model: Model, at: Context, scheme: Scheme, step: float) -> Program:
    """Analyse the network as written for `at` (one sample, nonzero wherever a sample may be nonzero).

    step: time step (s) at which pivots are judged. Raises `InputError` when the equations have no solution.
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
    scenarios = _scenarios(n, lagged, system, kept, scheme, step)
    try:
        tape = eliminate(scenarios, pattern, ~changing.any(axis=1), inner_columns)
    except Singular as error:
        block = model.equations[error.row]
        raise InputError(model.file, block, None, "system is singular; check its connections and parameters") from None
    structure, order = _structure(n, tape, lagged, system, rows)
    return Program(n, structure, kept, order, tape)


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


def _structure(n: int, tape: Tape, lagged: np.ndarray, system: Assembly, rows) -> tuple[Structure, np.ndarray]:
    slots = {(int(r), int(c)): k for k, (r, c) in enumerate(zip(tape.slot_row, tape.slot_column, strict=True))}
    e, f, f_lagged = rows("e", 2), rows("f", 2), rows("f_lagged", 2)
    entries = np.concatenate([f, e + np.array([0, n]), f_lagged])
    order = np.argsort(entries[:, 0], kind="stable")
    starts = np.searchsorted(entries[order, 0], np.arange(n + 1))
    assemble = [(slots[int(r), int(c)], k, 0) for k, (r, c) in enumerate(f)]
    assemble += [(slots[int(r), int(c)], len(f) + k, 1) for k, (r, c) in enumerate(e)]
    assemble += [
        (slots[int(r), n + int(np.searchsorted(lagged, c))], len(f) + len(e) + k, 0)
        for k, (r, c) in enumerate(f_lagged)
    ]
    border_rows = {int(row) for row in tape.pivots[tape.interior :, 0]}
    border_columns = {int(column) for column in tape.pivots[tape.interior :, 1]}
    border = [
        (slot, row, column) for (row, column), slot in slots.items() if row in border_rows and column in border_columns
    ]
    lagged_border = [
        (slot, row, column - n) for (row, column), slot in slots.items() if row in border_rows and column >= n
    ]
    number = {slot: k for k, (slot, _, _) in enumerate(border)}

    def with_slot(part: np.ndarray) -> np.ndarray:
        return _column(part, [number[slots[int(r), int(c)]] for r, c in part[:, :2]])

    def time_terms() -> np.ndarray:
        f_time, e_time = rows("f_time", 3), rows("e_time", 3)
        both = np.concatenate([with_slot(f_time), with_slot(e_time)])
        both[len(f_time) :, 1] += n
        return both

    m = tape.interior

    def backward(first: int, last: int, renumber) -> tuple[np.ndarray, np.ndarray]:
        found, starts = [], [0]
        for p in range(last - 1, first - 1, -1):
            for _, slot, column in tape.backward[tape.backward_first[p] : tape.backward_first[p + 1]]:
                found.append((renumber(int(slot)), int(column)))
            starts.append(len(found))
        return np.array(found, dtype=np.int64).reshape(-1, 2), np.array(starts, dtype=np.int64)

    def operations(name: str, first: int, last: int) -> np.ndarray:
        starts = getattr(tape, f"{name}_first")
        return getattr(tape, name)[starts[first] : starts[last]]

    def starts_of(first: int, last: int) -> np.ndarray:
        divide, update = tape.divide_first[first : last + 1], tape.update_first[first : last + 1]
        return np.stack([divide - divide[0], update - update[0]], axis=1)

    renumbered = np.vectorize(lambda slot: number[int(slot)], otypes=[np.int64])
    inner_backward, inner_backward_first = backward(0, m, lambda slot: slot)
    border_backward, border_backward_first = backward(m, n, number.__getitem__)
    border_update, border_divide = operations("update", m, n), operations("divide", m, n)
    border_forward = operations("forward", m, n).copy()
    border_forward[:, 1] = _apply(renumbered, border_forward[:, 1])
    structure = Structure(
        linear=starts,
        terms=entries[order, 1],
        assemble=np.array(assemble, dtype=np.int64).reshape(-1, 3),
        constant_time=rows("constant_time", 2),
        matrix_time=time_terms(),
        lagged=lagged,
        lagged_border=np.array(lagged_border, dtype=np.int64).reshape(-1, 3),
        square=with_slot(rows("square", 2)),
        square_rate=with_slot(rows("square_rate", 2)),
        exponential=with_slot(rows("exponentials", 3)),
        valve=np.array(system.valves, dtype=np.int64).reshape(-1, 3),
        valve_term=with_slot(rows("f_valve", 3)),
        pivots=tape.pivots.copy(),
        inner_divide=operations("divide", 0, m),
        inner_order=starts_of(0, m),
        inner_update=operations("update", 0, m),
        inner_forward=operations("forward", 0, m),
        inner_backward=inner_backward,
        inner_backward_first=inner_backward_first,
        border=np.array(border, dtype=np.int64).reshape(-1, 3),
        border_divide=_apply(renumbered, border_divide),
        border_order=starts_of(m, n),
        border_update=_apply(renumbered, border_update),
        border_forward=border_forward,
        border_backward=border_backward,
        border_backward_first=border_backward_first,
    )
    structure.pivots[m:, 2] = _apply(renumbered, structure.pivots[m:, 2])
    return Structure(*(np.ascontiguousarray(part, dtype=np.int64) for part in structure)), order


def _apply(function, values: np.ndarray) -> np.ndarray:
    return function(values) if values.size else values


def _column(part: np.ndarray, extra: list[int]) -> np.ndarray:
    return np.column_stack([part, np.array(extra, dtype=np.int64)]).astype(np.int64)


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
    linear = np.concatenate([rows("f"), rows("e"), rows("f_lagged")])
    matrix = table(len(program.tape.slot_row))
    for slot, k, rate in s.assemble:
        matrix[slot] += linear[k] * (scheme.alpha_m if rate else scheme.alpha_f * step[0])
    inverse = table(program.tape.interior)
    condense(s, matrix, inverse)
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
        constant_time=_aligned(rows("constant_time")),
        matrix_time=_aligned(np.concatenate([rows("f_time"), rows("e_time")])),
        shapes=shapes,
        square=_aligned(rows("square")),
        square_rate=_aligned(rows("square_rate")),
        exponential=exponential,
        valve_term=_aligned(rows("f_valve")),
        lagged=lagged,
        step=step,
    )
    slopes = len(s.valve_term) + len(s.square) + len(s.square_rate) + len(s.exponential)
    work = Work(
        residual=table(n),
        nonlinear=table(n),
        increment=table(n),
        total=table(n + len(s.lagged)),
        new=table(2 * n),
        border=table(len(s.border)),
        factor=table(len(s.border)),
        inverse=table(n - program.tape.interior),
        slope=table(slopes),
        open=table(max(len(s.valve), 1)),
    )
    return Group(values, work)


def _lanes_of(value, lanes: np.ndarray) -> np.ndarray:
    value = np.asarray(value, float)
    return value[lanes] if value.ndim and value.size > 1 else np.broadcast_to(value.ravel(), lanes.shape)


def _spread_rows(values: list, lanes: np.ndarray) -> np.ndarray:
    return np.array([_lanes_of(value, lanes) for value in values], dtype=float).reshape(-1, LANES)


def _aligned(rows: np.ndarray) -> np.ndarray:
    aligned = table(len(rows))
    aligned[:] = rows
    return aligned
