"""Networks that are not in CGS: which unit of pressure a network is in, and the same network in CGS."""

import copy
from collections.abc import Mapping
from pathlib import Path

from coronaryuq.errors import InputError
from coronaryuq.units import MMHG

PRESSURE_PER = {
    "BloodVessel": ("R_poiseuille", "L", "stenosis_coefficient"),
    "BloodVesselCRL": ("R_poiseuille", "L", "stenosis_coefficient"),
    "ClosedLoopRCR": ("Rp", "Rd"),
    "ClosedLoopCoronaryLeft": ("Ra", "Ram", "Rv"),
    "ClosedLoopCoronaryRight": ("Ra", "Ram", "Rv"),
    "ClosedLoopHeartAndPulmonary": (
        "Erv_s", "Elv_s", "Lra_v", "Rra_v", "Lrv_a", "Rrv_a", "Lla_v", "Rla_v", "Llv_a", "Rlv_ao", "Rpd", "Kxp_ra",
        "Kxp_la", "Emax_ra", "Emax_la",
    ),
}  # fmt: skip
"""Parameters of each element that carry pressure as a factor; times 1333.22 from mmHg."""

PER_PRESSURE = {
    "BloodVessel": ("C",), "BloodVesselCRL": ("C",), "ClosedLoopRCR": ("C",), "ClosedLoopCoronaryLeft": ("Ca", "Cim"),
    "ClosedLoopCoronaryRight": ("Ca", "Cim"), "ClosedLoopHeartAndPulmonary": ("Cp", "Cpa"),
}  # fmt: skip
"""Parameters that are divided by pressure."""

SYSTEMIC_RESISTANCE = {"mmHg": (0.05, 25.0), "cgs": (65.0, 33e3)}
"""Total systemic resistance that a person of any size at rest or exercise can have: mmHg s/mL and dyn s/cm5."""


def detect(network: Mapping, file: str | Path) -> str:
    """`mmHg` or `cgs`, by the parallel resistance of the closed-loop RCR beds; `InputError` where that is neither."""
    beds = [bc["bc_values"] for bc in network["boundary_conditions"] if bc["bc_type"] == "ClosedLoopRCR"]
    if not beds:
        raise InputError(
            file, "boundary_conditions", None, "no ClosedLoopRCR bed; tuning needs the systemic circulation"
        )
    resistance = 1.0 / sum(1.0 / (bed["Rp"] + bed["Rd"]) for bed in beds)
    for system, (low, high) in SYSTEMIC_RESISTANCE.items():
        if low <= resistance <= high:
            return system
    raise InputError(
        file, "boundary_conditions.Rp+Rd", resistance,
        "systemic resistance is neither in mmHg s/mL (about 1) nor in dyn s/cm5 (about 1300); say units: cgs or mmHg",
    )  # fmt: skip


def to_cgs(network: Mapping, system: str, file: str | Path = "network") -> tuple[dict, str]:
    """A copy of a network in CGS, and the units that it was in; `system`: `cgs`, `mmHg` or `auto` (see `detect`)."""
    network = copy.deepcopy(dict(network))
    if system == "auto":
        system = detect(network, file)
    if system == "cgs":
        return network, system
    blocks = [(v["zero_d_element_type"], v["zero_d_element_values"]) for v in network["vessels"]]
    blocks += [(bc["bc_type"], bc["bc_values"]) for bc in network["boundary_conditions"]]
    blocks += [(block["closed_loop_type"], block["parameters"]) for block in network["closed_loop_blocks"]]
    for kind, values in blocks:
        if kind not in PRESSURE_PER:
            raise InputError(file, kind, None, "no conversion from mmHg for this element; give the network in CGS")
        for name in PRESSURE_PER[kind]:
            if name in values:
                values[name] *= MMHG
        for name in PER_PRESSURE[kind]:
            if name in values:
                values[name] /= MMHG
    condition = network.get("initial_condition", {})
    for name in condition:
        if name.split(":", 1)[0].lower().startswith(("pressure", "p_")):
            condition[name] *= MMHG
    return network, system
