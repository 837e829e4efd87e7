"""The 3D quantities as the page shows them: name, unit, and one number of decimals for every number of a quantity."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.estimation.results import RowReport, Value

FFR = "ffr_"
LOWEST_FFR = "lowest_ffr_"
FFR_DECIMALS = 3
"""Digits of a mean of FFR. A pressure wire has two; the third shows how close the mean is to the threshold."""
MOST_DECIMALS = 4
NARROW = 0.02
"""Width of an interval of a probability below which it is shown with a decimal of its per cent."""
ROUNDING = 1e-12
"""Relative standard error of a quantity that is the same in all runs, at most."""


@dataclass(frozen=True)
class Kind:
    """A kind of 3D quantity.

    scale: of the number shown to that in the tables. extreme: has settled on no mesh. of_artery: of an artery, and not
    of a stenosis. shear: of the wall.
    """

    name: str
    unit: str = ""
    scale: float = 1.0
    extreme: bool = False
    of_artery: bool = False
    shear: bool = True

    @property
    def heading(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


KINDS = {
    FFR: Kind("FFR", shear=False),
    LOWEST_FFR: Kind("Lowest FFR", of_artery=True, shear=False),
    "pressure_drop_": Kind("Pressure drop", "mmHg", shear=False),
    "tawss_patch_min_": Kind("Patch-min TAWSS", "dyn/cm²"),
    "low_shear_area_": Kind("Low-shear area", "%", 100.0),
    "osi_patch_max_": Kind("Patch-max OSI"),
    "osi_max_": Kind("Max OSI", extreme=True),
    "tawss_min_": Kind("Min TAWSS", "dyn/cm²", extreme=True),
}
"""By the beginning of their 3D columns."""


def kind_of(column: str) -> Kind:
    """Return the kind of a 3D column; one outside `KINDS` has the column's name."""
    return next((kind for prefix, kind in KINDS.items() if column.startswith(prefix)), Kind(column))


class Digits:
    """Formats the numbers of one 3D quantity, all with the same scale and decimals.

    Decimals follow from the widest interval of its recommended estimates: two digits of the width, three for FFR.

    Parameters
    ----------
    column
        3D column, of any artery.
    rows
        All rows of `estimates.json`.
    """

    def __init__(self, column: str, rows: Sequence[RowReport]):
        self.kind = kind_of(column)
        same = [row for row in rows if kind_of(row.column_3d) == self.kind and not constant(row)]
        intervals = [row.recommended_report.calibrated for row in same]
        width = max(((one.high - one.low) * self.kind.scale for one in intervals), default=0.0)
        wanted = 1 - int(np.floor(np.log10(width))) if width > 0 else 0
        of_ffr = column.startswith((FFR, LOWEST_FFR))
        self.decimals = FFR_DECIMALS if of_ffr else min(max(wanted, 0), MOST_DECIMALS)

    def __call__(self, value: float | None) -> str:
        """Format a value of the quantity, or one with its unit, such as a standard error; a dash for none."""
        if value is None or not np.isfinite(value):
            return "–"
        return f"{value * self.kind.scale:.{self.decimals}f}"

    def error(self, value: float | None) -> str:
        """Format a standard error, with a digit more."""
        if value is None or not np.isfinite(value):
            return "–"
        return f"{value * self.kind.scale:.{self.decimals + 1}f}"


def constant(row: RowReport) -> bool:
    """Return whether the quantity is the same in all runs, so that its interval has no width."""
    report = row.recommended_report
    return report.std <= ROUNDING * abs(report.mean) or report.std == 0


class Percent:
    """Formats probabilities, all with the same decimals: one if every interval is narrow, none otherwise.

    A probability that rounds to 0 or 100 % and is not certain reads as < 1 % or > 99 %, with these decimals.

    Parameters
    ----------
    rows
        All rows of `estimates.json`.
    """

    def __init__(self, rows: Sequence[RowReport]):
        zones = [zone for row in rows for zone in row.beyond_the_mean.zones or []]
        self.decimals = 1 if max((zone.high - zone.low for zone in zones), default=0.0) < NARROW else 0

    def end(self, share: float) -> str:
        """Format one end of an interval, or a width."""
        return f"{100 * min(max(share, 0.0), 1.0):.{self.decimals}f} %"

    def __call__(self, probability: Value) -> str:
        """Format a probability."""
        least = 0.01 / 10**self.decimals
        if probability.value < least / 2 and probability.high > 0:
            return f"< {self.end(least)}"
        if probability.value > 1 - least / 2 and probability.low < 1:
            return f"> {self.end(1 - least)}"
        return self.end(probability.value)

    def in_words(self, probability: Value) -> str:
        """Format a probability for a sentence."""
        return self(probability).replace("<", "below").replace(">", "above")
