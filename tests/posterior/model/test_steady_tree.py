"""Steady flow through the trees: exact where it can be, and nearly what the 0D engine says."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.core.units import MMHG
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.posterior.model.steady_tree import SteadyTree
from coronaryuq.zerod.network.beds import distal_resistances
from coronaryuq.zerod.network.read import check_network
from support.random_trees import network_of as network_of_tree
from support.random_trees import random_tree
from support.resistor_tree import ResistorTree, network_of
from support.small_loop import loop

PRESSURE = 90.0 * MMHG


def steady(network, pressure):
    names = list(distal_resistances(network))
    return SteadyTree(network, "network", names, pressure), names


def test_without_quadratic_losses_it_is_the_tree_of_resistors():
    tree = ResistorTree.of(7)
    own, names = steady(check_network(network_of(tree)), tree.pressure)
    m = np.random.default_rng(1).uniform(0.3, 3.0, size=(20, 7))
    changes = {
        f"{name}.{part}": share * tree.beds[i] * m[:, i]
        for i, name in enumerate(names)
        for part, share in (("Ra1", 0.3), ("Ra2", 0.5), ("Rv1", 0.2))
    }
    assert np.allclose(own.flows(changes), tree.flows(m), rtol=1e-6)


@given(seed=st.integers(0, 40), strength=st.floats(-0.1, 30.0))
@settings(max_examples=25, deadline=None)
def test_pressures_add_up_along_every_way(seed, strength):
    """The losses R Q + K Q |Q| from the ostium to a bed, and the bed's own, are the pressure ahead."""
    tree, stenoses = random_tree(seed)
    network = check_network(network_of_tree(tree, stenoses))
    own, names = steady(network, PRESSURE)
    quadratic = {f"{v}.stenosis_coefficient": np.array([strength * 300.0 * (1 + k % 3)])
                 for k, v in enumerate(own.vessels)}  # fmt: skip
    flows = dict(zip(names, own.flows(quadratic)[0].tolist(), strict=True))
    assert all(flow > 0 for flow in flows.values())
    through = np.zeros(len(own.vessels))
    for name, k in zip(names, own.wanted.tolist(), strict=True):
        while k >= 0:
            through[k] += flows[name]
            k = own.parent[k]
    lost = own.values[0] * through + np.array([q[0] for q in quadratic.values()]) * through**2
    for name, end in zip(names, own.wanted.tolist(), strict=True):
        pressure, k = own.values[2, end] * flows[name], end
        while k >= 0:
            pressure += lost[k]
            k = own.parent[k]
        assert np.isclose(pressure, PRESSURE, rtol=1e-5)


@given(
    seed=st.integers(0, 9),
    factors=st.lists(st.sampled_from([-6.0, -1.0, 0.0, 1e-300, 1.0, 1e300, np.inf]), min_size=3, max_size=3),
)
@settings(max_examples=60, deadline=None)
def test_resistances_of_no_vessel_have_no_flow(seed, factors):
    """Far in the tails of a normal law a resistance is negative: no error, and flows are positive or no numbers."""
    tree, stenoses = random_tree(seed)
    own, _ = steady(check_network(network_of_tree(tree, stenoses)), PRESSURE)
    named = [name for name in own.places if name.endswith("R_poiseuille")][: len(factors)]
    changes = {
        name: own.places[name][0] * np.array([factor, 1.0]) for name, factor in zip(named, factors, strict=False)
    }
    flows = own.flows(changes)
    assert np.isnan(flows[0]).all() or (flows[0] > 0.0).all()
    assert (flows[1] > 0.0).all(), "the row beside it"
    assert np.isnan(own.flows({named[0]: np.array([-1e30])})).all()


def test_a_row_does_not_depend_on_the_others():
    tree, stenoses = random_tree(3)
    own, names = steady(check_network(network_of_tree(tree, stenoses)), PRESSURE)
    values = np.random.default_rng(0).uniform(0.0, 3e4, size=50)
    changes = {f"{own.vessels[0]}.stenosis_coefficient": values}
    one = {name: value[17:18] for name, value in changes.items()}
    assert np.array_equal(own.flows(changes)[17:18], own.flows(one))


def test_it_is_nearly_the_mean_flow_of_a_pulsatile_run():
    """Within 3 % beside r-hat, though losses and beds change the flow fourfold."""
    network = check_network(loop())
    for vessel in ("lca1", "lca2"):
        network.vessel_values(vessel)["stenosis_coefficient"] = 4000.0
    model = BedFlows("network", {"BC_lca1": "lca1", "BC_lca2": "lca2"}, tolerance=1e-4, steps_per_cycle=None,
                     network=network)  # fmt: skip
    inputs = np.array([[1.0, 1.0], [2.0, 1.0], [0.25, 1.0], [0.25, 0.25]])
    flows = model.flows(inputs)
    left = flows / model.steady(inputs)
    assert np.all(np.abs(left / left[0] - 1.0) < 0.03)
    assert flows[2, 0] > 2.0 * flows[1, 0]


def test_a_leak_does_not_cut_the_tree():
    """What leaves it is left to the emulator; the vessels ahead keep their losses."""
    content = network_of(ResistorTree.of(3)).deep_copy()
    content["boundary_conditions"].append(
        {"bc_name": "VEIN", "bc_type": "RESISTANCE", "bc_values": {"R": 1e6, "Pd": 0.0}}
    )
    content["vessels"].append(
        {"vessel_id": 9, "vessel_name": "leak", "vessel_length": 1.0, "boundary_conditions": {"outlet": "VEIN"},
         "zero_d_element_type": "BloodVessel", "zero_d_element_values": {"R_poiseuille": 1e5}}
    )  # fmt: skip
    content["junctions"][0]["outlet_vessels"].append(9)
    own, _ = steady(check_network(content), PRESSURE)
    assert own.vessels == ["root", "v0", "v1", "v2"]
    assert own.parent.tolist() == [-1, 0, 0, 0]
