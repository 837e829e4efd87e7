"""Pressure units of networks: detection, and conversion to CGS."""

from pathlib import Path

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG

_VESSEL = ("R_poiseuille", "L", "stenosis_coefficient")
_OPEN_CORONARY = ("Ra1", "Rv1", "P_v", "Pim")

PRESSURE_PER = {
    "BloodVessel": (*_VESSEL, "R_wall"),
    "BloodVesselCRL": _VESSEL,
    "BloodVesselRC": ("Rpd",),
    "NORMAL_JUNCTION": (),
    "internal_junction": (),
    "BloodVesselJunction": _VESSEL,
    "FLOW": (),
    "PRESSURE": ("P",),
    "RESISTANCE": ("R", "Pd"),
    "RCR": ("Rp", "Rd", "Pd"),
    "CORONARY": (*_OPEN_CORONARY, "Ra2"),
    "CORONARY_VAR_RES": (*_OPEN_CORONARY, "Ra2_min", "Ra2_max"),
    "ClosedLoopRCR": ("Rp", "Rd"),
    "ClosedLoopCoronaryLeft": ("Ra", "Ram", "Rv"),
    "ClosedLoopCoronaryRight": ("Ra", "Ram", "Rv"),
    "ClosedLoopHeartAndPulmonary": (
        "Erv_s", "Elv_s", "Lra_v", "Rra_v", "Lrv_a", "Rrv_a", "Lla_v", "Rla_v", "Llv_a", "Rlv_ao", "Rpd", "Kxp_ra",
        "Kxp_la", "Emax_ra", "Emax_la",
    ),
    "ValveTanh": ("Rmax", "Rmin"), "PiecewiseValve": ("Rmax", "Rmin"),
    "LinearElastanceChamber": ("Emax", "Epass"), "ChamberElastanceInductor": ("Emax", "Emin", "Impedance"),
    "ChamberElastanceInductorExponential": ("Emax", "Kxp", "Impedance"),
    "half_cosine": (), "piecewise_cosine": (), "two_hill": (), "fourier": (), "wrapping_cosine": (),
}  # fmt: skip
"""Parameters of each element that are proportional to pressure; times 1333.22 from mmHg."""

PER_PRESSURE = {
    "BloodVessel": ("C",), "BloodVesselCRL": ("C",), "BloodVesselRC": ("Cp",), "RCR": ("C",), "CORONARY": ("Ca", "Cc"),
    "CORONARY_VAR_RES": ("Ca", "Cc"), "ClosedLoopRCR": ("C",), "ClosedLoopCoronaryLeft": ("Ca", "Cim"),
    "ClosedLoopCoronaryRight": ("Ca", "Cim"), "ClosedLoopHeartAndPulmonary": ("Cp", "Cpa", "Gao_leak"),
    "ValveTanh": ("Steepness",),
}  # fmt: skip
"""Parameters of each element that are inversely proportional to pressure."""

SYSTEMIC_RESISTANCE = {"mmHg": (0.05, 25.0), "cgs": (65.0, 33e3)}
"""Possible total systemic resistance of a person of any size at rest or exercise: mmHg s/mL and dyn s/cm5."""


def detect_pressure_unit(network: Network, file: str | Path) -> str:
    """Return `mmHg` or `cgs`, by the total systemic resistance; raise `InputError` if it fits neither."""
    beds = [bc["bc_values"] for bc in network.boundary_conditions if bc["bc_type"] == "ClosedLoopRCR"]
    if not beds:
        raise InputError(
            file, "boundary_conditions", None, "no ClosedLoopRCR bed; tuning needs the systemic circulation"
        )
    conductance = sum(1.0 / (bed["Rp"] + bed["Rd"]) for bed in beds if bed["Rp"] + bed["Rd"] > 0)
    resistance = 1.0 / conductance if conductance else 0.0
    for system, (low, high) in SYSTEMIC_RESISTANCE.items():
        if low <= resistance <= high:
            return system
    raise InputError(
        file, "boundary_conditions.Rp+Rd", resistance,
        "systemic resistance neither in mmHg s/mL (about 1) nor in dyn s/cm5 (about 1300); set `units: cgs` or `mmHg`",
    )  # fmt: skip


def to_cgs(network: Network, system: str, file: str | Path = "network") -> tuple[Network, str]:
    """Convert a network to CGS.

    Parameters
    ----------
    network : Network
        In `system`.
    system : str
        `cgs`, `mmHg`, or `auto` to detect it.
    file : str or Path
        Name for error messages.

    Returns
    -------
    network : Network
        A copy, in CGS.
    system : str
        `cgs` or `mmHg`.

    Raises
    ------
    InputError
        If the unit cannot be detected, or an element has no conversion.
    """
    if system == "auto":
        system = detect_pressure_unit(network, file)
    return rescaled(network, {"cgs": 1.0, "mmHg": MMHG}[system], file), system


def rescaled(network: Network, pressure: float, file: str | Path = "network") -> Network:
    """Return a copy whose unit of pressure is smaller by the factor `pressure`; volumes and times are unchanged."""
    network = network.deep_copy()
    if pressure == 1.0:
        return network
    for _, _, kind, values in network.elements():
        if kind not in PRESSURE_PER:
            raise InputError(file, kind, None, "no conversion from mmHg for this element; give the network in CGS")
        for name in PRESSURE_PER[kind]:
            if name in values:
                values[name] = _times(values[name], pressure)
        for name in PER_PRESSURE.get(kind, ()):
            if name in values:
                values[name] = _times(values[name], 1.0 / pressure)
    for part in ("initial_condition", "initial_condition_d"):
        condition = network.get(part, {})
        for name in condition:
            if name.split(":", 1)[0].lower().startswith(("pressure", "p_")):
                condition[name] *= pressure
    return network


def _times(value, factor: float):
    return [entry * factor for entry in value] if isinstance(value, list) else value * factor
