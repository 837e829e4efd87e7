"""Clinical and literature targets of the closed loop: meaning, tolerance and plausible range of each."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from coronaryuq.case.case_json import TargetValue
from coronaryuq.core.errors import InputError, nearest
from coronaryuq.core.units import FLOWS, PRESSURES, RATES, RATIOS, VOLUMES, standard_unit


@dataclass(frozen=True)
class Target:
    """One target: misfit = (simulated - measured) / tolerance.

    `tolerance` is in `unit` or, if `relative`, a fraction of the value. Values outside `plausible` (in `unit`) are
    rejected as a wrong unit or a typing error. `clinical` targets are measured on the patient, others are population
    averages.
    """

    name: str
    description: str
    unit: str
    tolerance: float
    plausible: tuple[float, float]
    clinical: bool = False
    relative: bool = False

    def size(self, value: float) -> float:
        """Return the tolerance of a measured value, in `unit`."""
        return self.tolerance * (abs(value) if self.relative else 1.0)


TARGETS = (
    Target("PaoMin", "Minimum aortic pressure", "mmHg", 0.02, (25.0, 200.0), True, True),
    Target("PaoMax", "Maximum aortic pressure", "mmHg", 0.02, (40.0, 300.0), True, True),
    Target("PaoMean", "Mean aortic pressure", "mmHg", 0.02, (30.0, 250.0), True, True),
    Target("AorCorSplit", "Coronary fraction of cardiac output", "%", 0.02, (0.2, 20.0), True, True),
    Target("AbsQin", "Stroke volume", "mL", 0.02, (5.0, 300.0), True, True),
    Target("Qsystole_perc", "Fraction of aortic flow ejected in systole", "1", 0.1, (0.2, 1.5)),
    Target("PpulMean", "Mean pulmonary artery pressure", "mmHg", 0.1, (3.0, 100.0), False, True),
    Target("EFLV", "Left ventricular ejection fraction", "1", 0.02, (0.05, 0.95), True, True),
    Target("ESV", "End-systolic volume of the left ventricle", "mL", 0.02, (2.0, 500.0), True, True),
    Target("EDV", "End-diastolic volume of the left ventricle", "mL", 0.02, (10.0, 700.0), True, True),
    Target("QlaRatio", "Early over late peak mitral flow (E/A)", "1", 0.236, (0.05, 10.0)),
    Target("mitValveTime", "Fraction of the cycle with open mitral valve", "1", 0.084, (0.02, 0.98)),
    Target("aorValveTime", "Fraction of the cycle with open aortic valve", "1", 0.051, (0.02, 0.98)),
    Target("pulValveTime", "Fraction of the cycle with open pulmonary valve", "1", 0.051, (0.02, 0.98)),
    Target("PraMean", "Mean right atrial pressure", "mmHg", 1.2, (-5.0, 40.0)),
    Target("LCorMaxRatio", "Diastolic over systolic peak flow, left coronary", "1", 0.4, (0.1, 50.0)),
    Target("LCorTotRatio", "Diastolic over systolic volume of flow, left coronary", "1", 1.0, (0.1, 50.0)),
    Target("LThirdFF", "Left coronary flow in the third of a cycle after valve closure", "1", 0.02, (0.01, 1.0)),
    Target("LHalfFF", "Left coronary flow in the half of a cycle after valve closure", "1", 0.03, (0.01, 1.2)),
    Target("LGradOK", "Peaks and valleys of left coronary flow, out of five", "1", 1.0, (0.0, 5.0)),
    Target("RCorMaxRatio", "Diastolic over systolic peak flow, right coronary", "1", 0.3, (0.1, 50.0)),
    Target("RCorTotRatio", "Diastolic over systolic volume of flow, right coronary", "1", 1.0, (0.1, 50.0)),
    Target("RThirdFF", "Right coronary flow in the third of a cycle after valve closure", "1", 0.07, (0.01, 1.0)),
    Target("RHalfFF", "Right coronary flow in the half of a cycle after valve closure", "1", 0.07, (0.01, 1.2)),
    Target("RGradOK", "Peaks and valleys of right coronary flow, out of five", "1", 1.0, (0.0, 5.0)),
    Target("PaoMin_conv", "Change of minimum aortic pressure from cycle to cycle", "mmHg", 1.0, (0.0, 10.0)),
    Target("PaoMax_conv", "Change of maximum aortic pressure from cycle to cycle", "mmHg", 1.0, (0.0, 10.0)),
    Target("PaoMean_conv", "Change of mean aortic pressure from cycle to cycle", "mmHg", 1.0, (0.0, 10.0)),
    Target("AbsQin_conv", "Change of stroke volume from cycle to cycle", "mL", 1.0, (0.0, 10.0)),
)  # fmt: skip
"""Tolerances of clinical targets are 2 % of the value, so that the tuned loop stays well within the 5 % that the method
requires. Those of population averages are the standard deviations of the public svZeroDEstimator
example (Tran et al. 2017), halved for the two coronary ratios whose published spread exceeds half their value. The
`_conv` targets are met by construction, because the loop is run to its periodic state; they are reported, not
tuned."""

OUTPUT_AND_RATE = (
    Target("CO", "Cardiac output", "L/min", 0.02, (0.3, 30.0), True, True),
    Target("HR", "Heart rate", "1/min", 0.02, (20.0, 300.0), True, True),
)
"""Measured instead of the stroke volume and the period, which follow from them (`needed_targets`)."""
BY_NAME = {target.name: target for target in (*TARGETS, *OUTPUT_AND_RATE)}


def names_reference() -> str:
    """Write a Markdown table of the names that a table of targets may have."""
    head = ["### Names in `targets`", "", "| name | what | unit | usually measured in |", "|---|---|---|---|"]
    rows = [
        f"| `{one.name}` | {one.description} | {one.unit} | {'patient' if one.clinical else 'population average'} |"
        for one in (*OUTPUT_AND_RATE, *TARGETS)
        if not one.name.endswith("_conv")
    ]
    return "\n".join([*head, *rows, ""])


def check_targets(targets: Mapping[str, TargetValue], file: str | Path) -> dict[str, float]:
    """Return the targets that have a value, in their own units.

    Parameters
    ----------
    targets
        Targets by name; a unit of None is the target's own.
    file
        The file named in errors.

    Raises
    ------
    InputError
        For an unknown name or unit, an implausible value, and values that contradict one another.
    """
    values: dict[str, float] = {}
    for name, entry in targets.items():
        value, unit = entry.value, entry.unit
        if name not in BY_NAME:
            raise InputError(
                file, name, value, f"unknown target; {nearest(name, BY_NAME)}known targets: {', '.join(BY_NAME)}"
            )
        if value is None:
            continue
        target = BY_NAME[name]
        number = value * _factor(target, unit, file)
        low, high = target.plausible
        if not low <= number <= high:
            unit = "" if target.unit == "1" else f" {target.unit}"
            remedy = f"implausible: {number:.6g}{unit}, expected {low:g} to {high:g}{unit}"
            if target.unit == "1" and low <= number / 100 <= high:
                remedy += "; give a fraction, not per cent"
            raise InputError(file, name, value, remedy)
        values[name] = number
    for smaller, larger in (("PaoMin", "PaoMean"), ("PaoMean", "PaoMax"), ("PaoMin", "PaoMax"), ("ESV", "EDV")):
        if smaller in values and larger in values and values[smaller] >= values[larger]:
            raise InputError(file, smaller, values[smaller], f"must be below {larger}, {values[larger]:g}")
    return values


def _factor(target: Target, unit: str | None, file: str | Path) -> float:
    """Return the factor from `unit` to the target's own unit."""
    if unit is None:
        return 1.0
    table = next(table for table in (PRESSURES, VOLUMES, RATIOS, FLOWS, RATES) if target.unit in table)
    known = standard_unit(unit, table)
    if known is None:
        raise InputError(file, f"{target.name}.unit", unit, f"expected one of {', '.join(table)}")
    return table[known] / table[target.unit]
