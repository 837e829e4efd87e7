"""Where a result comes from: code, libraries, machine, configuration."""

import ast
import hashlib
import importlib.metadata
import json
import platform
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import coronaryuq

IMPORT = re.compile(r"^[ \t]*((?:from|import)[ \t][^\n(]*(?:\([^)]*\))?)", re.MULTILINE)
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
    here = Path(coronaryuq.__file__).parent
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


def sources(*modules: str) -> list[Path]:
    """Every file of the package that the given modules import, directly or through others, themselves included.

    A workflow names these as inputs of a rule, so that an edit anywhere behind the rule makes its results stale.
    Imports inside functions count; so do the packages' `__init__` files.
    """
    found: dict[str, Path] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        path = _module_file(name)
        if name in found or path is None:
            continue
        found[name] = path
        waiting += _imported(path)
        if "." in name:
            waiting.append(name.rpartition(".")[0])
    return sorted(found.values())


@cache
def _module_file(name: str) -> Path | None:
    base = Path(coronaryuq.__file__).parent.joinpath(*name.split(".")[1:])
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None


@cache
def _imported(path: Path) -> tuple[str, ...]:
    """Modules of the package that a file imports, anywhere in it.

    Only statements that may be imports are parsed: every job of a campaign asks this of every file.
    """
    text = path.read_text(encoding="utf-8")
    try:
        trees = [ast.parse(statement) for statement in IMPORT.findall(text)]
    except SyntaxError:
        trees = [ast.parse(text)]
    return tuple(dict.fromkeys(name for tree in trees for name in _names(tree)))


def _names(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "coronaryuq")
