"""A small patient for the posterior stage, made of resistors."""

import pytest

from coronaryuq.core.io.atomic import write_json
from support.case_files import write_case_json, write_perfusion_targets
from support.resistor_tree import ResistorTree, network_of, targets_of


@pytest.fixture
def tree() -> ResistorTree:
    return ResistorTree.of(6)


@pytest.fixture
def campaign(tmp_path, tree):
    """Paths of `case.json`, `hyperaemia.json`, `targets.json` of the tree."""
    mean, covariance = targets_of(tree)
    beds = range(len(tree.beds))
    outlets = [{"name": f"out{i}", "bc": f"BC_{i}", "vessel": f"v{i}"} for i in beds]
    case = write_case_json(tmp_path / "case.json", outlets=outlets)
    write_json(tmp_path / "hyperaemia.json", network_of(tree))
    names = [entry["name"] for entry in outlets]
    bc = [entry["bc"] for entry in outlets]
    targets = write_perfusion_targets(tmp_path / "targets.json", bc, mean, covariance, outlets=names)
    return case, tmp_path / "hyperaemia.json", targets
