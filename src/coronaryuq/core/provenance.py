"""Record where a result comes from: code, libraries, machine, configuration."""

import ast
import gc
import hashlib
import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import coronaryuq

if TYPE_CHECKING:
    import grimp

LIBRARIES = {
    "numpy": "numpy", "scipy": "scipy", "numba": "numba", "torch": "torch", "pandas": "pandas", "pyarrow": "pyarrow",
    "scikit-learn": "sklearn", "arviz-base": "arviz_base", "arviz-stats": "arviz_stats", "snakemake": "snakemake",
    "pydantic": "pydantic", "pyvista": "pyvista", "tetgen": "tetgen", "manifold3d": "manifold3d", "mmgpy": "mmgpy",
    "SimpleITK": "SimpleITK", "mpi4py": "mpi4py",
}  # fmt: skip
"""Distributions that a campaign uses, with the module of each."""
STAMPED = ("numpy", "scipy", "numba", "torch", "pyvista", "snakemake")


def digest(value: Any) -> str:
    """Short SHA-256 of any JSON-able value, independent of key order."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:16]


def checksum(path: str | Path) -> str:
    """SHA-256 of a file's content."""
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


@cache
def code_version() -> str:
    """Package version and, in a git checkout of the project, the commit with `+` for uncommitted changes.

    The repository must be the project's own: one around a copy, or one that the environment names, says nothing of it.
    """
    package = Path(coronaryuq.__file__).resolve().parent
    try:
        _git(package, "ls-files", "--error-unmatch", "__init__.py")
        if Path(_git(package, "rev-parse", "--show-toplevel")).resolve() != package.parents[1]:
            return coronaryuq.__version__
        commit = _git(package, "describe", "--always", "--dirty=+", "--abbrev=12")
    except (OSError, ValueError, subprocess.SubprocessError):
        return coronaryuq.__version__
    return f"{coronaryuq.__version__} ({commit})"


def _git(folder: Path, *words: str) -> str:
    """Return the output of git in a folder, whatever repository the environment names."""
    own = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    command = ["git", *words]
    done = subprocess.run(command, cwd=folder, env=own, capture_output=True, encoding="utf-8", check=True, timeout=10)
    return done.stdout.strip()


def versions(libraries: Iterable[str] = tuple(LIBRARIES)) -> dict[str, str]:
    """Return the installed versions of libraries, those of a campaign by default."""
    installed = {}
    for name in libraries:
        with suppress(importlib.metadata.PackageNotFoundError):
            installed[name] = importlib.metadata.version(name)
    return installed


def stamp(**more: Any) -> dict[str, Any]:
    """Provenance of a result made now; `more` adds configuration block, seeds, input checksums."""
    return {
        "code": code_version(),
        "python": platform.python_version(),
        "libraries": versions(STAMPED),
        "machine": f"{platform.system()} {platform.machine()}",
        **more,
    }


@cache
def closure(*modules: str) -> tuple[str, ...]:
    """Return the names of all modules of the package that the given modules import, themselves included.

    Imports inside functions count, and so do the `__init__` files of all packages on the way. Imports for type checking
    only do not.

    Raises
    ------
    ValueError
        If a module does not exist.
    """
    graph = _import_graph()
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        if name not in graph.modules:
            raise ValueError(f"no module {name} in {coronaryuq.__name__}")
        found.add(name)
        waiting += graph.find_modules_directly_imported_by(name)
        waiting += [name.rpartition(".")[0]] * ("." in name)
    return tuple(sorted(found))


@cache
def code_digest(*modules: str) -> str:
    """Return one digest of the code behind the given modules, for rules whose results depend on it.

    It covers the import closure and the data files next to its modules, such as templates. Comments, docstrings and
    formatting do not change it, nor do edits of modules that are not imported.
    """
    code = [(name, syntax_digest(_file(name))) for name in closure(*modules)]
    return digest([code, [(path.name, checksum(path)) for path in data_files(*modules)]])


def data_files(*modules: str) -> list[Path]:
    """Return the files next to the modules of an import closure that are not Python, such as templates."""
    folders = {_file(name).parent for name in closure(*modules)}
    return sorted(path for folder in folders for path in folder.iterdir() if path.is_file() and _is_data(path))


@cache
def _import_graph() -> "grimp.ImportGraph":
    import grimp

    return grimp.build_graph(coronaryuq.__name__, cache_dir=None, exclude_type_checking_imports=True)


def _is_data(path: Path) -> bool:
    return path.suffix not in (".py", ".pyc") and not path.name.startswith(".")


def _file(module: str) -> Path:
    base = Path(coronaryuq.__file__).parent.joinpath(*module.split(".")[1:])
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


@cache
def syntax_digest(path: Path) -> str:
    """Return a checksum of a module's syntax tree without docstrings, which comments and formatting do not change."""
    collects = gc.isenabled()
    gc.disable()  # which would walk the growing tree repeatedly, at three times the cost
    try:
        tree = ast.parse(path.read_bytes())
        for node in ast.walk(tree):
            body = getattr(node, "body", None)
            if isinstance(body, list):
                setattr(node, "body", [statement for statement in body if not _is_docstring(statement)])  # noqa: B010
        return hashlib.sha256(ast.dump(tree).encode()).hexdigest()
    finally:
        if collects:
            gc.enable()


def _is_docstring(statement: ast.stmt) -> bool:
    value = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(value, ast.Constant) and isinstance(value.value, str)
