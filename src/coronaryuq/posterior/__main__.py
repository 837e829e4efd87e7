"""Run the chains by hand: `mpiexec -n 4 python -m coronaryuq.posterior CASE NETWORK TARGETS CHAINS --seed 1`."""

import argparse
import sys

from pydantic import ValidationError

from coronaryuq.errors import InputError
from coronaryuq.posterior.settings import Settings
from coronaryuq.posterior.stage import sample


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m coronaryuq.posterior", description=__doc__)
    parser.add_argument("case", metavar="CASE", help="case.json")
    parser.add_argument("network", metavar="NETWORK", help="hyperaemia.json, the tuned loop")
    parser.add_argument("targets", metavar="TARGETS", help="targets.json of the perfusion stage")
    parser.add_argument("chains", metavar="CHAINS", help="where to write, .npz; checkpoints go beside it")
    parser.add_argument("--settings", default="{}", metavar="JSON", help="block `posterior` of a configuration")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1, help="threads of each rank")
    given = parser.parse_args()
    try:
        settings = Settings.model_validate_json(given.settings)
        sample(given.case, given.network, given.targets, settings, given.seed, given.chains, given.threads)
    except (InputError, ValidationError) as error:
        print(f"error: {error}", file=sys.stderr)
        return InputError.EXIT_CODE
    return 0


if __name__ == "__main__":
    sys.exit(main())
