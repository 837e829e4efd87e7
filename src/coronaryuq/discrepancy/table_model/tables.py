"""Table models: tables of simulated and measured outputs without a network, joined and split into branches."""

import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.linalg import eigh

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import read_csv

SD_ZERO_FLOW, SD_BED, FLOOR_BED = 0.1, 0.25, 0.003
"""Prior standard deviations of the zero-flow pressure over the root pressure and of the log resistance of a bed;
least relative error of the pressure and flow of an outlet."""
POINTS, NEAR = 100, 12.5
"""Points between 0 and the least outlet pressure at which a zero-flow pressure is tested, and then again as many where
its log density is within the latter of the largest, as within five standard deviations."""
EXACT, LARGEST_ROUNDING = 1e-6, 0.01
"""Relative tolerance for equal pressures, and the largest that rounding may add to it."""
MOST_DIGITS = 12
AS_NEAR = 2.0
"""Standard errors of the mean difference of squares within which two columns match equally well."""
LEAST_SAMPLES = 20
LARGEST_FFR = 1.5
LARGEST_RATIO, LARGEST_FLOW_RATIO = 3.0, 20.0
"""Ratios of the mean root pressure, and of the flow of a branch, above which the tables use different units."""
SAME_PRESSURE = 1e-3
"""Fraction of the root pressure by which two columns of the same pressure may differ, because FFR is rounded."""


Key = tuple[str, str]
"""(statistic_quantity, downstream block), such as ("mean_flow", "BC_lad")."""
Columns = dict[Key, tuple[str, str]]
"""Column of the simulated and of the measured table for each key."""


@dataclass(frozen=True)
class Branch:
    """One stenosed branch: pressures at the root, distal to it and at the outlet; simulated (0), measured (3).

    name: NAME of the column `ffr_NAME`; place: 0D location of the distal pressure; arrays (n,) in the table's units.
    venous: zero-flow pressure of the beds, with its posterior standard deviation `venous_sd`.
    flow_source: "measured", or how the measured flow was derived.
    """

    name: str
    place: str
    root0: np.ndarray
    root3: np.ndarray
    distal0: np.ndarray
    distal3: np.ndarray
    outlet0: np.ndarray
    outlet3: np.ndarray
    flow0: np.ndarray
    flow3: np.ndarray
    venous: float
    flow_source: str
    venous_sd: float = 0.0

    @property
    def one_sensor(self) -> bool:
        """Whether the distal pressure and the outlet pressure are the same reading."""
        simulated = np.abs(self.distal0 - self.outlet0) <= SAME_PRESSURE * self.root0
        measured = np.abs(self.distal3 - self.outlet3) <= SAME_PRESSURE * self.root3
        return bool(simulated.all() and measured.all())

    @property
    def drop0(self) -> np.ndarray:
        return self.root0 - self.distal0

    @property
    def drop3(self) -> np.ndarray:
        return self.root3 - self.distal3


def artery(name: str) -> str:
    """Return the usual spelling of a branch: LAD, LCx, RCA."""
    return {"lcx": "LCx"}.get(name.lower(), name.upper())


def read_pairs(simulated: str | Path, measured: str | Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Read both tables, joined on `sample`; raise `InputError` if they have too few samples in common."""
    tables = [read_csv(path, ("sample",)).set_index("sample") for path in (simulated, measured)]
    for path, table in zip((simulated, measured), tables, strict=True):
        if table.index.has_duplicates:
            duplicates = table.index[table.index.duplicated()]
            raise InputError(path, "sample", str(duplicates[0]), "duplicate sample; keep one row")
        _check_ffr(path, table)
    common = [name for name in tables[0].index if name in tables[1].index]
    if len(common) < LEAST_SAMPLES:
        first_samples = " and ".join(repr(table.index.tolist()[0]) for table in tables if len(table))
        remedy = f"expected at least {LEAST_SAMPLES}; compare the sample names ({first_samples})"
        raise InputError(measured, f"number of samples in common with {simulated}", len(common), remedy)
    first, second = (table.loc[common].apply(pd.to_numeric, errors="coerce") for table in tables)
    return first, second


def _check_ffr(path: str | Path, table: pd.DataFrame) -> None:
    for column in (c for c in table.columns if str(c).startswith("ffr_")):
        middle = pd.to_numeric(table[column], errors="coerce").median()
        if not (np.isnan(middle) or 0.0 < middle <= LARGEST_FFR):
            remedy = "expected distal over root pressure, 0 to 1 (not in %)"
            raise InputError(path, f"median {column}", float(f"{middle:.4g}"), remedy)


def branches(
    simulated: pd.DataFrame, measured: pd.DataFrame, file: str | Path, measured_file: str | Path
) -> list[Branch]:
    """Return the branches with a column `ffr_NAME` in both tables.

    The root pressure is the highest mean pressure that both tables have, and the distal location that of the simulated
    pressure equal to FFR times the root pressure. The outlet is the one there, or the one whose pressure correlates
    best with it; the measured flow is that of the outlet, or is scaled by it. `venous` is estimated from all outlets.
    """
    pairs = _pairs(simulated, measured)
    pressures = {key: pair for key, pair in pairs.items() if key[0] == "mean_pressure"}
    flows = {key: pair for key, pair in pairs.items() if key[0] == "mean_flow"}
    names = [c[4:] for c in simulated.columns if c.startswith("ffr_") and c in measured.columns]
    if not names:
        raise _column_missing(simulated, file, measured_file, "ffr_NAME")
    for here, path, there in ((simulated, file, measured), (measured, measured_file, simulated)):
        unmatched = [c for c in here.columns if str(c).lower().startswith("ffr_") and c not in there.columns]
        if unmatched:
            print(f"note: {path}: {', '.join(unmatched)}: not in the other table, ignored", file=sys.stderr)
    for wanted, there in (("mean_pressure:A:B", pressures), ("mean_flow:A:B", flows)):
        if not there:
            raise _column_missing(simulated, file, measured_file, wanted)
    ratios = [f"ffr_{name}" for name in names]
    root = max(pressures, key=lambda key: np.nan_to_num(measured[pressures[key][1]].mean(), nan=-np.inf))
    _check_whole(file, simulated, [*ratios, pressures[root][0]])
    _check_whole(measured_file, measured, [*ratios, pressures[root][1]])
    root0, root3 = (table[c].to_numpy() for table, c in zip((simulated, measured), pressures[root], strict=True))
    ratio = float(root3.mean() / root0.mean())
    if not 1.0 / LARGEST_RATIO < ratio < LARGEST_RATIO:
        remedy = f"the mean in the other table is {ratio:.4g} times as large; give both in one unit of pressure"
        raise InputError(file, pressures[root][0], float(f"{root0.mean():.4g}"), remedy)
    venous, venous_sd = zero_flow_pressure(simulated, measured, pressures, flows, root)
    outlets = {key: pair for key, pair in pressures.items() if key != root}
    found = []
    for name in names:
        place = _same_pressure(simulated, pressures[root][0], file, name)
        distal0 = simulated[f"mean_pressure:{place}"].to_numpy()
        distal3 = measured[f"ffr_{name}"].to_numpy() * root3
        if f"mean_flow:{place}" not in simulated.columns:
            raise InputError(file, f"mean_flow:{place}", None, f"column missing: flow at the stenosis of {name}")
        flow0 = simulated[f"mean_flow:{place}"].to_numpy()
        outlet = _outlet(file, simulated, outlets, flows, root0, distal0, place)
        (p0, p3), (q0, q3) = outlets["mean_pressure", outlet], flows["mean_flow", outlet]
        _check_whole(file, simulated, [p0, q0, f"mean_flow:{place}"])
        _check_whole(measured_file, measured, [p3, q3])
        _check_forward(file, simulated, [q0, f"mean_flow:{place}"])
        _check_forward(measured_file, measured, [q3])
        flow3 = flow0 * measured[q3].to_numpy() / simulated[q0].to_numpy()
        derived = f"simulated flow times measured over simulated flow of outlet {outlet}"
        source = "measured" if q0 == f"mean_flow:{place}" else derived
        ends = (simulated[p0].to_numpy(), measured[p3].to_numpy())
        parts = (root0, root3, distal0, distal3, *ends, flow0, flow3)
        times = float(np.median(flow3 / flow0))
        if not 1.0 / LARGEST_FLOW_RATIO < times < LARGEST_FLOW_RATIO:
            remedy = f"the flow in the other table is {times:.4g} times as large; give both in one unit of flow"
            raise InputError(file, q0, float(f"{np.median(flow0):.4g}"), remedy)
        found.append(Branch(name, place, *parts, venous, source, venous_sd))
    return found


def _column_missing(simulated: pd.DataFrame, file: str | Path, measured_file: str | Path, wanted: str) -> InputError:
    """Error for a kind of column that is not in both tables, with the file in which it is missing."""
    prefix = wanted.removesuffix("NAME").removesuffix("A:B")
    has = any(str(column).startswith(prefix) for column in simulated.columns)
    return InputError(measured_file if has else file, wanted, None, "no such column in both tables")


def _check_whole(path: str | Path, table: pd.DataFrame, columns: list[str]) -> None:
    for column in columns:
        gaps = ~np.isfinite(table[column].to_numpy())
        if gaps.any():
            remedy = f"no finite number in sample {table.index[int(np.argmax(gaps))]}; remove that row"
            raise InputError(path, column, None, remedy)


def _check_forward(path: str | Path, table: pd.DataFrame, columns: list[str]) -> None:
    """Raise `InputError` unless all flows are positive, as laws are fitted to relative flows."""
    for column in columns:
        wrong = ~(table[column].to_numpy() > 0.0)
        if wrong.any():
            sample, value = table.index[int(np.argmax(wrong))], float(table[column].to_numpy()[wrong][0])
            remedy = f"in sample {sample}; expected a positive (downstream) flow; remove that row"
            raise InputError(path, column, value, remedy)


def _pairs(simulated: pd.DataFrame, measured: pd.DataFrame) -> Columns:
    """Match the columns of both tables by statistic, quantity and downstream block."""

    def key(column: str) -> Key | None:
        match = re.fullmatch(r"((?:mean|min|max)_(?:pressure|flow)):([^:]+):([^:]+)", column)
        return (match[1], re.sub(r"^(inlet_|outlet_)", "", match[3])) if match else None

    first, second = ({k: c for c in table.columns if (k := key(c))} for table in (simulated, measured))
    return {k: (first[k], second[k]) for k in first if k in second}


def _same_pressure(simulated: pd.DataFrame, root: str, file: str | Path, name: str) -> str:
    """Return the location "A:B" of the pressure column that equals FFR times the root pressure.

    Tolerances are `EXACT` and the rounding of the three columns. Raises `InputError` if no column matches, or if two
    different ones match equally well.
    """
    ffr, over = simulated[f"ffr_{name}"].to_numpy(), simulated[root].to_numpy()
    columns = [c for c in simulated.columns if c.startswith("mean_pressure:") and np.isfinite(simulated[c]).all()]
    wanted, squares = ffr * over, {}
    for column in columns:
        pressure = simulated[column].to_numpy()
        rounding = over * _rounding(ffr) + ffr * _rounding(over) + _rounding(pressure)
        allowed = EXACT + np.minimum(rounding / wanted, LARGEST_ROUNDING)
        if (np.abs(pressure / wanted - 1.0) < allowed).all():
            squares[column] = (pressure / wanted - 1.0) ** 2
    if not squares:
        raise InputError(file, f"ffr_{name}", None, "no mean_pressure column equals FFR times the root pressure")
    best = min(squares, key=lambda c: squares[c].mean())
    for other in squares:
        same = np.abs(simulated[other] / simulated[best] - 1.0).max() < EXACT
        more = squares[other] - squares[best]
        if not same and more.mean() < AS_NEAR * more.std() / np.sqrt(len(more)):
            remedy = f"the product with the root pressure equals {best} and {other} within rounding; give more digits"
            raise InputError(file, f"ffr_{name}", None, remedy)
    return best.split(":", 1)[1]


def _rounding(values: np.ndarray) -> np.ndarray:
    """Return half a unit of the last digit of each number, (n,), for common decimals or significant digits."""
    exponent = np.floor(np.log10(np.maximum(np.abs(values), np.finfo(float).tiny)))
    halves = np.zeros(len(values))
    for leading in (np.zeros(len(values)), exponent):
        for digits in range(-3, MOST_DIGITS):
            unit = 10.0 ** (leading - digits)
            if np.allclose(np.round(values / unit) * unit, values, rtol=1e-14, atol=0.0):
                halves = np.maximum(halves, 0.5 * unit)
                break
    return halves


def _outlet(
    file: str | Path,
    simulated: pd.DataFrame,
    outlets: Columns,
    flows: Columns,
    root0: np.ndarray,
    distal0: np.ndarray,
    place: str,
) -> str:
    """Return the outlet at a place, or the one whose relative pressure correlates best with that of the place."""
    shared = {block: pair for (_, block), pair in outlets.items() if ("mean_flow", block) in flows}
    if not shared:
        remedy = "no outlet has both in both tables; give both for at least one outlet"
        raise InputError(file, "mean_pressure:A:B, mean_flow:A:B", None, remedy)
    if place.split(":")[-1] in shared:
        return place.split(":")[-1]
    correlation = {
        block: abs(np.corrcoef(simulated[column] / root0, distal0 / root0)[0, 1])
        for block, (column, _) in shared.items()
    }
    return max(correlation, key=lambda block: correlation[block])


def zero_flow_pressure(
    simulated: pd.DataFrame, measured: pd.DataFrame, pressures: Columns, flows: Columns, root: Key
) -> tuple[float, float]:
    """Estimate the zero-flow pressure of the beds, from 0 to below the least outlet pressure, with its posterior sd.

    Each bed keeps its resistance up to a factor k: P3 - z = k (P0 - z) Q3 / Q0. Errors of P3 and Q3, of whatever size,
    do not correlate with functions of the exact P0 and Q0, with which the relation is tested: by limited-information
    maximum likelihood (Anderson & Rubin 1949), which fits of P3 to Q3, or the reverse, would bias. k and z have priors,
    so that beds whose flow does not change are uninformative and leave z near 0.
    """
    beds = []
    for key, (p0, p3) in pressures.items():
        pair = flows.get(("mean_flow", key[1]))
        if key == root or pair is None:
            continue
        a, b = simulated[p0].to_numpy(), measured[p3].to_numpy()
        with np.errstate(divide="ignore", invalid="ignore"):
            flow = simulated[pair[0]].to_numpy()
            ratio = measured[pair[1]].to_numpy() / flow
            valid = np.isfinite(a * b * ratio) & (a > 0.0) & (b > 0.0) & (ratio > 0.0)
        if valid.any():
            beds.append((a[valid], b[valid], ratio[valid], flow[valid]))
    if not beds:
        return 0.0, 0.0
    scale = SD_ZERO_FLOW * float(simulated[pressures[root][0]].mean())

    least = min(min(a.min(), b.min()) for a, b, _, _ in beds)
    low, high = 0.0, least
    for _ in range(2):
        z, step = np.linspace(low, high, POINTS, endpoint=False, retstep=True)
        log_density = -0.5 * (z / scale) ** 2 + sum(_log_density_of_bed(*bed, z) for bed in beds)
        near = z[log_density > log_density.max() - NEAR]
        low, high = max(near[0] - step, 0.0), min(near[-1] + step, least)
    found = float(z[np.argmax(log_density)])
    density = np.exp(log_density - log_density.max())
    return found, float(np.sqrt(np.average((z - found) ** 2, weights=density)))


def _log_density_of_bed(a: np.ndarray, b: np.ndarray, ratio: np.ndarray, flow: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the log density of zero-flow pressures (m,) by one bed's P0, P3, Q3 / Q0 and Q0, (n,) each."""
    first, second = a / a.mean() - 1.0, flow / flow.mean() - 1.0
    basis = np.column_stack([np.ones(len(a)), first, second, first**2, first * second, second**2])
    functions, lengths, _ = np.linalg.svd(basis, full_matrices=False)
    functions = functions[:, lengths > EXACT * lengths[0]]
    found = np.empty(len(z))
    for number, zero in enumerate(z):
        sides = np.column_stack([b - zero, (a - zero) * ratio])
        squares, along = sides.T @ sides, functions.T @ sides
        squares += FLOOR_BED**2 * np.diag(np.diag(squares))
        # The least ratio, over all k, of the residual's square to the square of its part that no function explains.
        excess, (in_first, in_second) = eigh(squares, squares - along.T @ along, subset_by_index=[0, 0])
        factor = float(-in_second[0] / in_first[0]) if in_first[0] else np.inf
        of_factor = -0.5 * (np.log(factor) / SD_BED) ** 2 if factor > 0.0 else -np.inf
        found[number] = of_factor - 0.5 * len(a) * np.log(excess[0])
    return found
