"""An open loop whose aorta resonates: it carries the flow into the body, and stores blood."""

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.settings import Settings

PERIOD = 0.9
SIZES = {"aorta": (1.25, 6.0), "descending": (1.0, 20.0), "main": (0.21, 1.2), "lad": (0.15, 7.0), "lcx": (0.14, 5.0)}
"""Vessel → radius and length, cm."""
LEADS_TO = {"aorta": ("descending", "main"), "main": ("lad", "lcx")}
NOISE = {"pressure": 0.4 * MMHG, "flow": 0.02}


def network() -> Network:
    """Driven by a pressure; beds of two coronary arteries, and a Windkessel for the body."""
    time = np.linspace(0.0, PERIOD, 101)
    phase = time / PERIOD
    systole = np.sin(np.pi * np.clip(phase / 0.42, 0.0, 1.0)) ** 2
    arterial = 78.0 + 35.0 * systole + 12.0 * np.exp(-2.0 * phase) * (1.0 - np.exp(-30.0 * phase))
    arterial[-1] = arterial[0]
    beds = {"lad": 1.3e5, "lcx": 1.5e5}
    vessels = []
    for number, (name, (radius, length)) in enumerate(SIZES.items()):
        values = {
            "R_poiseuille": 8.0 * 0.04 * length / (np.pi * radius**4),
            "L": 1.06 * length / (np.pi * radius**2),
            "C": 3.0 * np.pi * radius**2 * length / (2.0 * 5e5),
            "stenosis_coefficient": 0.0,
        }
        ends = {"inlet": "INLET"} if name == "aorta" else {}
        ends |= {"outlet": f"BC_{name}"} if name in (*beds, "descending") else {}
        entry = {"vessel_id": number, "vessel_name": name, "vessel_length": length, "boundary_conditions": ends}
        vessels.append(entry | {"zero_d_element_type": "BloodVessel", "zero_d_element_values": values})
    numbers = {name: number for number, name in enumerate(SIZES)}
    junctions = [
        {
            "junction_name": f"J{number}",
            "junction_type": "NORMAL_JUNCTION",
            "inlet_vessels": [numbers[parent]],
            "outlet_vessels": [numbers[child] for child in children],
        }
        for number, (parent, children) in enumerate(LEADS_TO.items())
    ]
    compression = {"Pim": (80.0 * MMHG * systole).tolist(), "t": time.tolist(), "P_v": 5.0 * MMHG}
    conditions = [
        {"bc_name": "INLET", "bc_type": "PRESSURE", "bc_values": {"P": (MMHG * arterial).tolist(), "t": time.tolist()}},
        {"bc_name": "BC_descending", "bc_type": "RCR", "bc_values": {"Rp": 120.0, "Rd": 1340.0, "C": 9e-4, "Pd": 4e3}},
    ]
    for name, total in beds.items():
        parts = {"Ra1": 0.32 * total, "Ra2": 0.52 * total, "Rv1": 0.16 * total, "Ca": 1.2e-6, "Cc": 9e-6}
        conditions.append({"bc_name": f"BC_{name}", "bc_type": "CORONARY", "bc_values": parts | compression})
    return Network(
        {
            "simulation_parameters": {"number_of_cardiac_cycles": 5, "number_of_time_pts_per_cardiac_cycle": 500},
            "boundary_conditions": conditions,
            "vessels": vessels,
            "junctions": junctions,
        }
    )


def blank() -> Problem:
    """Waveforms of two conditions whose values are yet to be set."""
    conditions = {c.name: c for c in (Condition("rest"), Condition("hyperaemia", coronary_resistance_scale=0.3))}
    time = np.linspace(0.0, PERIOD, 41)[:-1]
    places = (("pressure", "main:J1"), ("pressure", "lad:BC_lad"), ("flow", "J0:main"), ("flow", "J1:lad"))
    measured = [
        Measured(name, quantity, place, "waveform", time, PERIOD, np.ones(40), np.full(40, NOISE[quantity]))
        for name in conditions
        for quantity, place in places
    ]
    return make_problem(network(), conditions, measured, Settings())
