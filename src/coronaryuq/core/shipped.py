"""Find the workflow and the configurations that come with the package, in a checkout or an installed wheel."""

from pathlib import Path

import coronaryuq
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.text import visible

VARIABLE = "CORONARYUQ_SNAKEFILE"
"""Environment variable by which the workflow passes the path of its Snakefile to its jobs."""


def home() -> Path:
    """Return the folder with `workflow/` and `config/`: inside an installed package, or the checkout itself."""
    package = Path(coronaryuq.__file__).parent
    inside = package / "_shipped"
    return inside if inside.is_dir() else package.parents[1]


def snakefile() -> Path:
    """Return the path of the Snakefile.

    Raises
    ------
    InputError
        If this installation does not contain the workflow.
    """
    path = home() / "workflow" / "Snakefile"
    if not path.is_file():
        raise InputError(
            path, None, None, "not found; install the wheel, or the checkout with `pip install --editable .`"
        )
    return path


def configurations() -> dict[str, Path]:
    """Return the configurations by name, without `config.yaml`, which is for `snakedeploy`."""
    return {path.stem: path for path in visible(home() / "config", "*.yaml") if path.stem != "config"}


def configuration(name: str) -> Path:
    """Return the path of a configuration: a file, or the name of one that comes with the package.

    Raises
    ------
    InputError
        If there is neither.
    """
    path = Path(name)
    if path.is_file():
        return path
    known = configurations()
    if name in known:
        return known[name]
    raise InputError(name, None, None, f"no such file; the package has the configurations {', '.join(known)}")
