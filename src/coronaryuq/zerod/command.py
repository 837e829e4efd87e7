"""`coronaryuq solve`: one 0D network marched in time, svZeroDSolver's input in, its table out."""

import argparse
import sys
from pathlib import Path

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import check_file
from coronaryuq.core.io.tables import write_csv
from coronaryuq.zerod.network.read import note_negative_resistances, read_network
from coronaryuq.zerod.svzerodsolver.tables import simulate


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "March a 0D network as its simulation_parameters say and write svZeroDSolver's table."
    parser.add_argument("network", metavar="NETWORK.json", help="0D network, svZeroDSolver JSON")
    parser.add_argument("table", metavar="TABLE.csv", help="by vessel or by variable, as the network says")


def main(chosen: argparse.Namespace) -> int:
    """Run the command; returns the exit code, 1 where Newton's method does not converge. `InputError` for bad input."""
    if check_file(chosen.table).resolve() == Path(chosen.network).resolve():
        raise InputError("command line", "TABLE.csv", chosen.table, "is the network itself; name another file")
    network = read_network(chosen.network)
    note_negative_resistances(network, chosen.network)
    try:
        table = simulate(network, chosen.network)
    except RuntimeError as error:
        print(f"error: {chosen.network}: {error}", file=sys.stderr)
        return 1
    write_csv(chosen.table, table)
    return 0
