"""Finished pieces are checked: lost volume, inverted or flat tetrahedra and loose parts are refused."""

import numpy as np
import pytest

from coronaryuq.flow3d.mesh.generation.piece import Piece, check
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from support.mesh_jobs import TETRAHEDRON


def test_a_piece_of_wrong_volume_shape_or_connectivity_is_refused():
    check(TETRAHEDRON, [], enclosed=1 / 6)
    with pytest.raises(MeshError, match="volume"):
        check(TETRAHEDRON, [], enclosed=1.0)
    inverted = Piece(TETRAHEDRON.points, TETRAHEDRON.tets[:, [0, 2, 1, 3]], TETRAHEDRON.triangles, TETRAHEDRON.refs)
    with pytest.raises(MeshError, match="inverted"):
        check(inverted, [], enclosed=1 / 6)
    flat = Piece(TETRAHEDRON.points * [1, 1, 0.01], TETRAHEDRON.tets, TETRAHEDRON.triangles, TETRAHEDRON.refs)
    with pytest.raises(MeshError, match="dihedral"):
        check(flat, [], enclosed=1 / 600)
    two = Piece(
        np.vstack([TETRAHEDRON.points, TETRAHEDRON.points + 5]),
        np.vstack([TETRAHEDRON.tets, TETRAHEDRON.tets + 4]),
        np.vstack([TETRAHEDRON.triangles, TETRAHEDRON.triangles + 4]),
        np.ones(8, int),
    )
    with pytest.raises(MeshError, match="2 parts"):
        check(two, [], enclosed=1 / 3)
