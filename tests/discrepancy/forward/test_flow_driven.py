"""An aorta with a prescribed inflow: errors of a vessel and of the inflow are named."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.trial import analyse
from coronaryuq.case.network.network import Network
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.experiment import Experiment, Plan
from coronaryuq.discrepancy.hidden.nature import Outside
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


def searched(folder, wrong=lambda network: None, off=(), noise=1.0):
    """Search measurements of the aorta changed by `wrong`, with flow probes at `off` that read 15 % too high."""
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
    experiment = Experiment(Network(aorta()), named, Plan(tuple(plan)))
    make_case.hide(experiment, probes, np.ones(len(off)), make_case.Noise(noise), 3, folder, Outside(network=altered))
    return analyse(folder)


def block(network, name):
    return next(one["bc_values"] for one in network["boundary_conditions"] if one["bc_name"] == name)


def elements(network, name):
    return next(one["zero_d_element_values"] for one in network["vessels"] if one["vessel_name"] == name)


def softer(network):
    """Two and a half times the compliance: half as much again is within four errors of a vessel's own."""
    elements(network, "descending")["C"] *= 2.5


def less(network):
    inflow = block(network, "INFLOW")
    inflow["Q"] = [0.8 * value for value in inflow["Q"]]


@pytest.mark.slow
def test_a_large_compliance_error_is_named(tmp_path):
    found = searched(tmp_path, softer)
    assert [(one.name, place) for one, place in found.hypothesis] == [("epicardial_compliance", "descending")]
    assert found.named and not found.remaining.alarm(0.01)
    repaired = repaired_network(found.problem.forward, found.hypothesis, found.fit.z)
    assert elements(repaired, "descending")["C"] == pytest.approx(7.5e-4, rel=0.1)


@pytest.mark.long
def test_an_error_of_the_inflow_is_named_and_repaired(tmp_path):
    found = searched(tmp_path, less)
    assert [(one.name, place) for one, place in found.hypothesis] == [("drive_gain", "INFLOW")]
    assert found.named and not found.remaining.alarm(0.01)
    ((_, z, sd),) = found.sizes(found.hypothesis.effects[0])
    assert 0.1 * z == pytest.approx(-0.2, abs=4.0 * 0.1 * sd)
    forward = found.problem.forward
    repaired = repaired_network(forward, found.hypothesis, found.fit.z)
    assert np.mean(block(repaired, "INFLOW")["Q"][:-1]) == pytest.approx(64.0, rel=0.02)
    entries, drives = repaired_conditions(forward, found.hypothesis, found.fit.z)
    for entry in entries:
        _, flow = drives[entry, "INFLOW"]
        assert np.mean(flow[:-1]) == pytest.approx(64.0, rel=0.02)


@pytest.mark.long
def test_gain_errors_of_probes_are_not_mistaken_for_an_inflow_error(tmp_path):
    """No single probe explains as much as the drive, which the search tries first.

    The possible errors of the vessels leave two of the three; with four times the noise one cause is likelier.
    """
    probes = {"J0:carotid", "J1:renal", "iliac_r:RCR_iliac_r"}
    found = searched(tmp_path, off=sorted(probes), noise=0.15)
    assert len(found.hypothesis) > 1
    assert set(found.hypothesis) <= set(assume(*(("flow_gain", place) for place in probes)))
    assert found.named and not found.remaining.alarm(0.01)
