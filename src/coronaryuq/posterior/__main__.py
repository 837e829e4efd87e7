"""Run the chains manually: `mpiexec -n 4 python -m coronaryuq.posterior CASE NETWORK TARGETS CHAINS --mpi`."""

import argparse
import sys

from coronaryuq.core.command_line import run_with_settings
from coronaryuq.core.ranks import Ranks
from coronaryuq.posterior.settings import Settings
from coronaryuq.posterior.stage import Extent, sample


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m coronaryuq.posterior", description=__doc__)
    parser.add_argument("case", metavar="CASE", help="case.json")
    parser.add_argument("network", metavar="NETWORK", help="hyperaemia.json, the tuned loop")
    parser.add_argument("targets", metavar="TARGETS", help="targets.json of the perfusion stage")
    parser.add_argument("chains", metavar="CHAINS", help="output file, .npz; checkpoints are written to its folder")
    parser.add_argument("--settings", default="{}", metavar="JSON", help="block `posterior` of a configuration")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--length", type=int, default=1, help="of the chains, over that which the settings give")
    parser.add_argument("--before", metavar="CHAINS", help="shorter chains of the same inputs, to continue")
    parser.add_argument("--threads", type=int, default=1, help="threads of each rank")
    parser.add_argument("--mpi", action="store_true", help="under mpiexec or srun: divide the 0D runs among its ranks")
    arguments = parser.parse_args()

    def work(settings: Settings) -> None:
        files = arguments.case, arguments.network, arguments.targets
        sample(
            *files,
            settings,
            arguments.seed,
            arguments.chains,
            Ranks.by_hand(arguments.mpi, arguments.threads),
            Extent(arguments.length, arguments.before),
        )

    return run_with_settings(work, Settings, arguments.settings)


if __name__ == "__main__":
    sys.exit(main())
