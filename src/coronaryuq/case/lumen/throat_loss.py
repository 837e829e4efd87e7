"""The pressure loss of a stenosis by its radii, and the throat of a loss (Pfaller et al. 2022, Eq. 7)."""

from typing import TypeVar

import numpy as np

from coronaryuq.case.network.build import Physics, stenosis_coefficient

Number = TypeVar("Number", float, np.ndarray)


def throat_loss(radii: np.ndarray, arc: np.ndarray) -> np.ndarray:
    """Return what the stenosis coefficient is proportional to: A_0⁻² (A_0/A_s − 1)², times π².

    A_0 in the factor is the area where the stenosis begins, in the ratio that between its ends at the throat, as in
    `case.network.build`.

    Parameters
    ----------
    radii
        (samples, n) from the stenosis' start to its end, cm.
    arc
        (n,) arc lengths, cm.

    Returns
    -------
    array (samples,)
        cm⁻⁴.
    """
    throat = np.argmin(radii, axis=1)
    rows = np.arange(len(radii))
    along = (arc[throat] - arc[0]) / (arc[-1] - arc[0])
    healthy = radii[:, 0] * (1.0 - along) + radii[:, -1] * along
    return loss_of_throat(radii[rows, throat], radii[:, 0], healthy)


def loss_of_throat(radius: Number, first: Number, healthy: Number) -> Number:
    """Return the `throat_loss` of a throat, all radii in cm.

    radius: at the throat. first, healthy: where the stenosis begins, and at the throat without it.
    """
    return first**-4 * ((healthy / radius) ** 2 - 1.0) ** 2


def throat_radius(loss: float, first: float, healthy: float) -> float:
    """Return the radius (cm) of the throat that has a `throat_loss`; first, healthy: see `loss_of_throat`."""
    return float(healthy / np.sqrt(1.0 + np.sqrt(loss) * first**2))


def loss_of_coefficient(coefficient: float, physics: Physics) -> float:
    """Return the `throat_loss` that a stenosis coefficient (CGS) stands for."""
    # Half of the area at a radius of 1 cm: `throat_loss` is 1.
    return coefficient / stenosis_coefficient(0.5, 1.0, physics)
