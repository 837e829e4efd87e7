"""Search of one case given by files, for the command and the workflow."""

import sys
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.core import units
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference.read_problem import read_problem
from coronaryuq.discrepancy.result import write
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.discrepancy.selection.search import discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.searchable import check_searchable
from coronaryuq.zerod.network.read import print_notes, read_network

UNNAMED = ("model", "network")
"""Names by which error messages refer to the network if its file is unknown."""


def search(
    model, measurements, conditions, settings: Settings, seed: int, out_dir: str | Path, threads: int = 1
) -> None:
    """Search one case and write the results into `out_dir`."""
    search_case(model, measurements, conditions, Path(out_dir), settings.model_copy(update={"threads": threads}), seed)


# The matrices are small: linear-algebra threads would only slow it down, and rounding would depend on their number.
@threadpool_limits.wrap(limits=1)
def search_case(
    model: str | Path, measurements: str | Path, conditions: str | Path, out: Path, settings: Settings, seed: int
) -> dict:
    """Search one case with progress on standard error, write the results and return the summary.

    Parameters
    ----------
    model, measurements, conditions
        Network (svZeroDSolver JSON), measurement table (CSV) and conditions file (YAML).
    out
        Folder for the results.
    settings, seed
        Settings of the search; seed of the intervals.

    Returns
    -------
    dict
        Content of `discrepancy.json`.

    Raises
    ------
    InputError
        If a file is invalid or the model does not run, before anything is written.
    """
    return write.write(searched(model, measurements, conditions, settings, seed), out)


def searched(
    model: str | Path, measurements: str | Path, conditions: str | Path, settings: Settings, seed: int
) -> Discovery:
    """Search one case as `search_case`, and write nothing."""
    network, known = read_network(model), read_conditions(conditions)
    print_notes(network, model)
    check_searchable(network, model)
    try:
        problem = read_problem(network, measurements, known, conditions, settings, _report)
    except InputError as error:
        if error.file in UNNAMED:
            raise InputError(model, error.field, error.value, error.remedy) from None
        raise
    for name in (one for one in known if one not in problem.forward.conditions):
        _report(f"note: {conditions}: {name}: no measurements of this condition; it is not used")
    root_pressure = problem.forward.anatomy.pressure * problem.forward.pressure_factor / units.MMHG
    _report(f"root pressure of the unmodified model: {root_pressure:.3g} mmHg")
    try:
        return discover(problem, seed, report=_report)
    except FloatingPointError as error:
        residual = problem.whitened([(np.zeros(problem.count), PLAIN)])[0]
        failed = ", ".join(dict.fromkeys(problem.condition[~np.isfinite(residual)]))
        where = failed or "any condition after recalibration"
        remedy = f"the model does not run under {where}; check what the conditions file changes there"
        raise InputError(conditions, failed or None, None, remedy) from error


def _report(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
