"""Checks of one recorded beat: a whole beat, columns in their places, no artefact."""

from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.core.artefacts import largest_spike, longest_rest, rises
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import line_number
from coronaryuq.core.units import percent
from coronaryuq.discrepancy.data.measurements import AORTIC, LEAST_POINTS, WIDEST_GAP

TIME, AORTA, VENTRICLE, FLOW = "t abs [s]", "AoP [mmHg]", "LVP [mmHg]", "LAD Flow [ml/s]"
"""Headings of the recorder. The artery may differ, case is ignored, and other units are converted to these."""
SHORTEST, LONGEST = 0.1, 3.0
"""Plausible length of a beat, s."""
LARGEST_JUMP = 0.1
"""Difference between the ends of a pressure, over its range, above which a recording is not a whole beat, unless some
successive readings differ as much: breathing changes a pulse by less, and a trigger may lie in the upstroke."""
LOST = 0.05
"""Fraction of a beat without readings that are closer elsewhere; the pressure drives the model there, too."""
LEAST_PEAK = 0.85
"""Least peak of the ventricle's pressure over the aortic one: it ejects above it only, and two catheters may differ."""
LONGEST_REST = 0.2
"""Part of a beat during which a reading may stay at one value; beyond this the signal was lost or clipped."""
LARGEST_SPIKE = 0.3
"""Largest deviation of a reading from the median of five, over the range of the beat; no pressure or flow moves so far
and back within two readings."""
ENOUGH_FOR_SPIKES = 50
"""Readings of a beat from which on the upstroke of a pressure takes more than two of them."""


def check_beat(path: Path, frame: pd.DataFrame) -> None:
    """Raise `InputError` unless this is a plausible whole beat of a coronary artery.

    frame: columns `TIME` (s), `AORTA` and `VENTRICLE` (mmHg), `FLOW`; its last row is the first one of the next beat.
    """
    _check_times(path, frame[TIME].to_numpy(float))
    for name in (AORTA, VENTRICLE, FLOW):
        _check_readings(path, name, frame[name].to_numpy(float))
    _check_columns(path, frame)
    for name in (AORTA, VENTRICLE):
        values = frame[name].to_numpy(float)
        jump, step = (
            float(change) / np.ptp(values) for change in (abs(values[-1] - values[0]), abs(np.diff(values)).max())
        )
        if jump > max(LARGEST_JUMP, step):
            raise InputError(path, name, percent(jump), "of its range between start and end; expected one whole beat")


def _check_times(path: Path, time: np.ndarray) -> None:
    if len(time) <= LEAST_POINTS:
        raise InputError(path, TIME, len(time), f"times; expected at least {LEAST_POINTS + 1} over one beat")
    if (np.diff(time) <= 0).any():
        row = int(np.argmax(np.diff(time) <= 0)) + 1
        remedy = f"line {line_number(path, row)}: times must increase; sort the table"
        raise InputError(path, TIME, float(time[row]), remedy)
    if not SHORTEST <= time[-1] - time[0] <= LONGEST:
        remedy = f"outside {SHORTEST} to {LONGEST} s; give one beat and check the unit of time"
        raise InputError(path, f"{TIME}: duration", float(time[-1] - time[0]), remedy)
    spacing = np.diff(time) / (time[-1] - time[0])
    gap, widest = float(spacing.max()), float(min(WIDEST_GAP, max(LOST, 3.0 * np.median(spacing))))
    if gap > widest:
        remedy = f"expected at most {widest:.2g}; remove the recording, or cut out another beat"
        raise InputError(path, f"{TIME}: largest gap over the beat", float(f"{gap:.2g}"), remedy)


def _check_columns(path: Path, frame: pd.DataFrame) -> None:
    """Raise `InputError` if a column cannot be what its heading says."""
    aorta, ventricle, flow = (frame[name].to_numpy(float) for name in (AORTA, VENTRICLE, FLOW))
    mean, peak, low, span = (float(of(aorta)) for of in (np.mean, np.max, np.min, np.ptp))
    exchanged = "check whether columns are exchanged"
    # What is checked, its value, its bounds, and what to do beyond these.
    checks = [
        (f"mean {AORTA}", mean, *AORTIC, f"outside {AORTIC[0]:g} to {AORTIC[1]:g}; check the unit"),
        (f"mean {VENTRICLE}", ventricle.mean(), -np.inf, mean,
         f"above the mean aortic pressure, {mean:.3g}; check whether the two are exchanged"),
        (f"range of {AORTA}", span, 0.0, mean, f"above the mean, {mean:.3g}, unlike an aortic pressure; {exchanged}"),
        (f"peak of {VENTRICLE}", ventricle.max(), LEAST_PEAK * peak, np.inf,
         f"far below that of the aorta, {peak:.3g}; {exchanged}, and the units"),
        (f"minimum of {VENTRICLE}", ventricle.min(), -np.inf, low, f"above that of the aorta, {low:.3g}; {exchanged}"),
        (f"mean {FLOW}", flow.mean(), np.nextafter(0.0, 1.0), np.inf,
         "not positive; change the sign if the probe was reversed"),
        (f"{VENTRICLE}: number of systoles", rises(ventricle), 1, 1,
         "expected one; cut out one beat, or average the beats"),
    ]  # fmt: skip
    for field, value, least, most, remedy in checks:
        if not least <= value <= most:
            raise InputError(path, field, value if isinstance(value, int) else round(float(value), 3), remedy)


def _check_readings(path: Path, name: str, values: np.ndarray) -> None:
    """Raise `InputError` for a signal that was lost or clipped, and for a spike."""
    (first, length), (spike, median) = longest_rest(values), largest_spike(values)
    if length > LONGEST_REST * len(values):
        remedy = f"from line {line_number(path, first)} on for {length} readings: "
        remedy += "lost or clipped; cut out another beat"
        raise InputError(path, name, round(float(values[first]), 3), remedy)
    if len(values) >= ENOUGH_FOR_SPIKES and abs(values[spike] - median) > LARGEST_SPIKE * np.ptp(values):
        remedy = f"line {line_number(path, spike)}: a spike, {median:.3g} around it; "
        remedy += "remove the line, or cut out another beat"
        raise InputError(path, name, round(float(values[spike]), 3), remedy)
