"""`coronaryuq tune`: tune a closed loop to a table of clinical targets."""

import argparse
import sys

from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.stage import tune_files
from coronaryuq.core.command_line import non_negative_int, positive_int
from coronaryuq.core.io.atomic import check_folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = "Tune a closed 0D loop to clinical targets; write rest.json, hyperaemia.json and two tables."
    parser.add_argument("network", metavar="NETWORK.json", help="0D network, svZeroDSolver JSON")
    parser.add_argument(
        "targets", metavar="TARGETS.csv", help="clinical targets, columns name, description, value (or none)"
    )
    parser.add_argument("--out", metavar="DIR", required=True, help="output folder")
    parser.add_argument("--units", choices=("auto", "cgs", "mmHg"), default="auto", help="pressure unit of the network")
    parser.add_argument(
        "--seed", type=non_negative_int, default=1, help="seed of the random starting points (default: 1)"
    )
    parser.add_argument("--threads", type=positive_int, default=1, help="threads of the 0D engine (default: 1)")


def main(chosen: argparse.Namespace) -> int:
    """Run the command, with progress on standard error and the fit on standard output; return the exit code."""
    check_folder(chosen.out)
    tuned = tune_files(
        chosen.network,
        chosen.targets,
        Settings(units=chosen.units),
        chosen.seed,
        chosen.out,
        threads=chosen.threads,
        report=lambda line: print(line, file=sys.stderr),
    )
    columns = ["target", "unit", "measured", "simulated", "relative", "misfit"]
    print(tuned.fit.loc[tuned.fit["tuned"], columns].to_string(index=False, float_format="%.4g"))
    return 0
