"""The entry of a perfusion map in `case.yaml`: the units in which its values and lengths make sense."""

from pathlib import Path
from typing import Any

from coronaryuq.case.description.fields import Perfusion
from coronaryuq.case.perfusion.images import IMAGE_SUFFIXES
from coronaryuq.case.perfusion.perfusion_map import read_wall
from coronaryuq.case.settings import Settings
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import TISSUE_DENSITY

UNITS = ("mL/min/g", "mL/min/100g", "mL/s/g")
"""Per 100 mL and per 100 g differ by 5 %, which no magnitude tells."""


def perfusion_entry(path: Path, settings: Settings) -> dict[str, Any]:
    """Return `perfusion` of `case.yaml` for a map.

    Parameters
    ----------
    path
        The map.
    settings
        Settings of the case stage.

    Raises
    ------
    InputError
        If it cannot be read in any unit; the fault in its most usual one.
    """
    if not path.is_file():
        raise InputError(path, None, None, "no such file")
    image = path.name.lower().endswith(IMAGE_SUFFIXES)
    fault: InputError | None = None
    for length_unit in ("mm",) if image else ("cm", "mm", "m"):
        for unit in UNITS:
            values = {"file": str(path), "unit": unit, "length_unit": length_unit}
            map_ = Perfusion.model_validate(values | {"file": str(path.absolute())})
            try:
                read_wall(path.absolute(), map_, TISSUE_DENSITY, settings.wall_cells)
            except InputError as error:
                fault = fault or error
                if error.field not in ("perfusion.unit", "perfusion.length_unit"):
                    raise error
                continue
            return values
    assert fault is not None
    raise fault
