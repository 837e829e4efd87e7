"""Pin the requirements of pyproject.toml with all extras, and their dependencies, as installed here."""

import sys
import tomllib
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def closure(names: list[Requirement]) -> dict[str, str]:
    """Return the version of every distribution that `names` require here, with extras and environment markers."""
    pinned: dict[str, str] = {}
    waiting = [(wanted, frozenset(wanted.extras)) for wanted in names]
    seen = set()
    while waiting:
        wanted, extras = waiting.pop()
        key = (canonicalize_name(wanted.name), extras)
        if key in seen:
            continue
        seen.add(key)
        found = metadata.distribution(wanted.name)
        pinned[key[0]] = found.version.split("+")[0]
        for line in found.requires or []:
            needed = Requirement(line)
            if needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in extras | {""}):
                waiting.append((needed, frozenset(needed.extras)))
    return pinned


def main(project: str, target: str) -> None:
    table = tomllib.loads(Path(project).read_text())["project"]
    wanted = [*table["dependencies"], *(line for extra in table["optional-dependencies"].values() for line in extra)]
    pinned = closure([Requirement(line) for line in wanted])
    text = "# Made by `make lock` from pyproject.toml; do not edit.\n"
    text += "".join(f"{name}=={version}\n" for name, version in sorted(pinned.items()))
    Path(target).write_text(text)


if __name__ == "__main__":
    main(*sys.argv[1:])
