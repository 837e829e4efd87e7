"""Units in which figures and pages show the quantities of measurements."""

from coronaryuq.core import units
from coronaryuq.zerod.effects.pullback import CHECK, OF_WIRE

SHOWN_IN = {
    "pressure": (units.MMHG, "mmHg"),
    "flow": (units.ML_PER_MIN, "mL/min"),
    "perfusion": (units.MBF_PER_MIN_PER_G, "mL/min/g"),
    "volume": (1.0, "mL"),
}


def shown_in(quantity: str) -> tuple[float, str]:
    """Return the size in CGS of the unit in which a quantity is shown, and its name; readings of a wire included."""
    return SHOWN_IN.get("pressure" if quantity == CHECK else quantity.removeprefix(OF_WIRE), (1.0, ""))
