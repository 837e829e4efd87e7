"""Where a result comes from: code, libraries, machine, configuration."""

import hashlib
import importlib.metadata
import json
import platform
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import coronaryuq

LIBRARIES = ("numpy", "scipy", "numba", "torch", "pyvista", "snakemake")


def digest(value: Any) -> str:
    """Short SHA-256 of any JSON-able value, independent of key order."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:16]


def checksum(path: str | Path) -> str:
    """SHA-256 of a file's content."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@cache
def code_version() -> str:
    """Package version and, in a git checkout, the commit with `+` when the tree has uncommitted changes."""
    here = Path(__file__).parent
    try:
        commit = subprocess.run(
            ["git", "describe", "--always", "--dirty=+", "--abbrev=12"],
            cwd=here, capture_output=True, text=True, check=True, timeout=10,
        ).stdout.strip()  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return coronaryuq.__version__
    return f"{coronaryuq.__version__} ({commit})"


def stamp(**more: Any) -> dict[str, Any]:
    """Provenance of a result made now; `more` adds configuration block, seeds, input checksums."""
    versions = {}
    for library in LIBRARIES:
        try:
            versions[library] = importlib.metadata.version(library)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {
        "code": code_version(),
        "python": platform.python_version(),
        "libraries": versions,
        "machine": f"{platform.system()} {platform.machine()}",
        **more,
    }
