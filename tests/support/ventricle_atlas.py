"""A mean left ventricle where a patient has none: the wall of an atlas, laid rigidly against the patient's arteries."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from coronaryuq.case.anatomy.tree import AORTA, Tree
from coronaryuq.case.perfusion.cells import voxels_as_hexahedra
from coronaryuq.core.errors import InputError

LIFT = 0.1
"""cm of fat between an epicardial artery's wall and the muscle."""
ROLLS = 12
"""Starts of the registration, evenly round the long axis."""


@dataclass(frozen=True)
class Atlas:
    """Closed shells; the epicardium's points and outward normals (n, 3); centre of the base and apex (3,), cm."""

    epicardium: object
    endocardium: object
    points: np.ndarray
    normals: np.ndarray
    base: np.ndarray
    apex: np.ndarray


def read_atlas(path: str | Path, scale: float) -> Atlas:
    """Read a VTK surface of two shells, epicardium and endocardium, open at the base; `scale` is its unit in cm."""
    import pyvista as pv

    if not Path(path).is_file():
        raise InputError(path, None, None, "no such file")
    mesh = pv.read(path).triangulate()
    mesh.clear_data()
    mesh.points = np.asarray(mesh.points, dtype=float) * scale
    shells = [s.extract_surface(algorithm="dataset_surface") for s in mesh.split_bodies()]
    shells = sorted(shells, key=lambda s: -s.length)[:2]
    if len(shells) != 2 or min(s.n_open_edges for s in shells) == 0:
        raise InputError(path, "shells", len(shells), "wanted epicardium and endocardium, both open at the base")
    closed = []
    for shell in shells:
        shell.clear_data()
        closed.append(
            shell.fill_holes(1e3).triangulate().compute_normals(auto_orient_normals=True, split_vertices=False)
        )
    rim = shells[0].extract_feature_edges(
        boundary_edges=True, feature_edges=False, manifold_edges=False, non_manifold_edges=False
    )
    base = np.asarray(rim.points, dtype=float).mean(axis=0)
    points = np.asarray(closed[0].points, dtype=float)
    apex = points[np.argmax(np.linalg.norm(points - base, axis=1))]
    normals = np.asarray(closed[0].point_data["Normals"], dtype=float)
    return Atlas(closed[0], closed[1], points, normals, base, apex)


def atlas_wall(atlas: Atlas, spacing: float = 0.16):
    """Cubes of `spacing` (cm) between the two shells, as a pyvista grid in the atlas's frame."""
    import pyvista as pv

    low, high = atlas.points.min(axis=0) - spacing, atlas.points.max(axis=0) + spacing
    counts = np.ceil((high - low) / spacing).astype(int)
    grid = pv.ImageData(dimensions=counts + 1, spacing=(spacing,) * 3, origin=low)
    centres = pv.PolyData(np.asarray(grid.cell_centers().points, dtype=float))
    outside = _inside(centres, atlas.epicardium) & ~_inside(centres, atlas.endocardium)
    wall = grid.extract_cells(np.flatnonzero(outside))
    wall.clear_data()
    return voxels_as_hexahedra(wall.connectivity("largest"))


def _inside(centres, surface) -> np.ndarray:
    import vtk
    from pyvista import wrap

    enclosed = vtk.vtkSelectEnclosedPoints()
    enclosed.SetInputData(centres)
    enclosed.SetSurfaceData(surface)
    enclosed.SetTolerance(1e-6)
    enclosed.Update()
    return np.asarray(wrap(enclosed.GetOutput()).point_data["SelectedPoints"]) > 0


def register_to_arteries(atlas: Atlas, tree: Tree, on_ventricle: list[str], landmarks: list[str]) -> np.ndarray:
    """Rigid matrix (4, 4) from the atlas's frame to the tree's: arteries on the wall, the base at the aortic root.

    on_ventricle: vessels that run on the left ventricle, whose centrelines shall lie one radius and `LIFT` off the
    epicardium. landmarks: outlets whose ends are nearest to the apex. All other vessels shall only stay outside.
    Least squares with a soft L1 loss from `ROLLS` starts about the long axis; the best one counts.
    """
    laid = [tree[name].resampled(0.3) for name in on_ventricle]
    points = np.concatenate([v.points for v in laid])
    offsets = np.concatenate([v.radii for v in laid]) + LIFT
    off = [v.resampled(0.5) for v in tree if v.name not in on_ventricle and v.branch != AORTA]
    free = np.concatenate([v.points[tree.emergence(v.name) < v.arc] for v in off] or [np.zeros((0, 3))])
    root = tree.root.points[0]
    surface = cKDTree(atlas.points)
    axis = atlas.apex - atlas.base
    length = float(np.linalg.norm(axis))
    axis = axis / length
    apex = np.mean([tree[name].points[-1] for name in landmarks], axis=0)
    towards = (apex - root) / np.linalg.norm(apex - root)

    def distance(places: np.ndarray) -> np.ndarray:
        far, nearest = surface.query(places)
        side = ((places - atlas.points[nearest]) * atlas.normals[nearest]).sum(axis=1)
        return np.where(side < 0, -far, far)

    def residuals(pose: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(pose[:3]).as_matrix()
        back = (points - pose[3:]) @ turn
        # The root stands on the base beside the mitral valve: within 1 cm of its plane and 2 cm off its centre.
        foot = (root - pose[3:]) @ turn - atlas.base
        height, aside = foot @ axis, np.linalg.norm(foot - (foot @ axis) * axis)
        on_base = 3 * np.array([max(abs(height + 0.5) - 0.5, 0.0), max(abs(aside - 2.0) - 0.7, 0.0)])
        outside = np.minimum(distance((free - pose[3:]) @ turn) - LIFT, 0.0)
        return np.concatenate([distance(back) - offsets, np.sqrt(len(points)) * on_base / 3, outside])

    first, _ = Rotation.align_vectors([towards], [axis])
    best = None
    for k in range(ROLLS):
        start = Rotation.from_rotvec(2 * np.pi * k / ROLLS * towards) * first
        shift = apex - 0.5 * towards - start.apply(atlas.apex)
        found = least_squares(
            residuals, np.concatenate([start.as_rotvec(), shift]), loss="soft_l1", f_scale=0.3, max_nfev=60
        )
        if best is None or found.cost < best.cost:
            best = found
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(best.x[:3]).as_matrix(), best.x[3:]
    return matrix
