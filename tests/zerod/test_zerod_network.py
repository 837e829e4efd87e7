"""Reading networks: what passes, and how what is wrong is named."""

import copy
import json

import numpy as np
import pytest

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.read import check_network, read_network, write_network
from support.zerod_networks import bifurcation, boundary, closed_loop


def test_a_network_is_written_and_read_back_unchanged(tmp_path):
    write_network(tmp_path / "loop.json", closed_loop())
    assert read_network(tmp_path / "loop.json") == closed_loop()


def test_every_shared_case_is_read(shared):
    for path in sorted((shared / "data" / "svzerod-cases").glob("*.json")):
        Model(read_network(path), path)
    path = shared / "data" / "closed-loop-22" / "svzerod_tuning_cgs.json"
    model = Model(read_network(path), path)
    assert sum(block.kind.startswith("ClosedLoopCoronary") for block in model.blocks.values()) == 22


def test_unknowns_are_named_and_ordered_as_svzerodsolver_does():
    assert Model(bifurcation()).variables[:6] == [
        *("flow:INFLOW:trunk", "pressure:INFLOW:trunk", "flow:left:RCR_left", "pressure:left:RCR_left"),
        *("flow:right:RCR_right", "pressure:right:RCR_right"),
    ]
    assert Model(closed_loop()).variables[-12:] == [
        *("V_RA:CLH", "Q_RA:CLH", "P_RV:CLH", "V_RV:CLH", "Q_RV:CLH", "P_pul:CLH"),
        *("P_LA:CLH", "V_LA:CLH", "Q_LA:CLH", "P_LV:CLH", "V_LV:CLH", "Q_LV:CLH"),
    ]


def _without(entry: dict, key: str) -> None:
    del entry[key]


WRONG = {
    "unknown element": (lambda n: n["vessels"][0].update(zero_d_element_type="Pump"), ("trunk", "Pump")),
    "unknown valve": (
        lambda n: n.update(valves=[{"name": "mitral", "type": "ValveTanh"}]),
        ("mitral", "ValveTanh", "unknown element"),
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
        ("RCR_left", "Rd", "'big'", "want a number"),
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


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_wrong_is_named_on_one_line(fault, tmp_path):
    break_it, told = WRONG[fault]
    network = copy.deepcopy(bifurcation())
    break_it(network)
    path = tmp_path / "network.json"
    path.write_text(json.dumps(network))
    with pytest.raises(InputError) as caught:
        read_network(path)
    line = str(caught.value)
    assert "\n" not in line and str(path) in line
    assert all(part in line for part in told), line


def test_a_truncated_file_is_named(tmp_path):
    path = tmp_path / "network.json"
    path.write_text(json.dumps(bifurcation())[:200])
    with pytest.raises(InputError, match="network.json"):
        read_network(path)


def test_comments_are_allowed_anywhere():
    network = bifurcation()
    network["_comment_"] = network["vessels"][0]["_note"] = "n"
    network["vessels"][0]["zero_d_element_values"]["_comment_"] = "n"
    check_network(network)


def test_periods_that_differ_by_rounding_are_one():
    network = bifurcation()
    period = Model(network).period
    network["simulation_parameters"]["cardiac_period"] = float(np.nextafter(period, 2.0))
    assert Model(network).period == pytest.approx(period, rel=1e-12)


def test_periods_that_disagree_are_named():
    network = bifurcation()
    network["simulation_parameters"]["cardiac_period"] = 1.2
    with pytest.raises(InputError, match="inconsistent cardiac period; INFLOW"):
        Model(network)


def test_a_vessel_left_open_is_named():
    network = bifurcation()
    network["junctions"][0]["outlet_vessels"] = [1]
    with pytest.raises(InputError, match="right"):
        Model(network)
