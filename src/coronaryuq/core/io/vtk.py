"""VTK files, with the failures of their readers and writers turned into errors."""

from pathlib import Path
from typing import TYPE_CHECKING

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import replacing

if TYPE_CHECKING:  # pyvista takes a second to import, and few of the jobs that import this module read VTK files
    import pyvista as pv


def read_vtk(path: str | Path) -> "pv.DataSet":
    """Read a VTK file.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated or broken.
    """
    import pyvista as pv

    path = Path(path)
    if not path.is_file():
        raise InputError(path, None, None, "no such file")
    # VTK reads a truncated file as an empty mesh and reports it only on its own error channel.
    if path.suffix in (".vtu", ".vtp", ".vti"):
        with open(path, "rb") as opened:
            opened.seek(max(0, path.stat().st_size - 200))
            if b"</VTKFile>" not in opened.read():
                raise InputError(path, None, None, "empty or truncated VTK file; recreate it")
    try:
        with pv.VtkErrorCatcher(raise_errors=True, send_to_logging=False):
            data = pv.read(path)
    except Exception as error:
        raise InputError(path, None, None, f"not a readable VTK file ({error})") from None
    if not isinstance(data, pv.DataSet) or data.n_points == 0:
        raise InputError(path, None, None, "has no points; recreate it")
    return data


def write_vtk(path: str | Path, data: "pv.DataSet") -> None:
    """Write a data set in the format of the suffix."""
    # VTK aborts the process on a full disk. Compressed and in base64, a file takes at most 4/3 of the data.
    with replacing(path, room=1536 * data.GetActualMemorySize() + 65536) as temporary:
        data.save(temporary)
