"""Run 3D samples manually: `mpiexec -n 4 python -m coronaryuq.flow3d CASE NETWORK MESH SAMPLES RECORDS --mpi`."""

import argparse
import sys
from pathlib import Path

from coronaryuq.core.command_line import run_with_settings
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.ranks import Ranks
from coronaryuq.flow3d.adapter import Batch, Outputs, Processes
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.stage import run_batch


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m coronaryuq.flow3d", description=__doc__)
    parser.add_argument("case", metavar="CASE", help="case.json")
    parser.add_argument("network", metavar="NETWORK", help="hyperaemia.json, the tuned loop")
    parser.add_argument("mesh", metavar="MESH", help="folder with mesh.json and mesh-complete/")
    parser.add_argument("samples", metavar="SAMPLES", help="table of θ, such as samples/pilot.csv")
    parser.add_argument(
        "records", metavar="RECORDS", help="output file, .jsonl; checkpoints and fields are written to its folder"
    )
    parser.add_argument("--settings", default="{}", metavar="JSON", help="block `flow3d` of a configuration")
    parser.add_argument(
        "--tree", metavar="TREE", help="tree.vtp of the case; needed if its lumen is uncertain or narrowed"
    )
    parser.add_argument("--first", type=int, default=0, help="first row of the table to run, from 0")
    parser.add_argument("--count", type=int, help="number of rows (default: all that follow)")
    parser.add_argument("--mpi", action="store_true", help="under mpiexec or srun: divide the samples among its ranks")
    arguments = parser.parse_args()
    mesh, records = Path(arguments.mesh), Path(arguments.records)

    def work(settings: Settings) -> None:
        count = arguments.count or len(read_csv(arguments.samples, ("sample",))) - arguments.first
        batch = Batch(
            arguments.case, arguments.network, mesh / "mesh-complete", mesh / "mesh.json",
            arguments.samples, arguments.first, count, arguments.tree,
        )  # fmt: skip
        outputs = Outputs(records, records.parent / "checkpoints", records.parent / "fields")
        run_batch(batch, "ensemble", settings, outputs, Processes(Ranks.by_hand(arguments.mpi)))

    return run_with_settings(work, Settings, arguments.settings)


if __name__ == "__main__":
    sys.exit(main())
