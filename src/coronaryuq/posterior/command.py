"""`coronaryuq fit`: fit bed resistances of a 0D network to the flow fractions of a table."""

import argparse
import json
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Find the bed resistances at which a tuned 0D network divides coronary flow in the proportions of a table. The "
        "total resistance of the beds in the table is preserved; other beds are not changed."
    )
    parser.add_argument(
        "network", metavar="NETWORK.json", help="0D network in the state in which the flows were measured (hyperaemia)"
    )
    parser.add_argument(
        "flows", metavar="FLOWS.csv",
        help="columns: name of the bed (with or without BC_), and flow, or mbf and volume, or volume; "
"only ratios matter",
    )  # fmt: skip
    parser.add_argument(
        "--hyperaemia", type=float, default=1.0, metavar="FACTOR",
        help="for a network at rest: multiply Ra and Ram of every bed first (paper: 0.24; default: 1)",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", help="output folder for fractions.csv and fitted.json")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of a table")


def main(chosen: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from coronaryuq.core.io.atomic import check_folder
    from coronaryuq.core.io.tables import write_csv
    from coronaryuq.posterior.model.flow_table import fit_table
    from coronaryuq.zerod.network.read import print_notes, read_network, write_network

    if chosen.out:
        check_folder(chosen.out)
    network = read_network(chosen.network)
    print_notes(network, chosen.network)
    table, fitted = fit_table(network, chosen.network, chosen.flows, chosen.hyperaemia)
    if chosen.out:
        write_csv(Path(chosen.out) / "fractions.csv", table)
        write_network(Path(chosen.out) / "fitted.json", fitted)
    worst = float(table["fitted_error"].abs().max())
    if chosen.json:
        print(json.dumps({"largest_fraction_error": worst, "beds": table.to_dict("records")}))
    else:
        print(table.to_string(index=False, float_format="%.5g"))
        print(f"largest error of a fraction: {100 * worst:.2g} %")
    return 0
