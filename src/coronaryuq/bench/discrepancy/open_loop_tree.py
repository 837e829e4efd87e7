"""Left coronary tree driven by aortic and left ventricular pressure: the open-loop case of the benchmark."""

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core import units

PERIOD = 0.85
POINTS = 171


def pressures(points: int = POINTS, period: float = PERIOD) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return time (s), aortic and left ventricular pressure (dyn/cm2) of one beat: 120/78 mmHg, systole a third of it.

    Shapes after Westerhof, Stergiopulos & Noble, Snapshots of Hemodynamics (2010): half a sine in systole, an
    exponential run-off in diastole.
    """
    phase = np.linspace(0.0, 1.0, points)
    systole, lead = 0.36, 0.05
    bump = np.sin(np.pi * np.clip((phase - lead) / (systole - lead), 0, 1)) ** 1.2
    diastole = np.clip((phase - systole) / (1 - systole), 0, 1)
    end = 78.0
    runoff = end + 20.0 * np.exp(-2.2 * diastole) - 20.0 * np.exp(-2.2)
    early = end + (runoff.max() - end) * np.clip((phase - lead) / (systole - lead), 0, 1) + 34.0 * bump
    aortic = np.where(phase < lead, end, np.where(phase < systole, early, runoff))
    ventricular = 8.0 + 112.0 * np.sin(np.pi * np.clip(phase / (systole + 0.03), 0, 1)) ** 1.1
    aortic[-1], ventricular[-1] = aortic[0], ventricular[0]
    return phase * period, aortic * units.MMHG, ventricular * units.MMHG


def left_coronary(compressed: bool = True) -> Network:
    """Return left main, LAD with a diagonal, and circumflex; beds with or without intramyocardial pressure; CGS.

    The total flow at rest is 2.1 mL/s; fractions of a bed's resistance follow Kim et al., Ann. Biomed. Eng. 38 (2010).
    """
    time, aortic, ventricular = pressures()
    pim = 0.85 * ventricular if compressed else np.full_like(ventricular, 0.0)
    beds = {"lad": 1.0, "diagonal": 0.4, "lcx": 0.7}
    blocks = [{"bc_name": "AORTA", "bc_type": "PRESSURE", "bc_values": {"t": time.tolist(), "P": aortic.tolist()}}]
    for name, flow in beds.items():
        total = 85.0 * units.MMHG / flow
        values = {"Ra1": 0.32 * total, "Ra2": 0.52 * total, "Rv1": 0.16 * total}
        values |= {"Ca": 2.0e-6 * flow, "Cc": 2.0e-5 * flow, "P_v": 5.0 * units.MMHG}
        values |= {"t": time.tolist(), "Pim": pim.tolist()}
        blocks.append({"bc_name": f"BC_{name}", "bc_type": "CORONARY", "bc_values": values})
    vessels = [
        _vessel(0, "left_main", 60.0, 4.0, 2e-7, inlet="AORTA"),
        _vessel(1, "lad_proximal", 350.0, 12.0, 2e-7),
        _vessel(2, "lad", 900.0, 22.0, 1e-7, outlet="BC_lad"),
        _vessel(3, "diagonal", 2500.0, 30.0, 5e-8, outlet="BC_diagonal"),
        _vessel(4, "lcx", 900.0, 20.0, 1e-7, outlet="BC_lcx"),
    ]
    junctions = [_junction("J0", 0, [1, 4]), _junction("J1", 1, [2, 3])]
    simulation = {
        "number_of_cardiac_cycles": 10,
        "number_of_time_pts_per_cardiac_cycle": 401,
        "absolute_tolerance": 1e-8,
        "steady_initial": True,
    }
    return Network(
        {
            "simulation_parameters": simulation,
            "boundary_conditions": blocks,
            "vessels": vessels,
            "junctions": junctions,
        }
    )


def _vessel(number: int, name: str, resistance: float, inertance: float, compliance: float, **ends: str) -> dict:
    vessel = {
        "vessel_id": number,
        "vessel_name": name,
        "vessel_length": 3.0,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {"R_poiseuille": resistance, "L": inertance, "C": compliance},
    }
    return vessel | ({"boundary_conditions": ends} if ends else {})


def _junction(name: str, inlet: int, outlets: list[int]) -> dict:
    return {
        "junction_name": name,
        "junction_type": "NORMAL_JUNCTION",
        "inlet_vessels": [inlet],
        "outlet_vessels": outlets,
    }
