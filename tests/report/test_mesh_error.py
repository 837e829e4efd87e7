"""The numerical error: from a study of this mesh, or a sentence that there is none."""

import pytest

from coronaryuq.core import provenance
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.report.mesh_error import MeshError


@pytest.fixture
def mesh(tmp_path):
    path = tmp_path / "mesh.json"
    write_json(path, {"nodes": 8000, "settings": {"throat_resolution": 3.0}})
    return path


def error(source, std, correction=0.0, method="range"):
    return {
        "source": source, "correction": correction, "std": std, "at": 0.8, "order": None, "method": method,
        "n_samples": 2, "spread": 0.0,
    }  # fmt: skip


@pytest.fixture
def study(tmp_path, mesh):
    path = tmp_path / "mesh_study.json"
    ffr = [error("mesh", 0.003, -0.0045, "richardson"), error("time_step", 0.004)]
    quantities = {
        "ffr_lad": {"unit": "1", "errors": ffr},
        "osi_max_lad": {"unit": "1", "errors": [error("mesh", 0.05)]},
    }
    content = {"nodes": [4000, 8000, 17000], "quantities": quantities, "not_measured": {"cycles": "there is one only"}}
    write_json(path, content | {"checksum": provenance.checksum(mesh)})
    return path


def test_a_study_of_this_mesh_is_quoted(mesh, study):
    found = MeshError(mesh, study)
    assert found.of("ffr_lad") == "mesh −0.0045 ± 0.0059, time step ± 0.0078"
    assert found.of("osi_max_lad") == "mesh ± 0.098"
    assert found.of("osi_max_lad", 100.0) == "mesh ± 9.8"
    assert found.of("mean_flow:A:B") == ""
    assert "4,000, 8,000, 17,000 nodes" in found.sentence and "2 or more of the samples" in found.sentence
    assert "FFR is accurate to 0.014 at the worst stenosis" in found.sentence, "0.0045 + 1.96 · 0.005"
    assert "extremes of wall shear and OSI have not converged" in found.sentence


def test_a_source_that_was_not_measured_is_named_with_its_reason(mesh, study):
    assert "The error of the cycles was not measured: there is one only." in MeshError(mesh, study).sentence


def test_no_accuracy_is_stated_where_only_the_time_step_was_measured(mesh, study):
    content = read_json(study)
    content["quantities"] = {"ffr_lad": {"unit": "1", "errors": [error("time_step", 0.004)]}}
    write_json(study, content)
    sentence = MeshError(mesh, study).sentence
    assert "accurate" not in sentence and "converge slowly" in sentence


def test_without_a_study_the_page_says_so(mesh):
    found = MeshError(mesh, None)
    assert found.of("ffr_lad") == ""
    assert "was not measured" in found.sentence and "mesh_study" in found.sentence


def test_an_error_that_was_assumed_is_said_to_be(mesh, study):
    told = "of this resolution: 4 % of 1 − FFR and 6 % of a pressure drop (one standard deviation)"
    assert told in MeshError(mesh, None, assumed=True).sentence
    assert "assumed" not in MeshError(mesh, study).sentence and told not in MeshError(mesh, study).sentence


def test_a_study_of_another_mesh_is_not_quoted(mesh, study):
    write_json(mesh, {"nodes": 8001, "settings": {"throat_resolution": 3.0}})
    found = MeshError(mesh, study)
    assert found.of("ffr_lad") == ""
    assert "measured on another mesh" in found.sentence


def test_sources_that_are_zero_in_the_digits_of_the_largest_are_left_out(mesh, study):
    content = read_json(study)
    content["quantities"]["ffr_lad"]["errors"].append(error("cycles", 4e-6))
    write_json(study, content)
    assert MeshError(mesh, study).of("ffr_lad") == "mesh −0.0045 ± 0.0059, time step ± 0.0078"
