"""The 36 parameters of calibration: meaning, initial value, range, and place in the network."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.case.network.network import HEART, Network
from coronaryuq.core.units import MMHG

FACTORS = {
    "1": 1.0,
    "mL": 1.0,
    "1/mL": 1.0,
    "mmHg": MMHG,
    "mmHg/mL": MMHG,
    "mL/mmHg": 1.0 / MMHG,
    "mmHg s/mL": MMHG,
    "dyn s/cm5": 1.0,
    "dyn s2/cm5": 1.0,
}
"""CGS value of one unit of each parameter."""


@dataclass(frozen=True)
class Parameter:
    """One parameter, with `initial`, `lower` and `upper` in `unit`.

    The search uses the logarithm of `logarithmic` parameters. `block` is the search that tunes it (see
    `calibration.search`); `heart` names a parameter of the heart block, `beds` a factor on that parameter of every bed
    of the named types.
    """

    name: str
    description: str
    unit: str
    initial: float
    lower: float
    upper: float
    block: str
    heart: str | None = None
    beds: tuple[tuple[str, tuple[str, ...]], ...] = ()
    logarithmic: bool = True


def _heart(
    name: str, description: str, unit: str, initial: float, lower: float, upper: float, block: str,
    logarithmic: bool = True,
) -> Parameter:  # fmt: skip
    return Parameter(name, description, unit, initial, lower, upper, block, heart=name, logarithmic=logarithmic)


LEFT, RIGHT, SYSTEMIC = "ClosedLoopCoronaryLeft", "ClosedLoopCoronaryRight", "ClosedLoopRCR"
CORONARY = (LEFT, RIGHT)


def _beds(
    name: str, description: str, lower: float, upper: float, block: str, *beds: tuple[str, tuple[str, ...]]
) -> Parameter:
    return Parameter(name, description, "1", 1.0, lower, upper, block, beds=beds)


PARAMETERS = (
    # Activation and ventricles
    _heart("Tsa", "Duration of atrial systole over the period", "1", 0.405, 0.39, 0.43, "timing"),
    _heart("tpwave", "Period over the time of the P wave", "1", 8.98, 8.43, 9.31, "timing"),
    _heart("Erv_s", "Right ventricular elastance scaling", "mmHg/mL", 2.0, 0.95, 3.33, "right"),
    _heart("Elv_s", "Left ventricular elastance scaling", "mmHg/mL", 2.9, 1.14, 6.3, "circulation"),
    _heart("Vrv_u", "Unstressed volume of the right ventricle", "mL", 0.0, -10.0, 10.0, "right", False),
    _heart("Vlv_u", "Unstressed volume of the left ventricle", "mL", -2.0, -20.0, 10.0, "circulation", False),
    # Valves
    _heart("Lra_v", "Inertance of the tricuspid valve", "dyn s2/cm5", 0.4, 0.1, 0.84, "right"),
    _heart("Rra_v", "Resistance of the tricuspid valve", "dyn s/cm5", 10.0, 7.77, 13.14, "right"),
    _heart("Lrv_a", "Inertance of the pulmonary valve", "dyn s2/cm5", 0.4, 0.19, 0.7, "right"),
    _heart("Rrv_a", "Resistance of the pulmonary valve", "dyn s/cm5", 48.0, 32.0, 68.0, "right"),
    _heart("Lla_v", "Inertance of the mitral valve", "dyn s2/cm5", 0.5, 0.2, 1.2, "timing"),
    _heart("Rla_v", "Resistance of the mitral valve", "dyn s/cm5", 8.5, 4.78, 12.0, "timing"),
    _heart("Llv_a", "Inertance of the aortic valve", "dyn s2/cm5", 0.3, 0.03, 0.72, "timing"),
    _heart("Rlv_ao", "Resistance of the aortic valve", "dyn s/cm5", 24.0, 6.0, 61.0, "timing"),
    # Lungs and aorta
    _heart("Rpd", "Pulmonary resistance", "dyn s/cm5", 100.0, 40.0, 240.0, "circulation"),
    _heart("Cp", "Pulmonary compliance", "mL/mmHg", 1.08, 0.8, 2.0, "right"),
    _heart("Cpa", "Compliance of the proximal aorta", "mL/mmHg", 0.2, 0.03, 1.32, "circulation"),
    # Atria: passive pressure Kxp (exp(Kxv (V - Vaso)) - 1), active Emax (V - Vaso)
    _heart("Kxp_ra", "Passive pressure scale of the right atrium", "mmHg", 8.5, 1.0, 10.0, "right"),
    _heart("Kxv_ra", "Passive volume exponent of the right atrium", "1/mL", 0.0046, 0.003, 0.0051, "right"),
    _heart("Emax_ra", "Active elastance of the right atrium", "mmHg/mL", 0.3, 0.2, 0.5, "right"),
    _heart("Vaso_ra", "Unstressed volume of the right atrium", "mL", 4.0, -5.0, 10.0, "right", False),
    _heart("Kxp_la", "Passive pressure scale of the left atrium", "mmHg", 8.5, 1.0, 10.73, "filling"),
    _heart("Kxv_la", "Passive volume exponent of the left atrium", "1/mL", 0.008, 0.006, 0.0085, "filling"),
    _heart("Emax_la", "Active elastance of the left atrium", "mmHg/mL", 0.305, 0.2, 0.4, "filling"),
    _heart("Vaso_la", "Unstressed volume of the left atrium", "mL", 8.0, -1.69, 15.81, "filling", False),
    # Intramyocardial pressure
    _heart("iml", "Left intramyocardial pressure over left ventricular pressure", "1", 0.6, 0.3, 0.95, "coronary"),
    _heart("imr", "Right intramyocardial pressure over right ventricular pressure", "1", 0.9, 0.2, 1.28, "coronary"),
    # Totals of the beds, over what the initial scaling gave
    _beds("R_cor", "Coronary resistance (Ra, Ram)", 0.33, 3.0, "circulation", ("Ra", CORONARY), ("Ram", CORONARY)),
    _beds("Rv_cor", "Venous coronary resistance", 0.05, 6.0, "coronary", ("Rv", CORONARY)),
    _beds("Cim_l", "Left intramyocardial compliance", 0.1, 10.0, "coronary", ("Cim", (LEFT,))),
    _beds("Ca_l", "Left coronary arterial compliance", 0.1, 10.0, "coronary", ("Ca", (LEFT,))),
    _beds("Cim_r", "Right intramyocardial compliance", 0.1, 10.0, "coronary", ("Cim", (RIGHT,))),
    _beds("Ca_r", "Right coronary arterial compliance", 0.1, 10.0, "coronary", ("Ca", (RIGHT,))),
    _beds("R_sys", "Systemic resistance (Rp, Rd)", 0.33, 3.0, "circulation", ("Rp", (SYSTEMIC,)), ("Rd", (SYSTEMIC,))),
    _beds("C_sys", "Systemic compliance", 0.05, 5.0, "circulation", ("C", (SYSTEMIC,))),
    Parameter("V_blood", "Stressed blood volume, over the initial scaling's", "1", 1.0, 0.6, 1.8, "circulation"),
)  # fmt: skip
"""Initial values and ranges of the heart and lungs: Tran et al. 2017 and Menon et al. 2023, as the public
svZeroDEstimator example has them, widened for the aortic pulse (Cpa, Llv_a, Rlv_ao) and for right atrial volume. The
bed totals are relative to the analytic initial scaling (`calibration.initial_scaling`); R_cor to C_sys are the eight of
that example, V_blood is ours: a closed loop conserves the blood volume of its initial condition, which is therefore a
parameter in any case."""

BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}
NAMES = tuple(BY_NAME)
BLOCKS = ("circulation", "timing", "filling", "right", "coronary")


def columns(*blocks: str) -> np.ndarray:
    """Return the positions of the parameters of the named blocks."""
    return np.array([place for place, parameter in enumerate(PARAMETERS) if parameter.block in blocks])


def _searched(parameter: Parameter, value: float) -> float:
    return float(np.log(value)) if parameter.logarithmic else value


INITIAL = np.array([_searched(parameter, parameter.initial) for parameter in PARAMETERS])
LOWER = np.array([_searched(parameter, parameter.lower) for parameter in PARAMETERS])
UPPER = np.array([_searched(parameter, parameter.upper) for parameter in PARAMETERS])
PRIOR_SD = 0.25 * (UPPER - LOWER)
"""Standard deviation of each searched parameter's prior about its initial value, where measurements have errors."""
_LOGARITHMIC = np.array([parameter.logarithmic for parameter in PARAMETERS])


def values(points: np.ndarray) -> np.ndarray:
    """Return parameter values (n, 36) in their units, from searched coordinates (n, 36)."""
    points = np.atleast_2d(points)
    return np.where(_LOGARITHMIC, np.exp(np.where(_LOGARITHMIC, points, 0.0)), points)


def changes(points: np.ndarray, network: Network) -> dict[str, np.ndarray]:
    """Return the changes to `network` (CGS) that set the parameters of `points` (n, 36): `"BLOCK.parameter"` → (n,).

    Stressed blood volume is not a parameter of a block; `calibration.loop` puts it into the state that a run starts
    from.
    """
    by_name = dict(zip(NAMES, values(points).T, strict=True))
    changed = {}
    for parameter in PARAMETERS:
        if parameter.heart is not None:
            changed[f"{HEART}.{parameter.heart}"] = by_name[parameter.name] * FACTORS[parameter.unit]
        for member, kinds in parameter.beds:
            for bc in network.boundary_conditions:
                if bc["bc_type"] in kinds:
                    changed[f"{bc['bc_name']}.{member}"] = by_name[parameter.name] * bc["bc_values"][member]
    held = network.held
    return {name: value for name, value in changed.items() if name not in held}
