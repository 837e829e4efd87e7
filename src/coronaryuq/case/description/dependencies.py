"""The files that a case refers to: inputs of its rules, and the lumen from which a mesh may be made."""

import os
from pathlib import Path

from coronaryuq.case.description.fields import Description
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.text import visible


def files_named(path: str | Path, description: Description) -> list[Path]:
    """Return every file and folder that the case at `path` refers to."""
    return [Path(path).parent / name for name in _by_field(description).values()]


def check_files(path: str | Path, description: Description) -> None:
    """Raise InputError, with the field that names it, for the first file or folder of a case that is not there."""
    for field, name in _by_field(description).items():
        file = Path(path).parent / name
        if not os.path.lexists(file):
            beside = [found.name for found in visible(file.parent)] if file.parent.is_dir() else []
            other = next((found for found in beside if found.lower() == file.name.lower()), None)
            hint = f"; did you mean {other}?" if other else "; paths are relative to the case's file, with / between"
            target = Path(path).resolve()
            if Path(path).is_symlink() and os.path.lexists(target.parent / name):
                hint = f" beside this link; it is beside the file that the link leads to: name {target}"
            raise InputError(path, field, name, f"no such file{hint}")


def _by_field(description: Description) -> dict[str, str]:
    """Return the files and folders that a case names, by field."""
    named: dict[str, str | None] = {"outlets": description.outlets, "targets": description.targets}
    # Measurements are missing here: the case does not depend on them, only the search does.
    named["network"] = description.network
    if description.anatomy is not None:
        named[f"anatomy.{description.anatomy.kind}"] = description.anatomy.path
    if description.territory_flows is not None:
        named["territory_flows.file"] = description.territory_flows.file
    if description.perfusion is not None:
        perfusion = description.perfusion
        named |= {"perfusion.file": perfusion.file, "perfusion.transform": perfusion.transform}
        named["perfusion.label.file"] = perfusion.label.file if perfusion.label else None
        if perfusion.registration is not None:
            named["perfusion.registration.fixed"] = perfusion.registration.fixed
            named["perfusion.registration.moving"] = perfusion.registration.moving
    return {field: name for field, name in named.items() if name}


def measurements(path: str | Path, description: Description) -> tuple[str, str] | None:
    """Return the measurement table and the conditions file of the case at `path`, None if it has none.

    Raises
    ------
    InputError
        If a file does not exist.
    """
    given = description.measurements
    if given is None:
        return None
    for field in ("file", "conditions"):
        if not (Path(path).parent / getattr(given, field)).is_file():
            raise InputError(path, f"measurements.{field}", getattr(given, field), "no such file")
    folder = Path(path).parent
    return (folder / given.file).as_posix(), (folder / given.conditions).as_posix()


def lumen(path: str | Path, description: Description) -> Path:
    """Return the closed surface or mesh-complete folder of a case.

    Raises
    ------
    InputError
        If the anatomy is neither.
    """
    anatomy = description.anatomy
    if anatomy is None or anatomy.kind not in ("surface", "mesh"):
        remedy = "mesh.domain `lumen` needs an anatomy of kind `surface` or `mesh`; choose another domain"
        raise InputError(path, "anatomy", anatomy.kind if anatomy else None, remedy)
    return Path(path).parent / anatomy.path
