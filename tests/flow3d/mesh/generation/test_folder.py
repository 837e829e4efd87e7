"""mesh-complete folders: what is written is read again, and what is wrong is said in one line."""

import shutil

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.generation import folder, quality


@pytest.fixture
def copied(stenosed, tmp_path):
    shutil.copytree(stenosed[0] / "mesh-complete", tmp_path / "mesh-complete")
    return tmp_path / "mesh-complete"


def test_faces_cover_the_boundary_once(stenosed):
    mesh = folder.read(stenosed[0] / "mesh-complete")
    outer, owner = quality.boundary(mesh.tets)
    assert len(outer) == len(mesh.triangles)
    assert np.array_equal(owner, mesh.owner)
    assert set(np.unique(mesh.face)) == set(mesh.names) == {1, 2, 3}
    total = quality.areas(mesh.points, mesh.triangles).sum(axis=0)
    assert np.abs(total).max() < 1e-12


def test_surfaces_have_the_arrays_that_simvascular_reads(stenosed):
    out = stenosed[0] / "mesh-complete"
    grid = pv.read(out / folder.VOLUME)
    assert grid.point_data["GlobalNodeID"].tolist() == list(range(1, grid.n_points + 1))
    assert grid.cell_data["GlobalElementID"].tolist() == list(range(1, grid.n_cells + 1))
    for path in [out / folder.EXTERIOR, out / folder.WALLS, *sorted((out / folder.SURFACES).glob("*.vtp"))]:
        surface = pv.read(path)
        nodes = surface.point_data["GlobalNodeID"] - 1
        assert nodes.dtype == np.int32
        np.testing.assert_array_equal(surface.points, grid.points[nodes])
        tets = grid.cells_dict[pv.CellType.TETRA][surface.cell_data["GlobalElementID"] - 1]
        for triangle, tet in zip(nodes[surface.regular_faces], tets, strict=True):
            assert set(triangle) <= set(tet)
        assert "ModelFaceID" in surface.cell_data


def test_files_are_readable_by_old_vtk(stenosed):
    for path in (stenosed[0] / "mesh-complete").rglob("*.vt?"):
        head = path.read_bytes()[:200]
        assert b'version="0.1"' in head or b'version="1.0"' in head, path.name
        assert b'header_type="UInt32"' in head or b'header_type="UInt64"' in head


def test_an_unpacked_archive_equals_the_folder(stenosed, tmp_path):
    folder.unpack(stenosed[0] / "mesh-complete.zip", tmp_path)
    for path in (stenosed[0] / "mesh-complete").rglob("*.vt?"):
        again = tmp_path / "mesh-complete" / path.relative_to(stenosed[0] / "mesh-complete")
        assert again.read_bytes() == path.read_bytes()


def test_node_ids_may_be_in_any_order(copied):
    path = copied / folder.VOLUME
    grid = pv.read(path)
    order = np.arange(grid.n_points)[::-1]
    tets = np.argsort(order)[grid.cells_dict[pv.CellType.TETRA]]
    turned = pv.UnstructuredGrid({pv.CellType.TETRA: tets}, grid.points[order])
    turned.point_data["GlobalNodeID"] = grid.point_data["GlobalNodeID"][order]
    turned.save(path)
    mesh = folder.read(copied)
    assert len(mesh.triangles) == len(quality.boundary(mesh.tets)[0])


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        (lambda out: (out / folder.VOLUME).unlink(), "no such file"),
        (lambda out: (out / folder.SURFACES / "wall.vtp").unlink(), "belong to no face"),
        (lambda out: shutil.rmtree(out / folder.SURFACES), "every face needs one"),
        (lambda out: _drop(out / folder.SURFACES / "inlet_LAD.vtp", "ModelFaceID"), "array missing"),
        (lambda out: _renumber(out / folder.SURFACES / "inlet_LAD.vtp"), "also used by"),
        (lambda out: _shift(out / folder.SURFACES / "inlet_LAD.vtp"), "does not lie on the boundary"),
        (lambda out: (out / folder.VOLUME).write_text("<VTKFile"), "empty or truncated"),
    ],
)
def test_errors_name_the_fault(copied, harm, message):
    harm(copied)
    with pytest.raises(InputError, match=message) as error:
        folder.read(copied)
    assert "\n" not in str(error.value)


def _drop(path, name):
    surface = pv.read(path)
    del surface.cell_data[name]
    surface.save(path)


def _renumber(path):
    surface = pv.read(path)
    surface.cell_data["ModelFaceID"] = np.full(surface.n_cells, 3, np.int32)
    surface.save(path)


def _shift(path):
    surface = pv.read(path)
    surface.point_data["GlobalNodeID"] = np.roll(surface.point_data["GlobalNodeID"], 1) * 0 + 1
    surface.save(path)
