"""The error of the mesh: from a study of this mesh, or a sentence that there is none."""

import pytest

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import write_json
from coronaryuq.report.mesh_error import MeshError


@pytest.fixture
def mesh(tmp_path):
    path = tmp_path / "mesh.json"
    write_json(path, {"nodes": 8000, "settings": {"throat_resolution": 3.0}})
    return path


@pytest.fixture
def study(tmp_path, mesh):
    path = tmp_path / "mesh_study.json"
    quantities = {
        "ffr_lad": {"error": 0.00412, "converging": True, "step_error": 0.0004},
        "osi_max_lad": {"error": 0.0849, "converging": False, "step_error": 0.0121},
    }
    content = {"nodes": [4000, 8000, 17000], "samples": ["a", "b"], "quantities": quantities}
    write_json(path, content | {"checksum": provenance.checksum(mesh)})
    return path


def test_a_study_of_this_mesh_is_quoted(mesh, study):
    error = MeshError(mesh, study)
    assert error.of("ffr_lad") == "mesh ± 0.0041, time step ± 0.0004"
    assert error.of("osi_max_lad") == "mesh: range 0.085, time step ± 0.012"
    assert error.of("mean_flow:A:B") == ""
    assert "4000, 8000, 17000 nodes" in error.sentence and "2 of the samples" in error.sentence
    assert "FFR is accurate to 0.0045 at the worst stenosis" in error.sentence
    assert "extremes of wall shear and OSI have not converged" in error.sentence


def test_without_a_study_the_page_says_so(mesh):
    error = MeshError(mesh, None)
    assert error.of("ffr_lad") == ""
    assert "was not measured" in error.sentence and "mesh_study" in error.sentence


def test_a_study_of_another_mesh_is_not_quoted(mesh, study):
    write_json(mesh, {"nodes": 8001, "settings": {"throat_resolution": 3.0}})
    error = MeshError(mesh, study)
    assert error.of("ffr_lad") == ""
    assert "measured on another mesh" in error.sentence
