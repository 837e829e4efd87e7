"""Trees to try things on."""

import pytest
from case_files import straight

from coronaryuq.case.tree import Stenosis, Tree


@pytest.fixture
def small_tree():
    """An aorta with a left main that divides once, and a right coronary artery; lengths are round numbers."""
    return Tree(
        [
            straight("aorta", (0, 0, 0), (0, 0, 1), 2.0, (1.2, 1.2)),
            straight("branch1", (0, 0, 2), (1, 0, 0), 3.2, (0.2, 0.2), "aorta", "LM", points=65),
            straight("lca1", (3.2, 0, 2), (1, 0, -1), 4.0, (0.16, 0.12), "branch1", "LAD"),
            straight("lca2", (3.2, 0, 2), (1, 1, 0), 3.0, (0.15, 0.10), "branch1", "LCx"),
            straight("rca1", (0, 0, 2), (-1, 0, 0), 6.2, (0.18, 0.12), "aorta", "RCA", points=125),
            straight("aorta_outlet", (0, 0, 2), (0, 0, 1), 3.0, (1.2, 1.2), "aorta"),
        ]
    )


@pytest.fixture
def small_stenoses():
    return [Stenosis("LAD", "lca1", 1.0, 2.0), Stenosis("RCA", "rca1", 3.0, 4.0)]
