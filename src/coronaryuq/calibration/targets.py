"""Clinical and literature targets of calibration: reading them, and the misfit of a simulation."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from coronaryuq.case.case_json import TargetValue
from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.case.tables.read import csv_targets
from coronaryuq.case.tables.targets import BY_NAME, TARGETS, check_targets
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG

TUNED = tuple(target.name for target in TARGETS if not target.name.endswith("_conv"))

PRESSURES = ("PaoMin", "PaoMax", "PaoMean")
"""Aortic pressures, which have one cuff."""

CGS = {"mmHg": MMHG, "mL": 1.0, "1": 1.0, "%": 1.0}
"""CGS value of one unit of a target (a percentage stays one: the split is given in per cent)."""


def read_targets(file: str | Path, unit_system: str = "auto") -> dict[str, float]:
    """Read targets in their own units from a table of name, description, value or `none`.

    `unit_system`: `cgs` (pressures in dyn/cm2), `mmHg` or `auto`, which decides by the mean or maximum aortic
    pressure: below 1000 it can only be mmHg, above only dyn/cm2. A column `unit` overrides it.
    """
    table = csv_targets(Path(file))
    values = {name: value for name, (_, value, _) in table.items()}
    pressure = {"cgs": "dyn/cm2", "mmHg": "mmHg"}.get(unit_system) or _pressure_unit(values, file)
    units = {target.name: pressure if target.unit == "mmHg" else target.unit for target in TARGETS}
    targets = {name: TargetValue(value=value, unit=unit or units.get(name)) for name, (_, value, unit) in table.items()}
    return check_targets(targets, file)


def _pressure_unit(values: Mapping[str, float | None], file: str | Path) -> str:
    for name in ("PaoMean", "PaoMax", "PaoMin", "PpulMean"):
        value = values.get(name)
        if value is not None:
            return "mmHg" if value < 1000.0 else "dyn/cm2"
    raise InputError(file, "PaoMean", None, "an aortic pressure is needed; without one the loop cannot be tuned")


def misfits(simulated: Mapping[str, np.ndarray], measured: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return (simulated - measured) / tolerance of every tuned target; both in the targets' own units."""
    result = {}
    for name in TUNED:
        if name in measured:
            misfit = np.asarray(simulated[name], float) - measured[name]
            result[name] = misfit / BY_NAME[name].size(measured[name])
    return result


def counted(name: str) -> bool:
    """Return whether a target is a score, which counts features of a waveform and has no derivative."""
    return name.endswith("GradOK")


def measurement_covariance(targets: Mapping[str, float], names: Sequence[str], errors: RoutineErrors) -> np.ndarray:
    """Return the covariance (d, d) of the errors of named targets, in their units.

    Clinical targets have the case's errors, population averages their spread, which is their tolerance.
    """
    relative = {
        "AbsQin": errors.stroke_volume, "ESV": errors.ventricular_volume, "EDV": errors.ventricular_volume,
        "AorCorSplit": errors.coronary_share,
    }  # fmt: skip
    own = {"EFLV": errors.ejection_fraction} | dict.fromkeys(PRESSURES, errors.pressure)
    sd = []
    for name in names:
        target = BY_NAME[name]
        tolerance = target.size(targets[name])
        # A measurement without error is still met only to the tolerance of tuning.
        least = 0.5 * tolerance if target.clinical else tolerance
        sd.append(max(own.get(name, relative.get(name, 0.0) * abs(targets[name])), least))
    correlation = np.eye(len(names))
    cuff = [k for k, name in enumerate(names) if name in PRESSURES]
    correlation[np.ix_(cuff, cuff)] += errors.pressure_correlation * (1.0 - np.eye(len(cuff)))
    return correlation * np.outer(sd, sd)


def in_own_units(measures: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Convert measures of a CGS network (`zerod.cardiac_function.measure`) to the targets' units."""
    return {name: np.asarray(value) / CGS[BY_NAME[name].unit] for name, value in measures.items()}
