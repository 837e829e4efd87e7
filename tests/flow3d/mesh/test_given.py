"""The patient's own lumen: a folder taken as it is, a closed surface filled with tetrahedra."""

import numpy as np
import pytest
from random_trees import network_of, random_tree

from coronaryuq.case.surface import surface_of
from coronaryuq.errors import InputError
from coronaryuq.flow3d.mesh import folder
from coronaryuq.flow3d.mesh.given import adopt_folder, mesh_closed_surface
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.mesh.stage import mesh_tree


@pytest.fixture(scope="module")
def forked(tmp_path_factory):
    tree, stenoses = random_tree(0, generations=2)
    out = tmp_path_factory.mktemp("forked")
    settings = Settings(domain="trees", throat_resolution=2.0, resolution=1.5)
    network = network_of(tree, stenoses)
    return out / "mesh-complete", mesh_tree(tree, stenoses, network, settings, out), tree, stenoses, network, settings


def test_adopted_folder_is_described_as_when_it_was_made(forked):
    given, made, tree, stenoses, network, settings = forked
    mesh, content = adopt_folder(given, tree, stenoses, network, settings)
    assert content["domain"] == "given"
    for key in ("nodes", "tets", "replaces", "cut", "regions"):
        assert content[key] == made[key], key
    for one, other in zip(content["faces"], made["faces"], strict=True):
        assert one["name"] == other["name"]
        assert one.get("couples") == other.get("couples")
    assert np.array_equal(mesh.region, folder.read(given).region)


def test_folder_of_another_anatomy_is_refused(forked):
    given, _, _, _, _, settings = forked
    other, stenoses = random_tree(5, generations=2)
    with pytest.raises(InputError):
        adopt_folder(given, other, stenoses, network_of(other, stenoses), settings)


def test_closed_surface_is_filled(forked, tmp_path):
    given, made, tree, stenoses, network, settings = forked
    whole = folder.read(given)
    surface = surface_of(whole.points, whole.triangles)
    mesh, content = mesh_closed_surface(surface, tree, stenoses, network, settings, tmp_path / "lumen.stl")
    assert content["domain"] == "surface"
    assert content["volume"] == pytest.approx(made["volume"], rel=0.03)
    couples = {face["name"]: face["couples"] for face in content["faces"] if face["kind"] == "cap"}
    assert couples == {face["name"]: face["couples"] for face in made["faces"] if face["kind"] == "cap"}
    assert content["quality"]["dihedral_min"] > 3.0
    assert set(content["regions"]) == set(made["regions"])
    assert len(mesh.caps) == len(folder.read(given).caps)
