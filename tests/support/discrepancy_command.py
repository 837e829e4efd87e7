"""Arguments of `coronaryuq discrepancy` for tests."""

import argparse
from pathlib import Path

from coronaryuq.cli import discrepancy as command


def arguments(*words: str | Path) -> argparse.Namespace:
    """Parse the words of a command line."""
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    return parser.parse_args([str(word) for word in words])


def case_words(folder: Path, out: Path) -> list[str | Path]:
    """Return the words of a command line that searches the case in `folder`."""
    files = {"model": "model.json", "measurements": "measurements.csv", "conditions": "conditions.yaml"}
    return [word for name, file in files.items() for word in (f"--{name}", folder / file)] + ["--out", out]


def case_arguments(folder: Path, out: Path) -> argparse.Namespace:
    """Parse a command line that searches the case in `folder` and prints JSON."""
    return arguments(*case_words(folder, out), "--json")
