"""Networks are read unchanged, and the first fault of a wrong one is named."""

import copy
import json

import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.read import check_network, read_network, write_network
from support.zerod_networks import bifurcation, boundary, built_heart, chamber, closed_loop, valve


@pytest.mark.parametrize("make", [closed_loop, built_heart])
def test_a_network_is_written_and_read_back_unchanged(tmp_path, make):
    write_network(tmp_path / "loop.json", make())
    assert read_network(tmp_path / "loop.json") == make()


def test_every_shared_case_is_read(shared):
    for path in sorted((shared / "data" / "svzerod-cases").glob("*.json")):
        Model(read_network(path), path)
    path = shared / "data" / "closed-loop-22" / "svzerod_tuning_cgs.json"
    model = Model(read_network(path), path)
    assert sum(block.kind.startswith("ClosedLoopCoronary") for block in model.blocks.values()) == 22


def _without(entry: dict, key: str) -> None:
    del entry[key]


def _chamber(activation: dict | None) -> dict:
    entry = chamber("LV", "LinearElastanceChamber", activation or {}, Emax=1.0, Epass=0.1, Vrest=5.0)
    if activation is None:
        del entry["activation_function"]
    return entry


FAULTS = {
    "unknown element": (lambda n: n["vessels"][0].update(zero_d_element_type="Pump"), ("trunk", "Pump")),
    "unknown valve": (
        lambda n: n.update(valves=[{"name": "mitral", "type": "ValveTan"}]),
        ("valves.mitral.type", "ValveTan", "unknown element; known: ValveTanh"),
    ),
    "valve without ends": (
        lambda n: n.update(valves=[{"name": "mitral", "type": "PiecewiseValve", "params": {"Rmin": 1.0, "Rmax": 9.0}}]),
        ("valves.mitral.params.upstream_block", "missing"),
    ),
    "valve after nothing": (
        lambda n: n.update(valves=[valve("mitral", "lost", "trunk", Rmin=1.0, Rmax=9.0)]),
        ("valves.mitral.params.upstream_block", "lost", "no block has this name"),
    ),
    "valve after a misspelt vessel": (
        lambda n: n.update(valves=[valve("mitral", "trnk", "trunk", Rmin=1.0, Rmax=9.0)]),
        ("valves.mitral.params.upstream_block", "trnk", "no block has this name; similar: trunk"),
    ),
    "valve of no steepness": (
        lambda n: n.update(valves=[valve("mitral", "a", "b", kind="ValveTanh", Rmin=1.0, Rmax=9.0, Steepness=0.0)]),
        ("valves.mitral.params.Steepness", "positive"),
    ),
    "chamber without activation": (
        lambda n: n.update(chambers=[_chamber(None)]),
        ("chambers.LV.activation_function.type", "unknown activation function; known: half_cosine"),
    ),
    "unknown activation": (
        lambda n: n.update(chambers=[_chamber({"type": "double_tanh"})]),
        ("chambers.LV.activation_function.type", "double_tanh", "unknown activation function"),
    ),
    "missing time of activation": (
        lambda n: n.update(chambers=[_chamber({"type": "half_cosine", "t_active": 0.1})]),
        ("chambers.LV.activation_function.t_twitch", "missing"),
    ),
    "chamber of another element": (
        lambda n: n.update(chambers=[_chamber({"type": "fourier"}) | {"type": "ChamberSphere"}]),
        ("chambers.LV.type", "ChamberSphere", "unknown element"),
    ),
    "unknown parameter": (
        lambda n: n["vessels"][1]["zero_d_element_values"].update(R=3.0),
        ("left", "zero_d_element_values.R", "unknown key"),
    ),
    "unknown simulation key": (lambda n: n["simulation_parameters"].update(steps=3), ("simulation_parameters.steps",)),
    "missing parameter": (
        lambda n: _without(n["boundary_conditions"][1]["bc_values"], "Rd"),
        ("RCR_left", "Rd", "missing"),
    ),
    "text for a number": (
        lambda n: n["boundary_conditions"][1]["bc_values"].update(Rd="big"),
        ("RCR_left", "Rd", "'big'", "expected a number"),
    ),
    "not a number": (
        lambda n: n["vessels"][0]["zero_d_element_values"].update(R_poiseuille=float("nan")),
        ("trunk", "R_poiseuille"),
    ),
    "times backwards": (
        lambda n: n["boundary_conditions"][0]["bc_values"]["t"].__setitem__(3, 0.0),
        ("INFLOW", "times must increase"),
    ),
    "lengths differ": (lambda n: n["boundary_conditions"][0]["bc_values"]["Q"].pop(), ("INFLOW", "entries as t")),
    "name taken": (lambda n: n["vessels"][1].update(vessel_name="trunk"), ("trunk", "taken")),
    "id taken": (lambda n: n["vessels"][1].update(vessel_id=0), ("vessel_id",)),
    "no such vessel": (lambda n: n["junctions"][0]["outlet_vessels"].append(9), ("J0", "outlet_vessels", "9")),
    "no such boundary": (
        lambda n: n["vessels"][1]["boundary_conditions"].update(outlet="RCR_lost"),
        ("left", "outlet", "RCR_lost"),
    ),
    "loop without heart": (
        lambda n: n["boundary_conditions"].append(boundary("X", "ClosedLoopRCR", Rp=1.0, Rd=1.0, C=1.0)),
        ("X", "ClosedLoopHeartAndPulmonary"),
    ),
    "no time points": (
        lambda n: _without(n["simulation_parameters"], "number_of_time_pts_per_cardiac_cycle"),
        ("number_of_time_pts_per_cardiac_cycle", "missing"),
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_reported_on_one_line(fault, tmp_path):
    spoil, expected = FAULTS[fault]
    network = copy.deepcopy(bifurcation())
    spoil(network)
    path = tmp_path / "network.json"
    path.write_text(json.dumps(network))
    with pytest.raises(InputError) as error:
        read_network(path)
    line = str(error.value)
    assert "\n" not in line and str(path) in line
    assert all(part in line for part in expected), line


def test_a_truncated_file_is_reported(tmp_path):
    path = tmp_path / "network.json"
    path.write_text(json.dumps(bifurcation())[:200])
    with pytest.raises(InputError, match="network.json"):
        read_network(path)


def test_keys_that_begin_with_an_underscore_are_remarks():
    network = bifurcation()
    network["_comment_"] = network["vessels"][0]["_note"] = "n"
    network["vessels"][0]["zero_d_element_values"]["_comment_"] = "n"
    check_network(network)
