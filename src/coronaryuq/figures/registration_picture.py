"""Where a registered perfusion map lies on the scan that shows the anatomy."""

from pathlib import Path

import numpy as np

from coronaryuq.case.perfusion.images import Image, read_image
from coronaryuq.case.perfusion.perfusion_map import Wall
from coronaryuq.figures.style import Output, saved

AROUND = 4.0
"""cm of the scan that are shown around the wall."""
OUTLINE = "#FF5A1F"
WIDTH = 8.0
"""Inches."""


def registration_picture(scan: str | Path, unit: float, wall: Wall, output: Output) -> None:
    """Draw three sections of a scan through the middle of the wall, with the outline of the wall.

    Parameters
    ----------
    scan
        The fixed image of the registration.
    unit
        Its length unit in cm.
    wall
        The wall as it was placed, cm.
    output
        PNG or SVG files.
    """
    image = read_image(scan)
    spacing = np.linalg.norm(image.matrix[:3, :3], axis=0) * unit
    grid = wall.mesh.copy()
    grid.points = _index(image, np.asarray(grid.points, dtype=float) / unit) * spacing
    points = np.asarray(grid.points)
    low, high = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND
    middle = points.mean(axis=0)
    with saved(output, ncols=3, figsize=(WIDTH, 3.2)) as (figure, panels):
        for axis, across in zip(panels, range(3), strict=True):
            shown = [k for k in range(3) if k != across]
            number = int(np.clip(round(middle[across] / spacing[across]), 0, image.values.shape[across] - 1))
            section = np.take(image.values, number, axis=across)
            box = [slice(*_cut(low[k], high[k], spacing[k], image.values.shape[k])) for k in shown]
            inside = section[box[0], box[1]]
            darkest, brightest = np.nanquantile(inside, [0.01, 0.99])
            extent = [edge * spacing[k] for k, cut in zip(shown, box, strict=True) for edge in (cut.start, cut.stop)]
            axis.imshow(inside.T, origin="lower", extent=extent, cmap="gray", vmin=darkest, vmax=brightest)
            normal = np.eye(3)[across]
            for line in _outline(grid, normal, middle):
                axis.plot(*line[:, shown].T, color=OUTLINE, lw=1.2)
            axis.set_axis_off()
        figure.suptitle(f"{Path(scan).name} with the outline of the perfusion map's wall", fontsize=8)


def _index(image: Image, positions: np.ndarray) -> np.ndarray:
    inverse = np.linalg.inv(image.matrix)
    return positions @ inverse[:3, :3].T + inverse[:3, 3]


def _cut(low: float, high: float, spacing: float, count: int) -> tuple[int, int]:
    first, last = np.clip([low / spacing, high / spacing + 1], 0, count).astype(int)
    return int(first), int(max(last, first + 1))


def _outline(grid, normal: np.ndarray, middle: np.ndarray) -> list[np.ndarray]:
    """Return the boundary of a plane section of the wall as pieces (2, 3)."""
    section = grid.slice(normal=normal, origin=middle)
    if not section.n_cells:
        return []
    edges = section.clean().extract_feature_edges(
        boundary_edges=True, feature_edges=False, manifold_edges=False, non_manifold_edges=False
    )
    return [np.asarray(edges.points)[line] for line in edges.lines.reshape(-1, 3)[:, 1:]] if edges.n_lines else []
