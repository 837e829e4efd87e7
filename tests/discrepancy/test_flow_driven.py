"""An aorta with a prescribed inflow: what is wrong there is named, and so is an inflow that is off."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.benchmark import analyse
from coronaryuq.case.network.network import Network
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.result.repair import repaired_conditions, repaired_network
from support.hypotheses import assume

PERIOD = 0.9
BRANCHES = {"carotid": 9000.0, "renal": 6000.0, "iliac_l": 8000.0, "iliac_r": 8000.0}
"""Outlets with their resistance, dyn s/cm5."""


def vessel(number, name, resistance, inertance, compliance, **ends):
    elements = {"R_poiseuille": resistance, "L": inertance, "C": compliance}
    entry = {"vessel_id": number, "vessel_name": name, "vessel_length": 5.0, "zero_d_element_type": "BloodVessel"}
    return entry | {"zero_d_element_values": elements, "boundary_conditions": ends}


def aorta():
    """Three aortic segments of decreasing compliance with four branches, CGS; 80 mL/s on average."""
    time = np.linspace(0.0, PERIOD, 61)
    ejected = np.where(time < 0.35 * PERIOD, np.sin(np.pi * time / (0.35 * PERIOD)) ** 2, 0.0)
    flow = 80.0 * (ejected + 0.05) / np.mean((ejected + 0.05)[:-1])
    inflow = {"t": time.tolist(), "Q": np.append(flow[:-1], flow[0]).tolist()}
    blocks = [{"bc_name": "INFLOW", "bc_type": "FLOW", "bc_values": inflow}]
    for name, resistance in BRANCHES.items():
        values = {"Rp": 0.1 * resistance, "Rd": 0.9 * resistance, "C": 1e-4, "Pd": 0.0}
        blocks.append({"bc_name": f"RCR_{name}", "bc_type": "RCR", "bc_values": values})
    vessels = [
        vessel(0, "ascending", 5.0, 3.0, 4e-4, inlet="INFLOW"),
        vessel(1, "carotid", 150.0, 20.0, 2e-5, outlet="RCR_carotid"),
        vessel(2, "descending", 10.0, 5.0, 3e-4),
        vessel(3, "renal", 120.0, 15.0, 1e-5, outlet="RCR_renal"),
        vessel(4, "abdominal", 20.0, 6.0, 2e-4),
        vessel(5, "iliac_l", 100.0, 15.0, 2e-5, outlet="RCR_iliac_l"),
        vessel(6, "iliac_r", 100.0, 15.0, 2e-5, outlet="RCR_iliac_r"),
    ]
    for entry in vessels:
        if not entry["boundary_conditions"]:
            del entry["boundary_conditions"]
    junctions = [
        {"junction_name": f"J{k}", "junction_type": "NORMAL_JUNCTION", "inlet_vessels": [a], "outlet_vessels": b}
        for k, (a, b) in enumerate([(0, [1, 2]), (2, [3, 4]), (4, [5, 6])])
    ]
    simulation = {"number_of_cardiac_cycles": 12, "number_of_time_pts_per_cardiac_cycle": 401}
    parts = {"boundary_conditions": blocks, "vessels": vessels, "junctions": junctions}
    return {"simulation_parameters": simulation} | parts


def examined(folder, wrong=lambda network: None, off=(), noise=1.0):
    """The search on measurements of the aorta in which `wrong(network)` has changed something, and probes at `off` read
    15 % too much."""
    conditions = [
        Condition("rest"),
        Condition("vasodilated", coronary_resistance_scale=0.6),
        Condition("mild", coronary_resistance_scale=0.8, held_out=True),
    ]
    plan = [("pressure", place, "waveform", 0.03) for place in ("INFLOW:ascending", "iliac_l:RCR_iliac_l")]
    plan += [("flow", place, "waveform", 0.08) for place in ("J0:carotid", "J1:renal", "iliac_r:RCR_iliac_r")]

    def altered(network, condition):
        wrong(network)
        return network

    named = {condition.name: condition for condition in conditions}
    probes = assume(*(("flow_gain", place) for place in off))
    make_case.hide(
        Network(aorta()), named, make_case.Plan(tuple(plan)), probes, np.ones(len(off)), noise, 3, folder, altered
    )
    return analyse(folder)


def block(network, name):
    return next(one["bc_values"] for one in network["boundary_conditions"] if one["bc_name"] == name)


def elements(network, name):
    return next(one["zero_d_element_values"] for one in network["vessels"] if one["vessel_name"] == name)


def softer(network):
    """Half as much compliance again; what the smallest size of that effect would change, data do not see."""
    elements(network, "descending")["C"] *= 1.5


def less(network):
    inflow = block(network, "INFLOW")
    inflow["Q"] = [0.8 * value for value in inflow["Q"]]


def test_a_compliance_of_which_data_see_only_larger_sizes_is_named(tmp_path):
    found = examined(tmp_path, softer)
    assert [(one.name, place) for one, place in found.hypothesis] == [("epicardial_compliance", "descending")]
    assert found.named and not found.remaining.alarm(0.01)
    repaired = repaired_network(found.problem.forward, found.hypothesis, found.fit.z)
    assert elements(repaired, "descending")["C"] == pytest.approx(4.5e-4, rel=0.1)


def test_an_inflow_that_is_off_is_named_and_mended(tmp_path):
    found = examined(tmp_path, less)
    assert [(one.name, place) for one, place in found.hypothesis] == [("drive_gain", "INFLOW")]
    assert found.named and not found.remaining.alarm(0.01)
    ((_, z, sd),) = found.sizes(found.hypothesis.effects[0])
    assert 0.1 * z == pytest.approx(-0.2, abs=4.0 * 0.1 * sd)
    forward = found.problem.forward
    repaired = repaired_network(forward, found.hypothesis, found.fit.z)
    assert np.mean(block(repaired, "INFLOW")["Q"][:-1]) == pytest.approx(64.0, rel=0.02)
    entries, drives = repaired_conditions(forward, found.hypothesis, found.fit.z)
    for entry in entries.values():
        _, flow = drives[entry["drive"]["INFLOW"]]
        assert np.mean(flow[:-1]) == pytest.approx(64.0, rel=0.02)


def test_probes_that_read_too_much_are_no_drive_that_is_off(tmp_path):
    """Alone none explains as much as the drive does, which a search with it takes."""
    probes = {"J0:carotid", "J1:renal", "iliac_r:RCR_iliac_r"}
    found = examined(tmp_path, off=sorted(probes), noise=0.6)
    assert set(found.hypothesis) == set(assume(*(("flow_gain", place) for place in probes)))
    assert found.named and not found.remaining.alarm(0.01)
