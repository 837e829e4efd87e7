"""Hidden cases: loops with few beds are accepted, networks without beds are rejected."""

import copy

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.benchmark import run
from coronaryuq.bench.discrepancy.hidden_cases import LOOPS_OUTSIDE, changed_network, open_loop
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.grafting import add_vessel, attach, open_end
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine


@pytest.mark.parametrize("arteries", [2, 1])
@pytest.mark.parametrize("name", LOOPS_OUTSIDE)
def test_effects_outside_the_library_are_possible_in_a_small_loop(shared, name, arteries):
    network = read_network(shared / "data" / "svzerod-cases" / "closedLoopHeart_withCoronaries.json")
    if arteries == 1:
        bed = next(block for block in network["boundary_conditions"] if block["bc_name"] == "RCA")
        systemic = next(b for b in network["boundary_conditions"] if b["bc_type"] == "ClosedLoopRCR")
        bed.update(bc_type="ClosedLoopRCR", bc_values=systemic["bc_values"])
    alter = changed_network(name, network, np.random.default_rng(1))
    if (name, arteries) == ("miswired_outlets", 1) or name in (
        "thrombosed_side_vessel",
        "delayed_collateral",
        "rewired_branch",
    ):
        assert alter is None
    else:
        assert alter(copy.deepcopy(network), "pacing") != network


def forked(network):
    """Each coronary artery feeds two beds like its own."""
    for artery, bed in (("branch2_seg0", "LCA"), ("branch3_seg0", "RCA")):
        network, junction, _ = open_end(network, artery, "first")
        own = next(b for b in network["boundary_conditions"] if b["bc_name"] == bed)
        network["boundary_conditions"].append(copy.deepcopy(own) | {"bc_name": f"{bed}_second"})
        branch = add_vessel(network, f"{artery}_second", {"R_poiseuille": 0.1}, outlet=f"{bed}_second")
        attach(network, junction, "outlet", branch)
    return network


@pytest.mark.parametrize(
    ("name", "there", "gone"),
    [
        ("spasm", "pacing", "rest"),
        ("thrombosed_side_vessel", "rest", "pacing"),
        ("delayed_collateral", "hyperaemia", "rest"),
    ],
)
def test_a_transient_effect_acts_under_one_condition_only(shared, name, there, gone):
    """Mean flows into the coronary vessels change under one and stay as they are under another, over the largest."""
    network = forked(read_network(shared / "data" / "svzerod-cases" / "closedLoopHeart_withCoronaries.json"))
    alter = changed_network(name, network, np.random.default_rng(3))
    anatomy = Anatomy(network)
    names = [f"mean_flow:{anatomy.inlet(vessel)}" for vessel in anatomy.coronary_vessels]

    def flows(condition):
        changed = network if condition is None else alter(copy.deepcopy(network), condition)
        found = Engine(changed).run_to_periodic(quantities=names, steps_per_cycle=300)
        assert found.ok.all(), found.status
        return np.array([found.values[one][0] for one in names])

    plain = flows(None)
    change = {condition: np.abs(flows(condition) - plain).max() / plain.max() for condition in (there, gone)}
    assert change[there] > 1e-3 and change[gone] < 0.01 * change[there], change


def test_a_network_that_is_not_a_loop_is_rejected(shared):
    with pytest.raises(InputError, match="not a closed loop with coronary beds"):
        run(quick=True, network=str(shared / "data" / "svzerod-cases" / "pulsatileFlow_R_RCR.json"))


def test_a_branch_is_attached_to_another_vessel():
    """It keeps its bed; one vessel feeds a branch more, another one less."""
    network = open_loop().network
    alter = changed_network("rewired_branch", network, np.random.default_rng(1))
    before, after = Anatomy(network), Anatomy(alter(copy.deepcopy(network), "rest"))
    (branch,) = [name for name in before.vessels if before.parents(name) != after.parents(name)]
    assert len(after.parents(branch)) == 1 and after.outlet_bc == before.outlet_bc
