"""Transform files of ITK, as 3D Slicer, ANTs and elastix save them: the place of a map relative to the anatomy."""

from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.quiet import quiet

SUFFIXES = (".tfm", ".h5", ".txt", ".mat")


def read_transform(file: str | Path, name: str) -> np.ndarray:
    """Return the matrix (4, 4) of a linear transform, LPS positions in mm.

    By ITK's convention it maps positions in the image that stays (the anatomy) to those in the image that is moved onto
    it (the map).

    Parameters
    ----------
    file
        The `case.yaml`, named in errors; `name` is relative to its folder.
    name
        The transform file.

    Raises
    ------
    InputError
        If the file is missing or no transform of ITK, or the transform is not linear, or singular.
    """
    import SimpleITK as sitk

    path, field = Path(file).parent / name, "perfusion.transform"
    if not path.is_file():
        raise InputError(file, field, name, "no such file")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(file, field, name, f"unknown file type; known types: {', '.join(SUFFIXES)}")
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        with quiet():
            transform = sitk.ReadTransform(str(path))
    except RuntimeError:
        remedy = "is no transform file of ITK; in 3D Slicer, save the linear transform as .tfm or .h5"
        raise InputError(file, field, name, remedy) from None
    if transform.GetDimension() != 3:
        raise InputError(file, field, name, f"is a transform in {transform.GetDimension()} dimensions; expected 3")
    if not transform.IsLinear():
        remedy = "is not linear; save the linear part alone, or resample the map onto the anatomy's image"
        raise InputError(file, field, name, remedy)
    corners = np.array([transform.TransformPoint(p) for p in np.vstack([np.zeros(3), np.eye(3)]).tolist()])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = (corners[1:] - corners[0]).T, corners[0]
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-6:
        raise InputError(file, field, name, "its matrix has no inverse; save the transform again")
    return matrix
