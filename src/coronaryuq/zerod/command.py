"""`coronaryuq solve`: solve one 0D network in time, with svZeroDSolver's input and output formats."""

import argparse
import sys
from pathlib import Path

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import check_file
from coronaryuq.core.io.tables import write_csv
from coronaryuq.zerod.network.read import print_notes, read_network
from coronaryuq.zerod.svzerodsolver.tables import simulate

DEFAULT_TABLE = "output.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments, which are those of `svzerodsolver`."""
    parser.description = (
        "Solve a 0D network in time with its own simulation_parameters and write svZeroDSolver's table. "
        "Arguments, columns and exit codes (0, or 1 on failure) are those of svzerodsolver."
    )
    parser.add_argument("network", metavar="NETWORK.json", help="0D network, svZeroDSolver JSON")
    parser.add_argument(
        "table",
        metavar="TABLE.csv",
        nargs="?",
        help=f"output table, by vessel or by variable as set in the network (default: {DEFAULT_TABLE} in its folder)",
    )


def main(chosen: argparse.Namespace) -> int:
    """Run the command; return svzerodsolver's exit codes: 0, or 1 after one line on standard error."""
    try:
        _solve(chosen.network, chosen.table)
    except (InputError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def _solve(source: str, target: str | None) -> None:
    if target is None:
        target = str(Path(source).parent / DEFAULT_TABLE)
        print(f"Output will be written to '{target}'.", file=sys.stderr)
    if check_file(target).resolve() == Path(source).resolve():
        raise InputError("command line", "TABLE.csv", target, "is the network file; choose another file")
    network = read_network(source)
    print_notes(network, source)
    try:
        table = simulate(network, source)
    except RuntimeError as error:
        raise RuntimeError(f"{source}: {error}") from error
    write_csv(target, table)
