"""Stroke volume and mean aortic pressure, without which no loop can be tuned, from what was measured."""

from collections.abc import Mapping
from pathlib import Path

from coronaryuq.case.case_json import TargetValue
from coronaryuq.case.tables.targets import BY_NAME, check_targets
from coronaryuq.core.errors import InputError

STROKE_VOLUME, MEAN_PRESSURE, CARDIAC_OUTPUT, HEART_RATE = "AbsQin", "PaoMean", "CO", "HR"
OUTPUT_AT_REST = 5.0
"""L/min, of an adult at rest (Hall and Hall, Guyton's Textbook of Medical Physiology, chapter 20)."""
PRESSURE_AT_REST = 93.0
"""mmHg, of an adult with 120 over 80 mmHg."""
AGREEMENT = 0.1
"""Largest relative difference of two statements of the same quantity."""


def heart_period(targets: Mapping[str, TargetValue], period: float | None, file: str | Path) -> float | None:
    """Return the cardiac period, s: that of the heart rate among the targets, if there is one, else `period`.

    Raises
    ------
    InputError
        If both are given and differ.
    """
    rate = check_targets(targets, file).get(HEART_RATE)
    if rate is None:
        return period
    if period is not None and abs(60.0 / rate / period - 1.0) > AGREEMENT:
        remedy = f"is a period of {60.0 / rate:.3g} s, but the period is {period:.3g} s; correct one of them"
        raise InputError(file, HEART_RATE, rate, remedy)
    return period or 60.0 / rate


def complete_targets(
    targets: Mapping[str, TargetValue], period: float, file: str | Path
) -> tuple[dict[str, TargetValue], tuple[str, ...]]:
    """Add stroke volume and mean aortic pressure if they are missing; return all targets, and notes on their origin.

    Stroke volume: cardiac output times the period, else EDV less ESV, else the ejection fraction of EDV, else that of
    an adult at rest. Mean pressure: a third of the way from the minimum to the maximum, else that of an adult at rest.

    Parameters
    ----------
    targets
        By name, checked.
    period
        Cardiac period, s.
    file
        Their file, for error messages.

    Raises
    ------
    InputError
        If stroke volume and cardiac output contradict each other.
    """
    values = check_targets(targets, file)
    completed, notes = dict(targets), []
    for name, (value, origin) in ((STROKE_VOLUME, _stroke(values, period)), (MEAN_PRESSURE, _pressure(values))):
        known = BY_NAME[name]
        if name not in values:
            completed[name] = TargetValue(description=known.description, value=value, unit=known.unit)
            notes.append(f"{known.description.lower()} is not given: {value:.4g} {known.unit}, {origin} ({name})")
    output = values.get(CARDIAC_OUTPUT)
    if output is not None and STROKE_VOLUME in values:
        implied = output * 1000.0 / 60.0 * period
        if abs(implied / values[STROKE_VOLUME] - 1.0) > AGREEMENT:
            given = f"{STROKE_VOLUME} is {values[STROKE_VOLUME]:.3g} mL; correct one of them"
            remedy = f"with a period of {period:.3g} s is a stroke volume of {implied:.3g} mL, but {given}"
            raise InputError(file, CARDIAC_OUTPUT, output, remedy)
    return completed, tuple(notes)


def _stroke(values: Mapping[str, float], period: float) -> tuple[float, str]:
    """Return a stroke volume (mL) and where it is from."""
    if CARDIAC_OUTPUT in values:
        return values[CARDIAC_OUTPUT] * 1000.0 / 60.0 * period, f"cardiac output times the period of {period:.3g} s"
    if "EDV" in values and "ESV" in values:
        return values["EDV"] - values["ESV"], "end-diastolic less end-systolic volume"
    if "EDV" in values and "EFLV" in values:
        return values["EDV"] * values["EFLV"], "ejection fraction of the end-diastolic volume"
    rest = f"{OUTPUT_AT_REST:g} L/min of an adult at rest; give AbsQin, or CO (L/min), if it was measured"
    return OUTPUT_AT_REST * 1000.0 / 60.0 * period, rest


def _pressure(values: Mapping[str, float]) -> tuple[float, str]:
    """Return a mean aortic pressure (mmHg) and where it is from."""
    if "PaoMin" in values and "PaoMax" in values:
        third = values["PaoMin"] + (values["PaoMax"] - values["PaoMin"]) / 3.0
        return third, "a third of the way from minimum to maximum"
    return PRESSURE_AT_REST, "of an adult at rest; give PaoMean if it was measured"
