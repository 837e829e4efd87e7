"""Numerical error of a quantity, from the same samples on two or three meshes, time steps or cycles."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import brentq

Source = Literal["mesh", "time_step", "cycles", "assumed"]
Method = Literal["richardson", "range", "two_levels", "assumed"]

ORDER: dict[Source, float] = {"mesh": 2.0, "time_step": 1.0, "cycles": 1.0}
"""Order of the method: in the element size, in the time step, and in 2^-cycles. The convecting velocity is that of the
step's beginning: first order. The effect of the initial state is taken to halve from cycle to cycle."""
FACTOR = 2.0
"""An observed order within this factor of the method's is trusted."""
SAFETY = {"richardson": 1.25, "range": 3.0, "two_levels": 3.0}
"""Distance, with this factor, that bounds the error in 95 % of cases: grid convergence index on three and on two levels
(Roache 1998), and the range of values without an order (Eça and Hoekstra 2014)."""
COVERAGE = 2.0
"""Standard deviations to that bound (ASME V&V 20-2009)."""


ASSUMED = {"ffr_": 1 / 3, "lowest_ffr_": 1 / 3, "pressure_drop_": 1 / 2}
"""Beginnings of the names of what has an assumed error where that of the mesh was not measured → its standard
deviation, relative to the pressure that is lost, times the square of the number of elements over the radius of a
throat: of second order, as the method. Measured on synthetic patients by benchmarks/mesh_error.py
(docs/explanation/flow3d.md)."""
LOSSES = ("ffr_", "lowest_ffr_")
"""Beginnings of the names of FFR: of its loss, 1 - FFR, the error is a fraction."""
FRACTIONS = ("tawss_", "pressure_drop_")
"""Beginnings of the names of quantities whose own fraction the error is. The error of others does not vary with them.
"""


@dataclass(frozen=True)
class NumericalError:
    """Error of one quantity from one source.

    Parameters
    ----------
    source
        `mesh`, `time_step` or `cycles`; `assumed`: of all three, where that of the mesh was not measured.
    correction
        What to add to the quantity where its value is `at`; 0 unless an order is seen. In the quantity's unit, as
        `std`, `at` and `spread`. Elsewhere it is as many times as large as `grown` says, and so is `std`.
    std
        Standard uncertainty after the correction, where the value is `at`.
    at
        Mean of the samples on the campaign's level.
    order
        Observed order of convergence; None with two levels, or where the values on three are not monotone.
    method
        `richardson`: corrected to the extrapolated value; `range`: values on three levels show no trusted order;
        `two_levels`: the method's order is assumed, and the mean is not corrected; `assumed`: nothing was run.
    n_samples
        Samples that were run on every level.
    spread
        Standard deviation over these samples of the difference behind `correction` or `std`.
    """

    source: Source
    correction: float
    std: float
    at: float
    order: float | None
    method: Method
    n_samples: int
    spread: float

    def grown(self, quantity: str, value: float | np.ndarray) -> float | np.ndarray:
        """Return the error where a quantity has some value, over that where it is `at`.

        It is in proportion to what it is an error of, unless it is larger than that: then there is no proportion.

        quantity: name of the 3D output.
        """
        at = np.nan
        if quantity.startswith(LOSSES):
            value, at = 1.0 - value, 1.0 - self.at
        elif quantity.startswith(FRACTIONS):
            at = self.at
        return value / at if at > max(self.std, abs(self.correction)) else np.ones_like(value)


def numerical_error(source: Source, size: np.ndarray, values: np.ndarray, own: int) -> NumericalError:
    """Estimate the numerical error of a mean.

    Parameters
    ----------
    source
        What differs between the levels.
    size
        (k,) element size, time step or 2^-cycles of two or three levels, coarsest first, in any unit.
    values
        (k, n) the quantity of the same n samples on every level.
    own
        Index of the campaign's level.

    Returns
    -------
    NumericalError
        The variance of the n differences over n is part of `std`.

    References
    ----------
    ASME V&V 20-2009. Roache 1998, Verification and Validation in Computational Science and Engineering. Eça and
    Hoekstra 2014, J. Comput. Phys. 262, 104-130.
    """
    of_method, mean, samples = ORDER[source], values.mean(axis=1), values.shape[1]
    order = observed_order(size, mean) if len(size) > 2 else None
    correction = 0.0
    method: Method
    if len(size) == 2:
        method, distance = "two_levels", _limit(size, values, of_method) - values[own]
    elif order is not None and of_method / FACTOR <= order <= of_method * FACTOR:
        method, distance = "richardson", _limit(size, values, min(order, of_method)) - values[own]
        correction = float(distance.mean())
    else:
        method, distance = "range", values[mean.argmax()] - values[mean.argmin()]
    spread = float(distance.std(ddof=1)) if samples > 1 else 0.0
    bound = SAFETY[method] * abs(float(distance.mean()))
    std = float(np.hypot(bound / COVERAGE, spread / np.sqrt(samples)))
    return NumericalError(source, correction, std, float(mean[own]), order, method, samples, spread)


def assumed_errors(throat_resolution: float, quantities: Iterable[str]) -> dict[str, list[NumericalError]]:
    """Return the errors of FFR and of pressure drops that are assumed where that of the mesh was not measured.

    Wall shear and oscillation have none: on coarse meshes they are off by more than their own size.

    Parameters
    ----------
    throat_resolution
        Elements over the radius of a throat.
    quantities
        Names of the 3D outputs.
    """
    found = {}
    for name in quantities:
        start = next((start for start in ASSUMED if name.startswith(start)), None)
        if start is not None:
            # An FFR of 0 loses everything, a drop of 1 is all of itself.
            at = 0.0 if start in LOSSES else 1.0
            std = ASSUMED[start] / throat_resolution**2
            found[name] = [NumericalError("assumed", 0.0, std, at, None, "assumed", 0, 0.0)]
    return found


def observed_order(size: np.ndarray, values: np.ndarray, highest: float = 16.0) -> float | None:
    """Return the observed order of values on three levels, at most `highest`; None if they are not monotone.

    size: (3,), coarsest first; values: (3,).
    """
    first, second = np.diff(values)
    if not first * second > 0:
        return None
    relative = size / size[1]

    def miss(power: float) -> float:
        a, b, c = relative**power
        return (a - b) / (b - c) - first / second

    lowest = 1e-3
    if miss(lowest) > 0:
        return None
    return highest if miss(highest) < 0 else float(brentq(miss, lowest, highest))


def _limit(size: np.ndarray, values: np.ndarray, order: float) -> np.ndarray:
    """Return the values (n,) extrapolated from the two finest levels with a given order."""
    share = (size[-1] / size[-2]) ** order
    return (values[-1] - share * values[-2]) / (1.0 - share)
