"""Fields of a sample for pictures: mean velocity and pressure in the lumen (VTU), TAWSS and OSI on the wall (VTP)."""

from pathlib import Path

import numpy as np

from coronaryuq.core.io.vtk import write_vtk
from coronaryuq.flow3d.mesh.read_mesh import Domain


def write_fields(folder: Path, sample: str, domain: Domain, fields: dict[str, np.ndarray]) -> None:
    """Write `SAMPLE.vtu` (mean_velocity cm/s, mean_pressure dyn/cm2) and `SAMPLE_wall.vtp` (TAWSS dyn/cm2, OSI)."""
    import pyvista as pv

    lumen = pv.UnstructuredGrid({pv.CellType.TETRA: domain.tets}, domain.points)
    for name in ("mean_velocity", "mean_pressure"):
        lumen.point_data[name] = fields[name]
    faces = fields["wall_faces"]
    used = np.unique(faces)
    wall = pv.PolyData.from_regular_faces(domain.points[used], np.searchsorted(used, faces).astype(int))
    for name in ("TAWSS", "OSI", "mean_pressure"):
        wall.point_data[name] = fields[name][used]
    write_vtk(folder / f"{sample}.vtu", lumen)
    write_vtk(folder / f"{sample}_wall.vtp", wall)
