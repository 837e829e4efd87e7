"""Conversions between clinical units and CGS; nothing else in the package converts.

Inside the package everything is CGS: cm, g, s, dyn/cm2, poise. Each constant is one clinical unit in CGS: multiply to
read, divide to report.
"""

import re
from collections.abc import Iterable

MMHG = 1333.22
"""dyn/cm2 per mmHg, the value in svZeroDSolver's own cases."""

ML_PER_MIN = 1.0 / 60.0
"""mL/s per mL/min."""

L_PER_MIN = 1000.0 / 60.0
"""mL/s per L/min."""

MM = 0.1
"""cm per mm."""

MBF_PER_MIN_PER_G = 1.0 / 60.0
"""mL/s/g per mL/min/g."""

TISSUE_DENSITY = 1.05
"""Density of myocardium, g/mL (Vinnakota & Bassingthwaighte 2004)."""

BLOOD_DENSITY = 1.06
"""g/cm3 (paper, section 2.2)."""

BLOOD_VISCOSITY = 0.04
"""Poise (paper, section 2.2)."""

LENGTHS = {"cm": 1.0, "mm": MM, "m": 100.0}
PRESSURES = {"dyn/cm2": 1.0, "mmHg": MMHG, "Pa": 10.0, "kPa": 1e4}
FLOWS = {"mL/s": 1.0, "cm3/s": 1.0, "mL/min": ML_PER_MIN, "L/min": L_PER_MIN}
VOLUMES = {"mL": 1.0, "cm3": 1.0, "L": 1000.0}
RATIOS = {"1": 1.0, "%": 0.01}
RATES = {"1/min": 1.0, "bpm": 1.0, "1/s": 60.0, "Hz": 60.0}
SPELLINGS = {"cc": "ml", "cm3": "ml", "dyne": "dyn", "dynes": "dyn", "beats": "1", "": "1"}
SPELLINGS |= {
    "millimetre": "mm",
    "centimetre": "cm",
    "metre": "m",
    "millimeter": "mm",
    "centimeter": "cm",
    "meter": "m",
}
"""Spellings of one unit, in lower case."""


def percent(share: float, decimals: int = 0) -> str:
    """Return a share in per cent, with a space before the sign: 19 %."""
    return f"{100 * share:.{decimals}f} %"


def standard_unit(written: str, known: Iterable[str]) -> str | None:
    """Return the known unit that a text means; None if there is none.

    Capitals, blanks, brackets, and the order and notation of the divisors do not matter: `ml/100 g/min` and
    `mL min^-1 (100 g)^-1` are `mL/min/100g`.

    Parameters
    ----------
    written
        The text.
    known
        Units that are allowed here.
    """
    if written in (known := tuple(known)):
        return written
    return next((unit for unit in known if _factors(unit) == _factors(written)), None)


def _factors(unit: str) -> tuple[str, ...]:
    """Return a unit's numerator and its sorted divisors, each spelt in one way."""
    text = unit.lower().translate(str.maketrans("⁻¹²³", "-123"))
    text = re.sub(r"(?<=\d)(?<!-1)\s+(?=[a-z])", "", text)
    text = re.sub(r"\(([^()/]*)\)(?=\s*\^?-1)", lambda match: match[1].replace(" ", ""), text)
    text = re.sub(r"[·*.\s]+([0-9]*[a-z]+)\s*\^?-1\b", r"/\1", text)
    text = re.sub(r"/\s*\(([^()]*)\)", lambda match: "/" + re.sub(r"[\s·*.]+", "/", match[1].strip()), text)
    text = re.sub(r"[\s^()]+", "", re.sub(r"\s+per\s+", "/", text))
    numerator, *divisors = (_spelt(part) for part in text.split("/"))
    return numerator, *sorted(divisors)


def _spelt(part: str) -> str:
    amount, name = re.fullmatch(r"(\d*(?=[a-z]))?(.*)", part, re.DOTALL).groups(default="")  # type: ignore[union-attr]
    return amount + SPELLINGS.get(name, SPELLINGS.get(name.removesuffix("s"), name))


def pressure_factor(unit: str, pressure: float) -> float:
    """Return dyn/cm2 per unit of pressure; "auto" means mmHg if an arterial pressure is below 1000."""
    if unit == "auto":
        return MMHG if abs(pressure) < 1000.0 else 1.0
    return PRESSURES[unit]


def perfusions(tissue_density: float = TISSUE_DENSITY) -> dict[str, float]:
    """Return the factor from each unit of myocardial blood flow to mL/s/g.

    Parameters
    ----------
    tissue_density
        Density of myocardium, g/mL, for units per volume of tissue.
    """
    return {
        "mL/s/g": 1.0,
        "mL/min/g": MBF_PER_MIN_PER_G,
        "mL/min/100g": MBF_PER_MIN_PER_G / 100.0,
        "mL/min/mL": MBF_PER_MIN_PER_G / tissue_density,
        "mL/min/100mL": MBF_PER_MIN_PER_G / 100.0 / tissue_density,
    }
