"""A small mesh that several tests look at."""

import pytest

from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.mesh.stage import mesh_tree
from support.random_trees import network_of, tube


@pytest.fixture(scope="session")
def coarse() -> Settings:
    return Settings(domain="trees", throat_resolution=3.0, resolution=2.0, core_resolution=1.5, wall_grading=0.5)


@pytest.fixture(scope="session")
def stenosed(tmp_path_factory, coarse):
    """A tube with a 50 % stenosis: folder, content of mesh.json, tree, stenoses, network."""
    tree, stenoses = tube(length=2.4, radius=0.15, severity=0.5)
    network = network_of(tree, stenoses)
    out = tmp_path_factory.mktemp("stenosed")
    return out, mesh_tree(tree, stenoses, network, coarse, out), tree, stenoses, network
