"""Names of the posterior's inputs in words."""

from coronaryuq.case.case_json import CaseSummary
from coronaryuq.case.lumen.law import COMMON, MODES, REST
from coronaryuq.case.network.parameter_names import HEART, LUMEN, UNMEASURED
from coronaryuq.zerod.network.beds import SCALING

ARTERIES = ("LM", "LAD", "LCx", "RCA")
HEART_COMPONENTS = 9
"""More than any heart has had."""


def input_names(case: CaseSummary) -> dict[str, str]:
    """Return the name of each input of the posterior in words, those of `uncertainty: full` among them."""
    names = {outlet.bc: f"the resistance of the {outlet.label} bed" for outlet in case.outlets}
    names |= {SCALING: "the total coronary resistance", COMMON: "the lumen of all arteries"}
    for artery in ARTERIES:
        names |= {f"{LUMEN}{artery}_{k}": f"the lumen of the {artery} (component {k})" for k in range(1, MODES + 1)}
        names[f"{LUMEN}{artery}{REST}"] = f"the lumen of the {artery} (the rest)"
        names[f"{UNMEASURED}{artery}"] = f"the beds of the {artery} without measured flow"
    names |= {f"{HEART}{k}": f"the heart (component {k})" for k in range(1, HEART_COMPONENTS + 1)}
    return names | {
        "hyperaemia": "the fall of resistance under hyperaemia",
        "viscosity": "the viscosity of blood",
        "murray_exponent": "Murray's exponent",
    }
