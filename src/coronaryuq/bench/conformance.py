"""Benchmark `conformance`: svZeroDSolver and the 0D solver here on the same network files, number by number."""

import argparse
import importlib.metadata
import math
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.zerod.network.read import check_network
from coronaryuq.zerod.svzerodsolver import program, tables

FOLDER_VARIABLE = "CORONARYUQ_SVZEROD_CASES"
"""Environment variable with a folder of cases, such as `tests/cases` of svZeroDSolver's repository."""
TOLERANCE = 1e-6
_QUICK_STEPS = 10_000
_NOISE = 1e-9


@dataclass(frozen=True)
class Comparison:
    """One case, run by both solvers.

    Attributes
    ----------
    case : str
        The file within the folder of cases.
    rows : int
        Rows of svZeroDSolver's table; 0 if it fails.
    difference : float or None
        Largest difference of any column of the table for any unknown, over the largest value there; None unless both
        run.
    where : str
        Unknown or vessel, and column, of that difference.
    own_change : float or None
        Only where the difference exceeds `TOLERANCE`: change of svZeroDSolver's own table when each initial value is
        replaced by the next floating-point number.
    refused, refused_here : str
        Why svZeroDSolver and the solver here fail; empty if they run.
    """

    case: str
    rows: int = 0
    difference: float | None = None
    where: str = ""
    own_change: float | None = None
    refused: str = ""
    refused_here: str = ""

    @property
    def agrees(self) -> bool:
        """Whether both run and agree to `TOLERANCE`, or three times `own_change` where rounding decides the result."""
        if self.difference is None:
            return False
        return self.difference <= max(TOLERANCE, 3.0 * (self.own_change or 0.0))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument(
        "--cases",
        metavar="FOLDER",
        help=f"network files, also in subfolders (default: {FOLDER_VARIABLE}, else ../shared/data/svzerod-cases)",
    )


def run(quick: bool = False, cases: str | None = None) -> dict:
    """Compare all cases of a folder; `quick` leaves out those of more than 10,000 steps."""
    if program.installed() is None:
        raise InputError("command line", "bench conformance", None, "needs svZeroDSolver: pip install svzerod")
    folder = Path(cases) if cases else case_folder()
    files = case_files(folder)
    if not files:
        raise InputError("command line", "--cases", folder, "contains no network files")
    found = [compare(path, folder) for path in files if not quick or _steps(path) <= _QUICK_STEPS]
    return {
        "svzerodsolver": _version(),
        "cases": [asdict(comparison) for comparison in found],
        "compared": len(found),
        "agree": sum(comparison.agrees for comparison in found),
        "agree_1e-9": sum((comparison.difference or 0.0) <= 1e-9 for comparison in found if comparison.rows),
        "refused_by_both": sum(bool(comparison.refused and comparison.refused_here) for comparison in found),
        "disagree": [c.case for c in found if not c.agrees and not (c.refused and c.refused_here)],
    }


def case_folder() -> Path:
    """Return the folder given by `FOLDER_VARIABLE`, else that of the cases in ../shared; it may not exist."""
    named = os.environ.get(FOLDER_VARIABLE)
    return Path(named) if named else Path(__file__).parents[4] / "shared" / "data" / "svzerod-cases"


def case_files(folder: Path) -> list[Path]:
    """Return the network files of a folder of cases, without the reference results in it."""
    files = sorted(folder.rglob("*.json"))
    return [path for path in files if "results" not in path.relative_to(folder).parts]


def compare(path: Path, folder: Path) -> Comparison:
    """Run one case with both solvers."""
    name, content = path.relative_to(folder).as_posix(), read_json(path)
    theirs, refused = _attempt(lambda: program.simulate(Network(content)))
    ours, refused_here = _attempt(lambda: tables.simulate(check_network(Network(content)), "network"))
    rows = 0 if theirs is None else len(theirs)
    if theirs is None or ours is None:
        return Comparison(name, rows, refused=refused, refused_here=refused_here)
    largest, where = difference(ours, theirs)
    own = None if largest <= TOLERANCE else _own_change(content, theirs)
    return Comparison(name, rows, largest, where, own)


def difference(ours: pd.DataFrame, theirs: pd.DataFrame) -> tuple[float, str]:
    """Return the largest difference of two tables, over the largest value of the same unknown, and where it is.

    Infinite if the tables differ in columns, names or gaps. Values below 1e-9 of a column's largest value count as
    zero.
    """
    if list(ours.columns) != list(theirs.columns) or list(ours["name"]) != list(theirs["name"]):
        return math.inf, "columns or names"
    largest, where = 0.0, ""
    for column in theirs.columns.drop("name"):
        a, b = ours[column].to_numpy(float), theirs[column].to_numpy(float)
        if not np.array_equal(np.isnan(a), np.isnan(b)):
            return math.inf, column
        noise = _NOISE * np.nanmax(np.abs(b), initial=0.0)
        for name, rows in theirs.groupby("name", sort=False).indices.items():
            apart = np.nanmax(np.abs(a[rows] - b[rows]), initial=0.0)
            if apart > largest * (scale := max(np.nanmax(np.abs(b[rows]), initial=0.0), noise)):
                largest, where = float(apart / scale) if scale else math.inf, f"{name} {column}"
    return largest, where


def _own_change(content: dict, table: pd.DataFrame) -> float:
    moved = Network(content).deep_copy()
    condition = moved.get("initial_condition", {})
    for name, value in condition.items():
        if isinstance(value, int | float):
            condition[name] = math.nextafter(value, math.inf)
    return difference(program.simulate(moved), table)[0]


def _attempt(solve) -> tuple[pd.DataFrame | None, str]:
    try:
        return solve(), ""
    except (InputError, RuntimeError) as error:
        return None, str(error)


def _steps(path: Path) -> int:
    simulation = read_json(path).get("simulation_parameters", {})
    return simulation.get("number_of_cardiac_cycles", 1) * simulation.get("number_of_time_pts_per_cardiac_cycle", 1)


def _version() -> str:
    name = program.installed()
    return f"{name} {importlib.metadata.version(name)}" if name in program.MODULES else str(name)
