"""Elements added where a vessel ends in a junction with values of its own."""

import re

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.case.network.network import GRAFTED, Network
from coronaryuq.discrepancy.forward.hypothesis import APART
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Series
from coronaryuq.zerod.effects.flow_source import FlowSource
from coronaryuq.zerod.effects.grafting import open_end, with_elements
from coronaryuq.zerod.effects.library import SEARCHED, effect
from coronaryuq.zerod.effects.quadratic import QuadraticLoss
from coronaryuq.zerod.effects.searchable import as_searched
from coronaryuq.zerod.network.read import check_network
from coronaryuq.zerod.solver.engine import Engine
from support.pullbacks import pulled_through
from support.zerod_networks import closed_loop

INFLOW, LEAK = 5.0, effect("side_branch_leak")


def vessel(number, name, resistance, **ends):
    values = {"R_poiseuille": resistance, "C": 0.0, "L": 0.0, "stenosis_coefficient": 0.0}
    kind = {"vessel_length": 1.0, "zero_d_element_type": "BloodVessel", "zero_d_element_values": values}
    return {"vessel_id": number, "vessel_name": name, "boundary_conditions": ends, **kind}


@pytest.fixture
def network():
    """A flow that a junction with a resistance for each outlet shares between two vessels."""
    beds = (("OUT1", 100.0), ("OUT2", 1000.0))
    values = {"R_poiseuille": [100.0, 200.0], "L": [0.0, 0.0], "stenosis_coefficient": [0.0, 0.0]}
    return Network(
        {
            "simulation_parameters": {"number_of_cardiac_cycles": 2, "number_of_time_pts_per_cardiac_cycle": 11},
            "boundary_conditions": [
                {"bc_name": "INFLOW", "bc_type": "FLOW", "bc_values": {"Q": [INFLOW, INFLOW], "t": [0.0, 1.0]}},
                *({"bc_name": n, "bc_type": "RESISTANCE", "bc_values": {"R": r, "Pd": 0.0}} for n, r in beds),
            ],
            "vessels": [
                vessel(0, "parent", 300.0, inlet="INFLOW"),
                vessel(1, "one", 300.0, outlet="OUT1"),
                vessel(2, "two", 300.0, outlet="OUT2"),
            ],
            "junctions": [
                {
                    "junction_name": "J0",
                    "junction_type": "BloodVesselJunction",
                    "junction_values": values,
                    "inlet_vessels": [0],
                    "outlet_vessels": [1, 2],
                }
            ],
        }
    )


def means(network, *names):
    found = Engine(network).run_to_periodic({}, [f"mean_{name}" for name in names], steps_per_cycle=10)
    assert found.ok.all(), found.status
    return [float(found.values[f"mean_{name}"][0]) for name in names]


def test_opening_a_junction_with_values_changes_no_flow(network):
    opened, junction, renamed = open_end(network, "parent", "leak")
    assert junction == "J_parent_leak" and renamed == {"parent:J0": "parent:J_parent_leak"}
    before = means(network, "flow:one:OUT1", "pressure:parent:J0")
    assert means(opened, "flow:one:OUT1", f"pressure:{renamed['parent:J0']}") == pytest.approx(before)


def test_a_leak_at_a_junction_with_values_acts_ahead_of_it(network):
    anatomy = Anatomy(network, pressure=3000.0, flow={"parent": INFLOW}, period=1.0)
    grafted = LEAK.insert(network, "parent", anatomy)
    (resistance,) = LEAK.changes(network, "parent", {"share": 0.2}, anatomy, None).values()
    bed = next(b for b in grafted["boundary_conditions"] if b["bc_name"] == "BC_leak_parent")
    bed["bc_values"]["R"] = resistance
    end = LEAK.aliases("parent", anatomy)["parent:J0"]
    flow, behind, one, two, pressure = means(
        grafted, f"flow:{end}", "flow:parent_leak:J0", "flow:one:OUT1", "flow:two:OUT2", f"pressure:{end}"
    )
    assert flow == pytest.approx(INFLOW) and behind == pytest.approx(one + two)
    assert flow - behind == pytest.approx(pressure / resistance)


def renamed(value, names):
    """The value, a network or a part of one, with other names wherever they stand, in locations and targets too."""
    if isinstance(value, dict):
        return {renamed(key, names): renamed(entry, names) for key, entry in value.items() if key != GRAFTED}
    if isinstance(value, list):
        return [renamed(entry, names) for entry in value]
    return "".join(names.get(part, part) for part in re.split("([:.])", value)) if isinstance(value, str) else value


def with_effect(network, one, place):
    """The network with an effect, its renamed locations, what it changes, and the names of its vessels by stem."""
    anatomy = Anatomy(network, 1.2e5, {}, 0.85)
    changed = one.insert(network, place, anatomy)
    check_network(changed)
    sizes = {p.name: np.array([p.centre + 0.1]) for p in one.parameters}
    changes = one.changes(changed, place, sizes, anatomy, ConditionState(0.5, 0.85, {}, {}, {}))
    changes = {name: np.ravel(value).tolist() for name, value in changes.items()}
    stems = {vessel[GRAFTED]: vessel["vessel_name"] for vessel in changed.vessels if GRAFTED in vessel}
    return [changed, one.aliases(place, anatomy), changes], stems


@pytest.mark.parametrize("one", [one for one in SEARCHED if one.grafted and one.nameable], ids=lambda one: one.name)
def test_a_repaired_network_can_be_searched_again(one):
    """The vessels of its effect are the patient's then: all effects can act there, the same once more included."""
    network = left_coronary()

    def anatomy_of(found):
        return Anatomy(found, 1.2e5, {}, 0.85)

    def probes(anatomy):
        flows = [Series("rest", "flow", f"{vessel}:{bed}", "mean", None, 1.0) for bed, vessel in anatomy.beds.items()]
        return [*flows, pulled_through(anatomy.coronary_vessels[-1])]

    anatomy = anatomy_of(network)
    for place in one.places(anatomy, probes(anatomy)):
        repaired, _ = with_elements(network, [(one, place)], anatomy_of)
        again = as_searched(check_network(repaired))
        now = anatomy_of(again)
        every = [(other, at) for other in SEARCHED if other.grafted for at in other.places(now, probes(now))]
        for kind in {other.name for other, _ in every}:
            check_network(with_elements(again, [pair for pair in every if pair[0].name == kind], anatomy_of)[0])
        ahead = [pair for pair in every if pair[0].name not in APART]
        check_network(with_elements(again, ahead, anatomy_of)[0])


@pytest.mark.parametrize("make", [left_coronary, closed_loop])
@pytest.mark.parametrize("one", [*(one for one in SEARCHED if one.grafted), FlowSource()], ids=lambda one: one.name)
def test_vessels_beds_and_junctions_of_an_effect_take_no_name_of_the_patients(one, make):
    """Two of one name were one block: the network was refused, or the effect acted on the patient's own vessel."""
    network = make()
    anatomy = Anatomy(network)
    probes = [Series("rest", "flow", f"{vessel}:{bed}", "mean", None, 1.0) for bed, vessel in anatomy.beds.items()]
    place = next(iter(one.places(anatomy, [*probes, pulled_through(anatomy.coronary_vessels[-1])])), None)
    if place is None:
        pytest.skip("acts nowhere in this network")
    plain, stems = with_effect(network, one, place)
    assert stems, "adds vessels"
    own = {*re.split("~| from ", place), *(one.vessels(place, anatomy) if isinstance(one, QuadraticLoss) else [])}
    others = [name for name in (*anatomy.vessels, *anatomy.beds, "J0") if name not in own and name in network.names]
    for name in sorted(plain[0].names - network.names):
        for other in others:
            patient = Network(renamed(network, {other: name}))
            found, new = with_effect(patient, one, place)
            back = {f"{kind}{new[stem]}": f"{kind}{stems[stem]}" for stem in stems for kind in ("", "BC_", "J_")}
            assert renamed(found, back | {name: other}) == renamed(plain, {}), (name, other)
