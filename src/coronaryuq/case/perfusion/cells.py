"""Voxel cells as hexahedra: VTK assumes that voxels lie along the axes, so a rotated one has a wrong volume."""

import numpy as np

AROUND = [0, 1, 3, 2, 4, 5, 7, 6]
"""Corners of a VTK voxel in the order of a hexahedron's."""


def voxels_as_hexahedra(grid):
    """Return the pyvista grid with voxels turned into hexahedra; data and all other cells stay as they are."""
    import pyvista as pv

    grid = pv.UnstructuredGrid(grid)
    offsets = np.array(grid.cell_offsets)
    kinds, connectivity = np.array(grid.celltypes), np.array(grid.cell_connectivity)
    starts = offsets[:-1][kinds == pv.CellType.VOXEL]
    corners = starts[:, None] + np.arange(8)
    connectivity[corners] = connectivity[corners][:, AROUND]
    kinds[kinds == pv.CellType.VOXEL] = pv.CellType.HEXAHEDRON
    sizes = np.diff(offsets)
    cells = np.insert(connectivity, offsets[:-1], sizes)
    converted = pv.UnstructuredGrid(cells, kinds, np.asarray(grid.points, dtype=float))
    converted.point_data.update(grid.point_data)
    converted.cell_data.update(grid.cell_data)
    return converted
