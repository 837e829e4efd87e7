"""Elements added where a vessel ends in a junction with values of its own."""

import pytest

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.grafting import open_end
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.solver.engine import Engine

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
