"""What the benchmark `discrepancy` hides: loops with few beds are taken, networks without any are refused."""

import copy

import numpy as np
import pytest

from coronaryuq.bench.discrepancy import run
from coronaryuq.bench.hidden_cases import OUTSIDE_LOOP, outside
from coronaryuq.errors import InputError
from coronaryuq.files import read_json


@pytest.mark.parametrize("arteries", [2, 1])
@pytest.mark.parametrize("name", OUTSIDE_LOOP)
def test_effects_outside_the_library_in_a_loop_of_one_bed_per_artery(shared, name, arteries):
    network = read_json(shared / "data" / "svzerod-cases" / "closedLoopHeart_withCoronaries.json")
    if arteries == 1:
        bed = next(block for block in network["boundary_conditions"] if block["bc_name"] == "RCA")
        bed.update(bc_type="ClosedLoopRCR", bc_values=network["boundary_conditions"][0]["bc_values"])
    alter = outside(name, network, np.random.default_rng(1))
    if (name, arteries) == ("miswired_outlets", 1):
        assert alter is None
    else:
        assert alter(copy.deepcopy(network), "hyperaemia") != network


def test_a_network_that_is_no_loop_is_refused(shared):
    with pytest.raises(InputError, match="no closed loop with coronary beds"):
        run(quick=True, network=str(shared / "data" / "svzerod-cases" / "pulsatileFlow_R_RCR.json"))
