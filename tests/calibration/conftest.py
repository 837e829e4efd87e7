"""A small closed loop: heart, aorta, one systemic bed, two left coronary beds and one right, in CGS."""

import pytest

from coronaryuq.case.network.build import HEART
from coronaryuq.case.network.network import Network
from coronaryuq.core.units import MMHG


def vessel(number, name, outlet=None, resistance=5.0, compliance=0.0):
    block = {
        "vessel_id": number,
        "vessel_name": name,
        "vessel_length": 1.0,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {
            "R_poiseuille": resistance,
            "L": 1.0,
            "C": compliance,
            "stenosis_coefficient": 0.0,
        },
    }
    return block | ({"boundary_conditions": {"outlet": outlet}} if outlet else {})


def coronary(name, side, share):
    resistance = 60.0 * MMHG / share
    return {
        "bc_name": name,
        "bc_type": f"ClosedLoopCoronary{side}",
        "bc_values": {
            "Ra": 0.32 * resistance,
            "Ram": 0.52 * resistance,
            "Rv": 0.16 * resistance,
            "Ca": 0.05 / resistance,
            "Cim": 0.6 / resistance,
        },
    }


@pytest.fixture(scope="session")
def loop_network():
    return Network(
        {
            "simulation_parameters": {
                "number_of_cardiac_cycles": 6,
                "number_of_time_pts_per_cardiac_cycle": 1000,
                "steady_initial": False,
                "output_all_cycles": False,
            },
            "vessels": [
                vessel(0, "aorta", resistance=1.0, compliance=0.1 / MMHG),
                vessel(1, "outlet", "BC_RCR1", resistance=1.0),
                vessel(2, "lca1", "BC_lca1", resistance=500.0),
                vessel(3, "lca2", "BC_lca2", resistance=500.0),
                vessel(4, "rca1", "BC_rca1", resistance=500.0),
            ],
            "junctions": [
                {
                    "junction_name": "J0",
                    "junction_type": "NORMAL_JUNCTION",
                    "inlet_vessels": [0],
                    "outlet_vessels": [1, 2, 3, 4],
                }
            ],
            "boundary_conditions": [
                {
                    "bc_name": "BC_RCR1",
                    "bc_type": "ClosedLoopRCR",
                    "bc_values": {
                        "Rp": 0.1 * MMHG,
                        "Rd": 1.1 * MMHG,
                        "C": 0.6 / MMHG,
                        "closed_loop_outlet": True,
                    },
                },
                coronary("BC_lca1", "Left", 0.4),
                coronary("BC_lca2", "Left", 0.2),
                coronary("BC_rca1", "Right", 0.4),
            ],
            "closed_loop_blocks": [
                {
                    "outlet_blocks": ["aorta"],
                    "closed_loop_type": "ClosedLoopHeartAndPulmonary",
                    "cardiac_cycle_period": 1.0,
                    "parameters": dict(HEART),
                }
            ],
            "initial_condition": {
                "V_RA:CLH": 38.0,
                "V_RV:CLH": 96.0,
                "V_LA:CLH": 38.0,
                "V_LV:CLH": 96.0,
                "P_pul:CLH": 8.0 * MMHG,
                "pressure_all": 70.0 * MMHG,
            },
        }
    )


@pytest.fixture
def small_loop(loop_network):
    """The test's own copy."""
    return loop_network.deep_copy()


@pytest.fixture(scope="session")
def adult():
    """Targets of an adult at rest, in their own units."""
    return {
        "PaoMin": 75.0,
        "PaoMax": 122.0,
        "PaoMean": 95.0,
        "AorCorSplit": 3.5,
        "AbsQin": 70.0,
        "EFLV": 0.62,
        "ESV": 43.0,
        "EDV": 113.0,
        "PpulMean": 15.0,
    }
