"""Initial scaling: totals of the circulation from the targets before any search, by hand calculation."""

import copy
from collections.abc import Mapping

from coronaryuq.calibration.parameters import BY_NAME, CORONARY, LEFT, RIGHT, SYSTEMIC
from coronaryuq.case.network.network import Network
from coronaryuq.core.units import MMHG

RIGHT_ATRIAL_PRESSURE = 5.0
"""mmHg, if no target gives it."""

PERIPHERAL_SHARE = 0.1
"""Smallest fraction of the arterial compliance that remains in the peripheral beds, however stiff the aorta has to
be."""

ARTERIAL_TIME, MYOCARDIAL_TIME = 0.08, 0.8
"""s: total coronary resistance of a side times its arterial and its intramyocardial compliance; between the final
values of svZeroDSolver's closed-loop coronary case and the svZeroDEstimator example (0.03 to 0.2 s and 0.1 to 1.7
s)."""


def scaled(network: Network, targets: Mapping[str, float], period: float) -> Network:
    """Return a copy of a CGS network whose totals agree with the targets (own units) by a hand calculation.

    Systemic and coronary resistance from mean pressure, stroke volume and split (mean flow through parallel beds,
    vessels neglected); systemic compliance from stroke volume over pulse pressure minus that of the vessels; coronary
    compliances from time constants; initial pressures and volumes from the pressures and volumes to be met.
    """
    network = copy.deepcopy(network)
    output = targets["AbsQin"] / period
    drop = (targets["PaoMean"] - targets.get("PraMean", RIGHT_ATRIAL_PRESSURE)) * MMHG
    split = targets.get("AorCorSplit", 4.0) / 100.0
    _scale_resistance(network, (SYSTEMIC,), ("Rp", "Rd"), drop / (output * (1.0 - split)))
    _scale_resistance(network, CORONARY, ("Ra", "Ram", "Rv"), drop / (output * split))
    pulse = (targets["PaoMax"] - targets["PaoMin"]) * MMHG if {"PaoMax", "PaoMin"} <= targets.keys() else 0.5 * drop
    vessels = sum(vessel["zero_d_element_values"].get("C", 0.0) for vessel in network.vessels)
    total = 0.9 * targets["AbsQin"] / pulse
    aorta = BY_NAME["Cpa"].initial / MMHG
    _scale_compliance(network, (SYSTEMIC,), "C", max(total - vessels - aorta, PERIPHERAL_SHARE * total))
    for side in (LEFT, RIGHT):
        beds = _beds(network, (side,))
        if beds:
            resistance = _parallel(beds, ("Ra", "Ram", "Rv"))
            _scale_compliance(network, (side,), "Ca", ARTERIAL_TIME / resistance)
            _scale_compliance(network, (side,), "Cim", MYOCARDIAL_TIME / resistance)
    network["initial_condition"] = _initial_condition(targets)
    return network


def _initial_condition(targets: Mapping[str, float]) -> dict[str, float]:
    """Chambers at end-diastolic volumes, pressures at diastolic ones, as in the svZeroDEstimator example."""
    filled = targets.get("EDV", 2.0 * targets["AbsQin"])
    emptied = targets.get("ESV", filled - targets["AbsQin"])
    return {
        "V_RA:CLH": max(emptied, 30.0), "V_RV:CLH": filled, "V_LA:CLH": max(emptied, 30.0), "V_LV:CLH": filled,
        "P_pul:CLH": 8.0 * MMHG, "pressure_all": targets.get("PaoMin", 0.8 * targets["PaoMean"]) * MMHG,
    }  # fmt: skip


def _beds(network: Network, kinds: tuple[str, ...]) -> list[dict]:
    held = {name.rpartition(".")[0] for name in network.held}
    beds = [bc for bc in network.boundary_conditions if bc["bc_type"] in kinds]
    return [bc["bc_values"] for bc in beds if bc["bc_name"] not in held]


def _parallel(beds: list[dict], members: tuple[str, ...]) -> float:
    return 1.0 / sum(1.0 / sum(bed[member] for member in members) for bed in beds)


def _scale_resistance(network: Network, kinds: tuple[str, ...], members: tuple[str, ...], wanted: float) -> None:
    beds = _beds(network, kinds)
    factor = wanted / _parallel(beds, members)
    for bed in beds:
        for member in members:
            bed[member] *= factor


def _scale_compliance(network: Network, kinds: tuple[str, ...], member: str, wanted: float) -> None:
    beds = _beds(network, kinds)
    factor = wanted / sum(bed[member] for bed in beds)
    for bed in beds:
        bed[member] *= factor
