"""A closed loop of one systemic and two coronary beds, and a problem on it."""

from collections.abc import Mapping

import numpy as np

from coronaryuq.case.network.build import HEART
from coronaryuq.case.network.network import Network
from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.flow3d.mesh.description import Couples, Face, MeshDescription, Remainder
from support.hypotheses import placed


def vessel(number, name, outlet=None, **values):
    ends = {"boundary_conditions": {"outlet": outlet}} if outlet else {}
    return {
        "vessel_id": number,
        "vessel_name": name,
        "vessel_length": 1.0,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {"R_poiseuille": 5.0, "L": 1.0, **values},
    } | ends


def bed(name, share):
    total = 60.0 * MMHG / share
    values = {"Ra": 0.32 * total, "Ram": 0.52 * total, "Rv": 0.16 * total, "Ca": 0.05 / total, "Cim": 0.6 / total}
    return {"bc_name": name, "bc_type": "ClosedLoopCoronaryLeft", "bc_values": values}


def loop():
    """Heart, aorta, one systemic bed and two coronary beds behind vessels that store blood."""
    systemic = {"Rp": 0.1 * MMHG, "Rd": 1.1 * MMHG, "C": 0.6 / MMHG, "closed_loop_outlet": True}
    full = {"V_RA:CLH": 38.0, "V_RV:CLH": 96.0, "V_LA:CLH": 38.0, "V_LV:CLH": 96.0, "P_pul:CLH": 8.0 * MMHG}
    return Network(
        {
            "simulation_parameters": {
                "number_of_cardiac_cycles": 6,
                "number_of_time_pts_per_cardiac_cycle": 401,
                "steady_initial": False,
            },
            "vessels": [
                vessel(0, "aorta", R_poiseuille=1.0, C=0.1 / MMHG),
                vessel(1, "outlet", "BC_RCR1", R_poiseuille=1.0),
                vessel(2, "lca1", "BC_lca1", R_poiseuille=500.0, C=1e-7),
                vessel(3, "lca2", "BC_lca2", R_poiseuille=500.0, C=1e-7),
            ],
            "junctions": [
                {
                    "junction_name": "J0",
                    "junction_type": "NORMAL_JUNCTION",
                    "inlet_vessels": [0],
                    "outlet_vessels": [1, 2, 3],
                }
            ],
            "boundary_conditions": [
                {"bc_name": "BC_RCR1", "bc_type": "ClosedLoopRCR", "bc_values": systemic},
                bed("BC_lca1", 0.6),
                bed("BC_lca2", 0.4),
            ],
            "closed_loop_blocks": [
                {
                    "outlet_blocks": ["aorta"],
                    "closed_loop_type": "ClosedLoopHeartAndPulmonary",
                    "cardiac_cycle_period": 1.0,
                    "parameters": dict(HEART),
                }
            ],
            "initial_condition": full | {"pressure_all": 70.0 * MMHG},
        }
    )


STENOSIS = placed("quadratic_stenosis", "lca1")


OSCILLATING = {
    "aorta": {"R_poiseuille": 0.1, "L": 0.1, "C": 3e-5},
    "lca1": {"R_poiseuille": 5.0, "L": 5.0, "C": 3e-5},
}


def oscillating_loop():
    """The loop with hardly any damping in the aorta and in a vessel that stores much blood."""
    network = loop()
    for entry in network["vessels"]:
        entry["zero_d_element_values"] |= OSCILLATING.get(entry["vessel_name"], {})
    return network


def fresh(network=None, threads=1):
    conditions = {c.name: c for c in (Condition("rest"), Condition("hyperaemia", coronary_resistance_scale=0.3))}
    time = np.linspace(0.0, 0.975, 40)
    places = (("pressure", "J_heart_outlet:aorta"), ("pressure", "lca1:BC_lca1"), ("flow", "J0:lca2"))
    measured = [
        Measured(name, quantity, place, "waveform", time, 1.0, np.ones(40), np.ones(40))
        for name in conditions
        for quantity, place in places
    ]
    return make_problem(network or loop(), conditions, measured, Settings(steps_per_cycle=200, threads=threads))


def mesh_of_part(beyond: Mapping[str, float]) -> MeshDescription:
    """The first part of lca1, of which fractions `beyond` lie downstream, and the whole of lca2."""
    places = (
        ("inlet_lca1", "J0", "lca1", "in"),
        ("outlet_lca1", "lca1", "lca1", "out"),
        ("inlet_lca2", "J0", "lca2", "in"),
        ("outlet_lca2", "lca2", "BC_lca2", "out"),
    )
    faces = [
        Face(name=name, kind="cap", couples=Couples(upstream=upstream, downstream=downstream, flow=flow))
        for name, upstream, downstream, flow in places
    ]
    cut = {"lca1": Remainder(downstream=dict(beyond))}
    return MeshDescription(faces=faces, replaces=["lca2"], cut=cut, regions={}, planes={})
