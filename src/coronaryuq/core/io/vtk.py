"""VTK files, with the failures of their readers and writers turned into errors; VTK itself says nothing to the user."""

import logging
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import replacing

if TYPE_CHECKING:  # pyvista takes a second to import, and few of the jobs that import this module read VTK files
    import pyvista as pv

XML_SUFFIXES = (".vtu", ".vtp", ".vti", ".vts", ".vtr", ".vtm")
DAMAGED = "damaged, truncated, or of another type than its name says; export it again"


def read_vtk(path: str | Path) -> "pv.DataSet":
    """Read a VTK file.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated, broken, or holds several data sets.
    """
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkObject

    path = Path(path)
    if not path.is_file():
        raise InputError(path, None, None, "no such file")
    # VTK reads a truncated file as an empty mesh and reports it only on its own error channel.
    if path.suffix.lower() in XML_SUFFIXES:
        with open(path, "rb") as opened:
            opened.seek(max(0, path.stat().st_size - 200))
            if b"</VTKFile>" not in opened.read():
                raise InputError(path, None, None, "empty or truncated VTK file; recreate it")
    silence()
    vtkObject.GlobalWarningDisplayOn()  # else the catcher hears nothing
    disabled = logging.root.manager.disable
    logging.disable(logging.CRITICAL)  # pyvista passes on what VTK says
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with pv.VtkErrorCatcher(raise_errors=True, send_to_logging=False):
                data = pv.read(path)
    except Exception:
        raise InputError(path, None, None, DAMAGED) from None
    finally:
        logging.disable(disabled)
        silence()
    if isinstance(data, pv.MultiBlock) and data.n_blocks > 1:
        raise InputError(path, "blocks", data.n_blocks, "several data sets in one file; export one")
    found = data[0] if isinstance(data, pv.MultiBlock) and data.n_blocks else data
    if not isinstance(found, pv.DataSet) or found.n_points == 0:
        raise InputError(path, None, None, "has no points; recreate it")
    return found


def silence() -> None:
    """Keep VTK from printing: what it has to say is for programmers."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkObject

    vtkObject.GlobalWarningDisplayOff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)


def write_vtk(path: str | Path, data: "pv.DataSet") -> None:
    """Write a data set in the format of the suffix."""
    # VTK aborts the process on a full disk. Compressed and in base64, a file takes at most 4/3 of the data.
    with replacing(path, room=1536 * data.GetActualMemorySize() + 65536) as temporary:
        data.save(temporary)
