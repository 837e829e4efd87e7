"""The patient's own lumen: a folder taken as it is, a closed surface filled with tetrahedra."""

from dataclasses import replace

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.tree import write_tree
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.flow3d.mesh.generation import folder
from coronaryuq.flow3d.mesh.imported_lumen import adopt_folder
from coronaryuq.flow3d.mesh.read_mesh import read_domain
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.mesh.stage import make_mesh, mesh_tree
from support.case_files import write_case_json
from support.random_trees import network_of, random_tree

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def forked(tmp_path_factory):
    tree, stenoses = random_tree(0, generations=2)
    out = tmp_path_factory.mktemp("forked")
    settings = Settings(domain="trees", throat_resolution=2.0, resolution=1.5, core_resolution=0.0, wall_grading=0.0)
    network = network_of(tree, stenoses)
    return out / "mesh-complete", mesh_tree(tree, stenoses, network, settings, out), tree, stenoses, network, settings


@pytest.mark.long
def test_an_adopted_folder_gets_the_description_that_it_was_made_with(forked):
    given, made, tree, stenoses, network, settings = forked
    mesh, content = adopt_folder(given, tree, stenoses, network, settings)
    assert content.domain == "given"
    for key in ("nodes", "tets", "replaces", "cut", "regions"):
        assert getattr(content, key) == getattr(made, key), key
    assert [face.name for face in content.faces] == [face.name for face in made.faces]
    assert content.caps == made.caps
    assert np.array_equal(mesh.region, folder.read(given).region)


def test_a_folder_of_another_anatomy_is_rejected(forked):
    given, _, _, _, _, settings = forked
    other, stenoses = random_tree(5, generations=2)
    with pytest.raises(InputError):
        adopt_folder(given, other, stenoses, network_of(other, stenoses), settings)


@pytest.fixture(scope="module")
def case_in_mm(forked, tmp_path_factory):
    """What the mesh rule reads: case.json, tree.vtp, network.json, and the lumen as STL and as a folder, in mm."""
    given, _, tree, stenoses, network, _ = forked
    here = tmp_path_factory.mktemp("case")
    entries = [{"name": s.name, "vessel": s.vessel, "start": s.start, "end": s.end} for s in stenoses]
    write_case_json(here / "case.json", stenoses=entries, anatomy={"kind": "surface", "unit": "mm"})
    write_tree(here / "tree.vtp", tree)
    write_json(here / "network.json", network)
    mesh = folder.read(given)
    folder.write(here / "given", replace(mesh, points=10.0 * mesh.points))
    pv.PolyData.from_regular_faces(10.0 * mesh.points, mesh.triangles).save(here / "lumen.stl")
    return here


def rule(here, out, **changes):
    settings = Settings(domain="lumen", throat_resolution=2.0, resolution=1.5, core_resolution=0.0, wall_grading=0.0)
    return make_mesh(here / "case.json", here / "tree.vtp", here / "network.json", settings, out, **changes)


def test_the_rule_fills_a_closed_surface_in_the_unit_of_the_case_with_tetrahedra(forked, case_in_mm, tmp_path):
    made, before = rule(case_in_mm, tmp_path, lumen=case_in_mm / "lumen.stl"), forked[1]
    assert made.domain == "surface"
    assert made.volume == pytest.approx(before.volume, rel=0.03)
    assert made.caps == before.caps
    assert made.quality["dihedral_min"] > 3.0
    assert set(made.regions) == set(before.regions)
    assert len(folder.read(tmp_path / "mesh-complete").caps) == len(folder.read(forked[0]).caps)
    assert read_domain(tmp_path / "mesh-complete", tmp_path / "mesh.json").inlets == ["inlet_v0"]


def test_the_rule_takes_a_mesh_folder_in_the_unit_of_the_case(forked, case_in_mm, tmp_path):
    made = rule(case_in_mm, tmp_path, lumen=case_in_mm / "given")
    assert made.domain == "given"
    assert made.nodes == forked[1].nodes
    assert made.volume == pytest.approx(forked[1].volume)


def test_a_case_without_lumen_or_anatomy_is_rejected(case_in_mm, tmp_path):
    with pytest.raises(InputError, match="anatomy: domain `lumen` needs a surface"):
        rule(case_in_mm, tmp_path / "out")
    write_case_json(tmp_path / "case.json", anatomy=None)
    with pytest.raises(InputError, match="a schematic 0D network"):
        make_mesh(tmp_path / "case.json", case_in_mm / "tree.vtp", case_in_mm / "network.json", Settings(), tmp_path)
