"""Off-screen rendering of meshes: the image, cropped, and the positions of given points in it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike
from vtkmodules.vtkRenderingCore import vtkCoordinate

from coronaryuq.core.io.vtk import silence

silence()  # without a screen VTK warns of a missing X server, and then renders off-screen

Item = tuple[pv.DataSet, dict]
"""A mesh, and options of `pyvista.Plotter.add_mesh`."""

SHADE = {"ambient": 0.65, "diffuse": 0.4}
"""Enough shading to show the shape, but little enough to read colours from their scale."""


@dataclass(frozen=True)
class Camera:
    """View of a scene.

    view: direction from the scene to the viewer; up: vertical direction of the image. focus: centre of the image, and
    height: its height in the scene, cm (parallel projection); without them the whole scene is shown.
    """

    view: Sequence[float] | np.ndarray
    up: Sequence[float] | np.ndarray = (0.0, 0.0, 1.0)
    focus: np.ndarray | None = None
    height: float = 0.0


@dataclass(frozen=True)
class Rendering:
    """image: (height, width, 3), 0 to 255; places: (n, 2), pixels to the right and down, one row per marked point."""

    image: np.ndarray
    places: np.ndarray

    @property
    def aspect(self) -> float:
        """Width over height."""
        return self.image.shape[1] / self.image.shape[0]


def rendered(
    items: Iterable[Item], camera: Camera, marks: ArrayLike = (), size: tuple[int, int] = (1100, 1100), margin: int = 10
) -> Rendering:
    """Render a scene on white, lit from the viewer, so that a colour has the same meaning on all sides.

    marks: (n, 3) points whose positions in the image are returned. size: in pixels, before cropping to `margin` pixels
    around the scene (no cropping if the camera has a focus).
    """
    plotter: Any = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    try:
        plotter.set_background("white")
        plotter.add_light(pv.Light(light_type="headlight"))
        for mesh, look in items:
            plotter.add_mesh(mesh, show_scalar_bar=False, **(SHADE | look))
        if camera.focus is None:
            plotter.view_vector(camera.view, viewup=camera.up)
        else:
            plotter.enable_parallel_projection()
            eye = camera.focus + 5.0 * np.asarray(camera.view)
            plotter.camera_position = [eye, camera.focus, np.asarray(camera.up)]
            plotter.camera.parallel_scale = camera.height / 2.0
        image = np.asarray(plotter.screenshot(return_img=True))[..., :3]
        places = np.array([_place(plotter, mark) for mark in np.asarray(marks).reshape(-1, 3)]).reshape(-1, 2)
    finally:
        plotter.close()
    places[:, 1] = image.shape[0] - places[:, 1]
    if camera.focus is not None:
        return Rendering(image, places)
    drawn = np.any(image < 250, axis=2)
    rows, columns = np.flatnonzero(drawn.any(axis=1)), np.flatnonzero(drawn.any(axis=0))
    top, left = max(rows[0] - margin, 0), max(columns[0] - margin, 0)
    return Rendering(image[top : rows[-1] + margin, left : columns[-1] + margin], places - [left, top])


def _place(plotter: pv.Plotter, point: np.ndarray) -> tuple[float, float]:
    coordinate = vtkCoordinate()
    coordinate.SetCoordinateSystemToWorld()
    coordinate.SetValue(*map(float, point))
    return coordinate.GetComputedDoubleDisplayValue(plotter.renderer)
