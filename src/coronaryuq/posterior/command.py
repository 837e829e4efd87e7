"""`coronaryuq fit`: find the resistances at which a 0D network shares its flow as a table says."""

import argparse
import json
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Find the resistances at which a tuned 0D network shares its flow among coronary beds as a table says. The "
        "total resistance of the beds in the table is preserved; other beds are not changed."
    )
    parser.add_argument("network", metavar="NETWORK.json", help="0D network in the state of the flows (hyperaemia)")
    parser.add_argument(
        "flows", metavar="FLOWS.csv",
        help="name (of the bed, with or without BC_) and flow, or mbf and volume, or volume; only ratios matter",
    )  # fmt: skip
    parser.add_argument(
        "--hyperaemia", type=float, default=1.0, metavar="FACTOR",
        help="first multiply Ra and Ram of every bed, for a network at rest (paper: 0.24; default 1)",
    )  # fmt: skip
    parser.add_argument("--out", metavar="DIR", help="folder for fractions.csv and fitted.json")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output instead of a table")


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
