"""Whether the perfusion map lies where the anatomy is."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.case.description.fields import Perfusion
from coronaryuq.case.perfusion.perfusion_map import Wall
from coronaryuq.case.perfusion.transform_files import read_transform
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MM

DOUBTFUL, FARTHEST = 2.0, 5.0
"""cm: median distance of LV-perfusing outlets to the wall above which map and anatomy may be, or are, misaligned."""
MIRRORED_FROM = 1.0
"""cm: median distance of outlets to the wall above which it is tried whether they are closer with x and y reversed."""


def distances_to_outlets(wall: Wall, outlets: Sequence[CaseOutlet]) -> np.ndarray:
    """Return the distance (n,), cm, of each LV-perfusing outlet from the wall."""
    return _distances(np.asarray(wall.mesh.points, dtype=float), outlets)


def _distances(wall: np.ndarray, outlets: Sequence[CaseOutlet]) -> np.ndarray:
    from scipy.spatial import cKDTree

    points = [outlet.point for outlet in outlets if outlet.perfuses == "LV"]
    return cKDTree(wall).query(np.array(points, dtype=float))[0]


def check_place(file: str | Path, map_: Perfusion, wall: Wall, outlets: Sequence[CaseOutlet]) -> tuple[str, ...]:
    """Return a note if the outlets lie far from the wall; raise InputError if the map is clearly misaligned."""
    distance = float(np.median(distances_to_outlets(wall, outlets)))
    finding = f"the wall lies {distance:.2g} cm (median) from the outlets that perfuse it"
    if map_.placed_by is None and distance > MIRRORED_FROM:
        turned = float(np.median(_distances(np.asarray(wall.mesh.points) * [-1, -1, 1], outlets)))
        if turned < distance / 2:
            remedy = (
                f"{finding}; with x and y reversed it would be {turned:.2g} cm: one of map and anatomy is in RAS, the "
                "other in LPS axes (images are read as LPS). Reverse x and y of one of them: for the map, "
                "perfusion.affine with -1, -1, 1 (and its unit in cm) on the diagonal; if all is right, with 1, 1, 1"
            )
            raise InputError(file, "perfusion.file", map_.file, remedy)
    if map_.transform is not None and distance > MIRRORED_FROM:
        # The map was placed by the inverse of the file's matrix: twice the matrix places it by the matrix itself.
        twice = np.linalg.matrix_power(read_transform(file, map_.transform), 2)
        points = np.asarray(wall.mesh.points) @ twice[:3, :3].T + twice[:3, 3] * MM
        other = float(np.median(_distances(points, outlets)))
        if other < distance / 2:
            remedy = (
                f"{finding}; by its inverse it would be {other:.2g} cm: the file maps from the map to the anatomy. "
                "Save the inverse (3D Slicer: Transforms, Invert, then save)"
            )
            raise InputError(file, "perfusion.transform", map_.transform, remedy)
    if distance > FARTHEST:
        alignment = map_.placed_by
        remedy = f"check the {alignment}" if alignment else "align it with affine, transform or registration"
        raise InputError(
            file, f"perfusion.{alignment or 'file'}", None if alignment else map_.file,
            f"{finding}: map and anatomy are not aligned; {remedy}",
        )  # fmt: skip
    return (f"{finding}: check that map and anatomy are aligned",) if distance > DOUBTFUL else ()
