"""From a candidate to the neighbourhood of the targets: bounded least squares, before Nelder-Mead refines.

Pressure, output and filling are coupled (more blood raises all of them, a stiffer aorta the pulse and the ejection
fraction), so the valley that leads to the targets is narrow and oblique to the coordinates. Nelder-Mead creeps along
it; least-squares steps, whose 36 differences are one batch of the engine, follow it quickly.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

STEP = 0.02
"""Of each parameter's range, for differences."""

Residuals = Callable[[np.ndarray], np.ndarray]
"""Residuals (n, m) of points (n, d), run as one batch."""


def approach(residuals: Residuals, start: np.ndarray, lower: np.ndarray, upper: np.ndarray, steps: int) -> np.ndarray:
    """Return the point (d,) after at most `steps` evaluations of scipy's trust-region least squares from `start`."""
    width = upper - lower

    def value(x: np.ndarray) -> np.ndarray:
        return residuals((lower + width * x)[None])[0]

    def jacobian(x: np.ndarray) -> np.ndarray:
        step = np.where(x + STEP <= 1.0, STEP, -STEP)
        points = np.vstack([x, x + np.diag(step)])
        values = residuals(lower + width * points)
        return ((values[1:] - values[0]) / step[:, None]).T

    first = np.clip((start - lower) / width, 0.0, 1.0)
    result = least_squares(value, first, jacobian, bounds=(0.0, 1.0), max_nfev=steps, x_scale=1.0)
    return lower + width * result.x
