"""Arguments of `coronaryuq discrepancy` for tests."""

import argparse
from pathlib import Path

from coronaryuq.discrepancy import command


def arguments(*words: str | Path) -> argparse.Namespace:
    """Parse the words of a command line."""
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return parser.parse_args([str(word) for word in words])


def case_arguments(folder: Path, out: Path) -> argparse.Namespace:
    """Parse a command line that searches the case in `folder` and prints JSON."""
    return arguments(
        *("--model", folder / "model.json", "--measurements", folder / "measurements.csv"),
        *("--conditions", folder / "conditions.yaml", "--out", out, "--json"),
    )
