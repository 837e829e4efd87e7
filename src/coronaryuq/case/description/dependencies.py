"""The files that a case names: what its rules depend on, and the lumen that a mesh may take as it is."""

from pathlib import Path

from coronaryuq.case.description.fields import Description
from coronaryuq.core.errors import InputError


def files_named(path: str | Path, description: Description) -> list[Path]:
    """Every file and folder that a case names, as paths from where `path` is given from."""
    named = [description.network, description.outlets, description.targets]
    if description.anatomy is not None:
        named.append(getattr(description.anatomy, description.anatomy.kind))
    if description.territory_flows is not None:
        named.append(description.territory_flows.file)
    if description.perfusion is not None:
        perfusion = description.perfusion
        named += [perfusion.file, perfusion.label and perfusion.label.file]
        if perfusion.registration is not None:
            named += [perfusion.registration.fixed, perfusion.registration.moving]
    return [Path(path).parent / name for name in named if name]


def lumen(path: str | Path, description: Description) -> Path:
    """The closed surface or mesh-complete folder of a case; InputError where it has neither."""
    anatomy = description.anatomy
    if anatomy is None or anatomy.kind not in ("surface", "mesh"):
        remedy = "mesh.domain `lumen` needs `surface` or `mesh`; choose another domain"
        raise InputError(path, "anatomy", anatomy and anatomy.kind, remedy)
    return Path(path).parent / getattr(anatomy, anatomy.kind)
