"""Parameters of each 0D element, by svZeroDSolver's names, and which of them are optional."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One entry of an element's values: a number unless `series` (a list over `t`), `flag` or `name` (of a block).

    ours: an extension of the format that svZeroDSolver does not read.
    """

    required: bool = True
    series: bool = False
    flag: bool = False
    name: bool = False
    positive: bool = False
    ours: bool = False


Parameters = dict[str, Parameter]

_SCALAR, _OPTIONAL, _SERIES = Parameter(), Parameter(required=False), Parameter(series=True)
_POSITIVE, _FLAG = Parameter(positive=True), Parameter(required=False, flag=True)
_NAME = Parameter(name=True)


def _scalars(names: str) -> Parameters:
    return dict.fromkeys(names.split(), _SCALAR)


_RLC = {"R_poiseuille": _SCALAR, "C": _OPTIONAL, "L": _OPTIONAL, "stenosis_coefficient": _OPTIONAL}
_OPEN_CORONARY = {**_scalars("Ra1 Rv1 Ca Cc"), "t": _SERIES, "Pim": _SERIES, "P_v": _SCALAR}

VESSELS: dict[str, Parameters] = {
    "BloodVessel": {**_RLC, "R_wall": Parameter(required=False, ours=True)},
    "BloodVesselCRL": _RLC,
    "BloodVesselRC": {"Rpd": _POSITIVE, "Cp": _SCALAR},
}
FLOW = {"t": _SERIES, "Q": _SERIES}
PRESSURE = {"t": _SERIES, "P": _SERIES}
COUPLINGS: dict[str, Parameters] = {"FLOW": FLOW, "PRESSURE": PRESSURE}
BOUNDARIES: dict[str, Parameters] = {
    "FLOW": FLOW,
    "PRESSURE": PRESSURE,
    "RESISTANCE": _scalars("R Pd"),
    "RCR": {**_scalars("Rp C Rd"), "Pd": _OPTIONAL},
    "CORONARY": {**_OPEN_CORONARY, "Ra2": _SCALAR, "closed_loop_outlet": _FLAG},
    "CORONARY_VAR_RES": {
        **_OPEN_CORONARY,
        **_scalars("Ra2_min Ra2_max"),
        "T_vc": _POSITIVE,
        "T_vr": _POSITIVE,
        "closed_loop_outlet": _FLAG,
    },
    "ClosedLoopRCR": {**_scalars("Rp C Rd"), "closed_loop_outlet": _FLAG},
    "ClosedLoopCoronaryLeft": _scalars("Ra Ram Rv Ca Cim"),
    "ClosedLoopCoronaryRight": _scalars("Ra Ram Rv Ca Cim"),
}
JUNCTIONS: dict[str, Parameters] = {
    "NORMAL_JUNCTION": {},
    "internal_junction": {},
    "BloodVesselJunction": {
        "R_poiseuille": _SCALAR,
        "L": _SCALAR,
        "stenosis_coefficient": _SCALAR,
    },
}
_HEART = _scalars(
    "Erv_s Elv_s iml imr Lra_v Rra_v Lrv_a Rrv_a Lla_v Rla_v Llv_a Rlv_ao Vrv_u Vlv_u Rpd Cp Cpa "
    "Kxp_ra Kxv_ra Kxp_la Kxv_la Emax_ra Emax_la Vaso_ra Vaso_la"
)
CLOSED_LOOP: dict[str, Parameters] = {
    "ClosedLoopHeartAndPulmonary": {
        "Tsa": _POSITIVE,
        "tpwave": _POSITIVE,
        **_HEART,
        "Rpd": _POSITIVE,
        "Gao_leak": Parameter(required=False, ours=True),
    }
}
_VALVE = {**_scalars("Rmax Rmin"), "upstream_block": _NAME, "downstream_block": _NAME}
VALVES: dict[str, Parameters] = {"ValveTanh": {**_VALVE, "Steepness": _POSITIVE}, "PiecewiseValve": _VALVE}
CHAMBERS: dict[str, Parameters] = {
    "LinearElastanceChamber": _scalars("Emax Epass Vrest"),
    "ChamberElastanceInductor": _scalars("Emax Emin Vrd Vrs Impedance"),
    "ChamberElastanceInductorExponential": _scalars("Emax Kxp Kxv Vaso Impedance"),
}
ACTIVATIONS: dict[str, Parameters] = {
    "half_cosine": {"t_active": _SCALAR, "t_twitch": _POSITIVE},
    "piecewise_cosine": {
        **_scalars("contract_start relax_start"),
        "contract_duration": _POSITIVE,
        "relax_duration": _POSITIVE,
    },
    "two_hill": {"t_shift": _SCALAR, **dict.fromkeys(("tau_1", "tau_2", "m1", "m2"), _POSITIVE)},
    "fourier": {},
    "wrapping_cosine": {"Tsa": _POSITIVE, "tpwave": _POSITIVE},
}
"""Activation functions of chambers, under `activation_function`."""
IGNORED: dict[str, frozenset[str]] = {
    "": frozenset({"calibration_parameters", "y", "dy"}),
    "vessels": frozenset({"vessel_D", "generation", "viscosity", "density"}),
}
"""Keys that svZeroDSolver's companions (its calibrator, svZeroDTrees) write into its files and the solver ignores."""
