"""A small patient for the posterior stage, made of resistors."""

import pytest

from coronaryuq.core.io.atomic import write_json
from support.resistor_tree import ResistorTree, network_of, targets_of


@pytest.fixture
def tree() -> ResistorTree:
    return ResistorTree.of(6)


@pytest.fixture
def campaign(tmp_path, tree):
    """Paths of `case.json`, `hyperaemia.json`, `targets.json` of the tree."""
    mean, covariance = targets_of(tree)
    beds = range(len(tree.beds))
    outlets = [{"name": f"out{i}", "bc": f"BC_{i}", "vessel": f"v{i}", "perfuses": "LV"} for i in beds]
    write_json(tmp_path / "case.json", {"name": "tree", "outlets": outlets})
    write_json(tmp_path / "hyperaemia.json", network_of(tree))
    names = {"outlets": [o["name"] for o in outlets], "bc": [o["bc"] for o in outlets]}
    write_json(tmp_path / "targets.json", {**names, "mean": mean, "covariance": covariance})
    return tmp_path / "case.json", tmp_path / "hyperaemia.json", tmp_path / "targets.json"
