"""Pullbacks for tests."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.zerod.effects.pullback import Pullback


def pulled_through(
    *path: str, distance: Sequence[float] = (0.0, 1.5, 3.0), length: float = 3.0, quantity="pullback pressure",
    condition: str = "rest", statistic: str = "mean", root_pressure: float = 1.0,
) -> Measured:  # fmt: skip
    """A pullback of zeros with a standard deviation of 1 mmHg along a path; distances and length in cm."""
    x = np.asarray(distance, dtype=float)
    weight = 0.5 + 0.5 * (x.max() - x) / max(float(np.ptp(x)), 1e-9)
    pullback = Pullback(path, x, length, MMHG * weight, 1.0, 0.5, root_pressure)
    name, value = ">".join(path), np.zeros(x.size)
    return Measured(condition, quantity, name, statistic, None, 0.85, value, value + MMHG, pullback=pullback)
