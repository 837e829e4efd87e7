"""The files that a case refers to: inputs of its rules, and the lumen from which a mesh may be made."""

from pathlib import Path

from coronaryuq.case.description.fields import Description
from coronaryuq.core.errors import InputError


def files_named(path: str | Path, description: Description) -> list[Path]:
    """Return every file and folder that the case at `path` refers to."""
    named: list[str | None] = [description.network, description.outlets, description.targets]
    # Measurements are missing here: the case does not depend on them, only the search does.
    if description.anatomy is not None:
        named.append(description.anatomy.path)
    if description.territory_flows is not None:
        named.append(description.territory_flows.file)
    if description.perfusion is not None:
        perfusion = description.perfusion
        named += [perfusion.file, perfusion.transform, perfusion.label.file if perfusion.label else None]
        if perfusion.registration is not None:
            named += [perfusion.registration.fixed, perfusion.registration.moving]
    return [Path(path).parent / name for name in named if name]


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
