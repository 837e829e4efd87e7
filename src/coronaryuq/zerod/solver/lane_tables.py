"""Values of a group of samples, one sample a lane, in the tables that the kernels work on."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.zerod.solver.assembly import Assembly
from coronaryuq.zerod.solver.elimination import Tape
from coronaryuq.zerod.solver.kernel_tables import Scheme, Values, Work
from coronaryuq.zerod.solver.kernels import condense
from coronaryuq.zerod.solver.lanes import LANES, table
from coronaryuq.zerod.solver.tables import Program, by_row


@dataclass(frozen=True)
class Group:
    """Tables of one group of at most LANES samples; idle lanes repeat the group's first sample."""

    values: Values
    work: Work


def fill(program: Program, system: Assembly, periods: np.ndarray, times: int, scheme: Scheme, samples: slice) -> Group:
    """Fill the tables of the samples in `samples` from a batch's assembled terms.

    periods: (batch,) duration of `times` steps (s).
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
        constant_time=_aligned(rows("constant_time")[by_row(program.kept, system)]),
        matrix_time=_aligned(np.concatenate([rows("f_time"), rows("e_time")])),
        shapes=shapes,
        square=_aligned(rows("square")),
        square_rate=_aligned(rows("square_rate")),
        exponential=exponential,
        valve_term=_aligned(rows("f_valve")),
        gate=_aligned(_spread_rows(system.steepness, lanes)),
        gate_term=_aligned(rows("f_gate")),
        gate_constant=_aligned(rows("constant_gate")),
        gate_slope=_aligned(rows("gate_slope")),
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
        slope=table(
            len(s.valve_term)
            + len(s.square)
            + len(s.square_rate)
            + len(s.exponential)
            + len(s.gate_term)
            + len(s.gate_slope)
        ),
        open=table(len(s.valve)),
        factored=table(len(s.valve)),
        flow=table(len(s.valve)),
        shut=table(2 * len(s.gate)),
    )
    return Group(values, work)


def gather_lanes(groups: list[Group], places: list[tuple[int, int]]) -> Group:
    """Collect lanes of other groups, at most LANES, each as (group, lane), in one; idle lanes repeat the first."""
    places = [*places, *[places[0]] * (LANES - len(places))]
    values = []
    for tables in zip(*(group.values for group in groups), strict=True):
        values.append(table(len(tables[0])))
        for lane, (group, from_lane) in enumerate(places):
            values[-1][:, lane] = tables[group][:, from_lane]
    return Group(Values(*values), Work(*(table(len(part)) for part in groups[0].work)))


def _interior(tape: Tape) -> tuple[np.ndarray, ...]:
    """Return the parts of a tape that `condense` needs."""
    m = tape.interior
    first = np.stack([tape.divide_first[: m + 1], tape.update_first[: m + 1]], axis=1)
    return tuple(
        np.ascontiguousarray(part, dtype=np.uint32)
        for part in (tape.pivots[:m, 2], tape.divide[: first[-1, 0], 0], tape.update[: first[-1, 1]], first)
    )


def _lanes_of(value, lanes: np.ndarray):
    """Return the values (LANES,) of a coefficient (batch,), or its only value."""
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
