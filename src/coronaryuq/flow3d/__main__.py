"""Run 3D samples by hand: `mpiexec -n 4 python -m coronaryuq.flow3d CASE NETWORK MESH SAMPLES RECORDS --count 500`."""

import argparse
import sys
from pathlib import Path

from coronaryuq.core.command_line import run_with_settings
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.ranks import Ranks
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.stage import run_batch


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m coronaryuq.flow3d", description=__doc__)
    parser.add_argument("case", metavar="CASE", help="case.json")
    parser.add_argument("network", metavar="NETWORK", help="hyperaemia.json, the tuned loop")
    parser.add_argument("mesh", metavar="MESH", help="folder with mesh.json and mesh-complete/")
    parser.add_argument("samples", metavar="SAMPLES", help="table of θ, such as samples/pilot.csv")
    parser.add_argument(
        "records", metavar="RECORDS", help="where to write, .jsonl; checkpoints and fields go beside it"
    )
    parser.add_argument("--settings", default="{}", metavar="JSON", help="block `flow3d` of a configuration")
    parser.add_argument("--first", type=int, default=0, help="first row of the table to run, from 0")
    parser.add_argument("--count", type=int, help="how many rows; default: all that follow")
    given = parser.parse_args()
    mesh, out = Path(given.mesh), Path(given.records)

    def work(settings: Settings) -> None:
        count = given.count or len(read_csv(given.samples, ("sample",))) - given.first
        run_batch(
            given.case, given.network, mesh / "mesh-complete", mesh / "mesh.json", given.samples, given.first, count,
            settings, out, out.parent / "checkpoints", out.parent / "fields", Ranks.from_launcher(),
        )  # fmt: skip

    return run_with_settings(work, Settings, given.settings)


if __name__ == "__main__":
    sys.exit(main())
