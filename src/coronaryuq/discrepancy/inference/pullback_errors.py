"""Errors that the readings of a pullback share: noise correlated along the path, and the usual drift of the wire.

Readings a millimetre apart differ little in their errors, so that a hundred of them are not a hundred independent
pressures. Of a pullback with standard deviations s the noise has the covariance s_i s_j exp(-|x_i - x_j| / l), and the
drift adds w_i w_j d^2, with d its standard deviation at the end and w its course. Both are white noise and shapes with
weights to be fitted, like the errors of vessels and time steps.
"""

import numpy as np

from coronaryuq.core.correlated_noise import white_and_shapes
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.zerod.effects.measuring_chain import pullback_name
from coronaryuq.zerod.effects.pullback import CHECK

SMOOTH = 1.05
"""Nearly all correlations are in the shapes: a pullback of few readings has no white part to speak of."""


def independent_sd(series: Measured) -> np.ndarray:
    """Return the standard deviations (k,) of the part of a series' noise that its values do not share."""
    return series.sd * _decomposed(series)[0]


def _decomposed(series: Measured) -> tuple[float, np.ndarray]:
    if series.pullback is None or series.quantity == CHECK:
        return 1.0, np.zeros((0, series.value.size))
    apart = np.abs(np.subtract.outer(series.pullback.distance, series.pullback.distance))
    return white_and_shapes(np.exp(-apart / series.pullback.noise_length), SMOOTH)


def pullback_errors(measured: list[Measured]) -> tuple[list[Nuisance], np.ndarray]:
    """Return the weights of the shared errors of all pullbacks, and their shapes (k, N), CGS.

    Returns
    -------
    weights, shapes
        Nuisance parameters, numbered from zero, and what each adds to the predictions.
    """
    ends = np.cumsum([0, *(series.value.size for series in measured)])
    names: list[str] = []
    shapes: list[np.ndarray] = []
    drifts: dict[str, np.ndarray] = {}
    for series, start in zip(measured, ends, strict=False):
        if series.pullback is None:
            continue
        rows, name = slice(start, start + series.value.size), pullback_name(series)
        for shape in _decomposed(series)[1]:
            names.append(f"noise of the pullback at {name}")
            shapes.append(np.zeros(ends[-1]))
            shapes[-1][rows] = series.sd * shape
        drift = drifts.setdefault(name, np.zeros(ends[-1]))
        drift[rows] = series.pullback.drift_sd * series.pullback.response
    names += [f"drift of the wire at {name}" for name in drifts]
    weights = [Nuisance(name, 1.0, shape=number, noise=True) for number, name in enumerate(names)]
    return weights, np.array([*shapes, *drifts.values()]).reshape(len(names), ends[-1])
