"""Pullback of a pressure wire: where along a path of vessels it read, and what its drift adds to each reading."""

from dataclasses import dataclass

import numpy as np

OF_WIRE = "pullback "
"""Begins the quantities of a pullback, "pullback pressure" and "pullback ratio": no effect on other sensors acts on
them, because the wire was equalised with the aortic pressure before."""
CHECK = "drift check"
"""Quantity of the reading of the wire minus the aortic pressure at the end, with the sensor back in the aorta."""


@dataclass(frozen=True, eq=False)
class Pullback:
    """Places and errors of the readings of a wire.

    Attributes
    ----------
    path
        Vessels of the searched network from proximal to distal.
    distance
        Of each reading from the start of the first vessel, (k,), cm; the last may lie slightly beyond the path.
    length
        Of the path, cm.
    drift
        What a drift of 1 mmHg at the end adds to each pressure, (k,), dyn/cm2.
    drift_sd
        Standard deviation of the usual drift at the end, mmHg.
    noise_length
        Correlation length of the noise along the path, cm.
    root_pressure
        Mean pressure (dyn/cm2) over which ratios are taken; 1 for pressures.
    time
        Of each reading since equalisation, (k,), s; None if it is not given.
    """

    path: tuple[str, ...]
    distance: np.ndarray
    length: float
    drift: np.ndarray
    drift_sd: float
    noise_length: float
    root_pressure: float = 1.0
    time: np.ndarray | None = None

    @property
    def response(self) -> np.ndarray:
        """What a drift of 1 mmHg at the end adds to each reading, (k,), in the unit of the readings (CGS)."""
        return self.drift / self.root_pressure
