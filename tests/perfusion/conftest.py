"""A small left ventricle: half an ellipsoidal shell of tetrahedra, with outlets around it."""

import numpy as np
import pytest
import pyvista

from support.case_files import write_case_json


def shell(layers: int = 3, around: int = 40, along: int = 20) -> pyvista.UnstructuredGrid:
    """Wall of a prolate half ellipsoid (cm), hexahedra cut into tetrahedra, with `Volume` (cm3) and `MBF` (mL/s/g)."""
    s, t, p = np.meshgrid(
        np.linspace(0.8, 1.1, layers + 1),
        np.linspace(0.15, np.pi * 0.6, along + 1),
        np.linspace(0, 2 * np.pi, around + 1),
        indexing="ij",
    )
    grid = pyvista.StructuredGrid(
        3.0 * s * np.sin(t) * np.cos(p), 3.0 * s * np.sin(t) * np.sin(p), -5.0 * s * np.cos(t)
    )
    mesh = grid.triangulate()
    mesh.clear_data()
    mesh.cell_data["Volume"] = np.abs(mesh.compute_cell_sizes()["Volume"])
    height = mesh.cell_centers().points[:, 2]
    mesh.cell_data["MBF"] = (2.2 + 0.1 * height) / 60.0
    return mesh


def outlets(count: int = 6) -> list[dict]:
    angle = np.arange(count) * 2.399963
    height = np.linspace(-4.5, 1.0, count)
    radius = 3.4 * np.sqrt(np.clip(1 - (height / 5.6) ** 2, 0.05, 1))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    return [
        {"name": f"out{i}", "vessel": f"vessel{i}", "point": point.tolist(), "radius": 0.05 + 0.01 * i}
        for i, point in enumerate(points)
    ]


@pytest.fixture
def ventricle(tmp_path):
    """Paths of `case.json` and `lv.vtu` in a temporary folder."""
    mesh = shell()
    mesh.save(tmp_path / "lv.vtu")
    right = {**outlets(1)[0], "name": "right", "perfuses": "RV"}
    case = write_case_json(tmp_path / "case.json", outlets=[*outlets(), right])
    return case, tmp_path / "lv.vtu"
