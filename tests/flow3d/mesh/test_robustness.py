"""Random trees are meshed: a few always, fifty coarse ones and sixty segments by hand (`-m long tests/flow3d/mesh`)."""

import pytest

from coronaryuq.flow3d.mesh.generation import folder
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.mesh.stage import mesh_tree
from support.random_trees import network_of, random_tree

COARSE = {"throat_resolution": 2.5, "resolution": 1.6, "core_resolution": 0.0, "wall_grading": 0.0}


def meshes(seed: int, settings: Settings, out) -> None:
    tree, stenoses = random_tree(seed)
    content = mesh_tree(tree, stenoses, network_of(tree, stenoses), settings, out)
    mesh = folder.read(out / "mesh-complete")
    assert len(mesh.points) == content.nodes
    assert content.quality["dihedral_min"] > 3.0
    for stenosis in stenoses:
        asked = settings.throat_resolution
        assert content.quality["throat_resolution"][stenosis.name] == pytest.approx(asked, rel=0.25)
        assert content.regions[stenosis.name].triangles > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 26])
def test_segments_of_random_trees_are_meshed(seed, tmp_path):
    meshes(seed, Settings(**COARSE, jet_resolution=2.5), tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(60))
def test_segments_of_sixty_random_trees_are_meshed(seed, tmp_path):
    meshes(seed, Settings(), tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(50))
def test_fifty_random_trees_are_meshed_whole(seed, tmp_path):
    meshes(seed, Settings(domain="trees", **COARSE, jet_resolution=1.6), tmp_path)
