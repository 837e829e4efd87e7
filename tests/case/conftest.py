"""Trees to try things on."""

import pytest

from coronaryuq.case.anatomy.tree import Stenosis
from support import case_files


@pytest.fixture
def small_tree():
    return case_files.small_tree(branch1=65, rca1=125)


@pytest.fixture
def small_stenoses():
    return [Stenosis("LAD", "lca1", 1.0, 2.0), Stenosis("RCA", "rca1", 3.0, 4.0)]
