"""Networks with two inlets, where each vessel is driven by its own, and with beds of several kinds."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import PERIOD, left_coronary
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.dynamic_pressure import AT_DRIVE, DynamicPressure
from coronaryuq.zerod.effects.library import effect

LOWER = 0.6
"""Pressures of the second tree over those of the first, as in its beds."""


def two_trees() -> Network:
    """The left coronary tree twice, the second time at lower pressures: flows are lower in proportion."""
    network, second = left_coronary(), left_coronary()
    count = len(network.vessels)
    for vessel in second.vessels:
        ends = {side: f"low_{name}" for side, name in vessel.get("boundary_conditions", {}).items()}
        vessel |= {"vessel_id": vessel["vessel_id"] + count, "vessel_name": f"low_{vessel['vessel_name']}"}
        vessel |= {"boundary_conditions": ends} if ends else {}
    for block in second.boundary_conditions:
        block["bc_name"] = f"low_{block['bc_name']}"
        for name in {"P", "Pim", "P_v"} & block["bc_values"].keys():
            block["bc_values"][name] = (LOWER * np.asarray(block["bc_values"][name])).tolist()
    for junction in second.junctions:
        junction["junction_name"] = f"low_{junction['junction_name']}"
        for side in ("inlet_vessels", "outlet_vessels"):
            junction[side] = [number + count for number in junction[side]]
    for part in ("vessels", "junctions", "boundary_conditions"):
        network[part] += second[part]
    return network


def with_aorta() -> Network:
    """The left coronary tree beside an artery with an RCR bed, which feeds both."""
    network = left_coronary()
    root = network.vessel("left_main")
    ends = root.pop("boundary_conditions")
    common = network.deep_copy().vessel("left_main") | {
        "vessel_name": "aorta",
        "vessel_id": 10,
        "boundary_conditions": ends,
    }
    carotid = network.deep_copy().vessel("left_main") | {"vessel_name": "carotid", "vessel_id": 11}
    carotid["boundary_conditions"] = {"outlet": "RCR"}
    network["vessels"] += [common, carotid]
    network["junctions"].append(
        {"junction_name": "J9", "junction_type": "NORMAL_JUNCTION", "inlet_vessels": [10], "outlet_vessels": [0, 11]}
    )
    values = {"Rp": 2e3, "Rd": 2e4, "C": 2e-5, "Pd": 0.0}
    network["boundary_conditions"].append({"bc_name": "RCR", "bc_type": "RCR", "bc_values": values})
    return network


def test_beside_coronary_beds_the_other_outlets_are_searched_too():
    """Any coronary bed had taken the effects of all vessels that feed another bed out of the search."""
    network = with_aorta()
    hyperaemia = Condition("hyperaemia", coronary_resistance_scale=0.3)
    probe = Measured("hyperaemia", "flow", "carotid:RCR", "mean", None, PERIOD, np.ones(1), np.ones(1))
    anatomy = make_problem(network, {"hyperaemia": hyperaemia}, [probe], Settings()).forward.anatomy
    for name, place in (
        ("quadratic_stenosis", "carotid"),
        ("side_branch_leak", "aorta"),
        ("bed_resistance", "RCR"),
        ("distal_leak", "carotid"),
    ):
        assert place in effect(name).places(anatomy, [probe]), name
    # Hyperaemia dilates the coronary beds alone.
    assert "RCR" not in effect("incomplete_hyperaemia").places(anatomy) and anatomy.ostia == ["left_main"]
    assert apply_condition(network, hyperaemia).bed_values("RCR") == network.bed_values("RCR")


def test_a_path_begins_at_the_root_that_feeds_its_vessel():
    topology = Topology(two_trees())
    assert topology.roots == ["left_main", "low_left_main"]
    assert topology.path("low_lad") == ["low_left_main", "low_lad_proximal", "low_lad"]


def test_a_ratio_is_over_the_pressure_that_drives_its_vessel():
    """It was over that of the first inlet."""
    measured = [
        Measured("rest", "ratio", place, "mean", None, PERIOD, np.ones(1), np.ones(1))
        for place in ("lad:BC_lad", "low_lad:low_BC_lad")
    ]
    forward = make_problem(two_trees(), {"rest": Condition("rest")}, measured, Settings()).forward
    high, low = forward.predict(np.zeros(len(forward.nuisances)))[0]
    assert low == pytest.approx(high, rel=1e-6) and 0.9 < high < 1.0


def test_a_static_driving_pressure_acts_on_the_vessels_of_its_inlet():
    anatomy, one = Anatomy(two_trees()), DynamicPressure()
    places = {"low_lad:low_BC_lad": "low_AORTA:low_left_main", "lad:BC_lad": "AORTA:left_main"}
    for place, inlet in places.items():
        probe = Measured("rest", "pressure", place, "mean", None, PERIOD, np.ones(1), np.ones(1))
        assert one.elsewhere(AT_DRIVE, probe, anatomy) == ("flow", inlet)
    drive = Measured("rest", "pressure", "low_AORTA:low_left_main", "mean", None, PERIOD, np.ones(1), np.ones(1))
    assert one.elsewhere(AT_DRIVE, drive, anatomy) is None
