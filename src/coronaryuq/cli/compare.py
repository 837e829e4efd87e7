"""`coronaryuq compare A B`: FFR of two campaigns side by side, and the settings in which they differ."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from coronaryuq.campaign.answers import compare
from coronaryuq.campaign.explain import CAMPAIGN
from coronaryuq.case.description.yaml_file import read_yaml


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `coronaryuq compare`."""
    parser.description = "Compare FFR of two campaigns, and list the settings in which they differ."
    parser.add_argument("one", metavar="A", help="results folder of a campaign, results/NAME")
    parser.add_argument("other", metavar="B", help="results folder of another")


def main(options: argparse.Namespace) -> int:
    """Print the comparison."""
    for line in compare(options.one, options.other):
        print(line)
    for name, a, b in differences(*(Path(home, CAMPAIGN) for home in (options.one, options.other))):
        print(f"{name}: {a} → {b}")
    return 0


def differences(one: Path, other: Path) -> list[tuple[str, Any, Any]]:
    """Return the settings in which two configurations differ, with both values; none where a file is missing."""
    if not (one.is_file() and other.is_file()):
        return []
    a, b = (dict(_flat(read_yaml(path, "not a configuration"))) for path in (one, other))
    names = [name for name in dict.fromkeys([*a, *b]) if name != "name"]
    return [(name, a.get(name), b.get(name)) for name in names if a.get(name) != b.get(name)]


def _flat(values: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
