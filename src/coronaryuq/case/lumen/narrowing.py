"""Shapes of a narrowing that the segmentation missed, of which only the pressure loss in 0D is known.

A stenosis has the throat whose loss by the published rule is that of the lumen without it plus the added one; a diffuse
narrowing has the resistance by Poiseuille's law. Neither loss tells where it is, nor how long.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from coronaryuq.case.lumen.throat_loss import loss_of_coefficient, loss_of_throat, throat_radius
from coronaryuq.case.network.build import Physics, shape_integrals

LENGTH = 3.0
"""Assumed length of a stenosis in a vessel without a lesion, in healthy diameters: 9 mm in an artery of 3 mm."""
RAMP = 1.0
"""Length over which a diffuse narrowing fades at each end of its vessel, in healthy diameters."""
LONGEST_RAMP = 0.25
"""Share of the vessel that a ramp takes at most."""
CLOSED = 1.0 - 1e-6
"""Greatest depth of a diffuse narrowing, in radii."""


@dataclass(frozen=True)
class Throat:
    """A stenosis from `start` to `end`, arc lengths (cm), narrower by the share `depth` at its throat, at `place`."""

    start: float
    place: float
    end: float
    depth: float

    def ratio(self, arc: np.ndarray) -> np.ndarray:
        """Return radii with the stenosis over those without it at arc lengths (n,) cm: half a cosine on either side."""
        along = np.interp(arc, [self.start, self.place, self.end], [-1.0, 0.0, 1.0])
        return 1.0 - self.depth * 0.5 * (1.0 + np.cos(np.pi * along))


@dataclass(frozen=True)
class Diffuse:
    """A narrowing from `start` to `end`, arc lengths (cm), by the share `depth`, with ramps (cm) at both ends."""

    start: float
    end: float
    ramp: float
    depth: float

    def ratio(self, arc: np.ndarray) -> np.ndarray:
        """Return radii with the narrowing over those without it at arc lengths (n,) cm."""
        return 1.0 - self.depth * _plateau(arc, self.start, self.end, self.ramp)


Narrowing = Throat | Diffuse


def stenosis(arc: np.ndarray, radii: np.ndarray, place: float | None, added: float, physics: Physics) -> Throat:
    """Return the stenosis that adds a coefficient to that of a stretch.

    Parameters
    ----------
    arc, radii
        (n,) the stretch from its start to its end without the stenosis, cm.
    place
        Arc length (cm) of the throat; None: where the stretch is narrowest, its middle if that is at an end.
    added
        Coefficient S of ΔP = S |Q| Q, CGS.
    physics
        Blood and K_t.
    """
    k = int(np.argmin(radii if place is None else np.abs(arc - place)))
    if k in (0, len(arc) - 1):
        k = int(np.argmin(np.abs(arc - 0.5 * (arc[0] + arc[-1]))))
    # What the stretch loses there already; a place that is wider than the line between the ends loses nothing.
    line = np.interp(arc[k], arc[[0, -1]], radii[[0, -1]])
    first, own, healthy = float(radii[0]), float(radii[k]), float(max(line, radii[k]))
    loss = loss_of_throat(own, first, healthy) + loss_of_coefficient(added, physics)
    # Where nothing is added, rounding may leave a depth just below zero.
    depth = max(0.0, 1.0 - throat_radius(loss, first, healthy) / own)
    return Throat(float(arc[0]), float(arc[k]), float(arc[-1]), depth)


def diffuse(arc: np.ndarray, radii: np.ndarray, added: float) -> Diffuse:
    """Return the narrowing of a whole vessel that adds to its ∫ r⁻⁴ ds.

    Parameters
    ----------
    arc, radii
        (n,) the vessel from its start to its end, cm.
    added
        What is added to the integral, cm⁻³.
    """
    start, end = float(arc[0]), float(arc[-1])
    ramp = min(RAMP * 2.0 * float(np.median(radii)), LONGEST_RAMP * (end - start))
    weight = _plateau(arc, start, end, ramp)
    wanted = float(shape_integrals(radii, arc)[0]) + added

    def excess(depth: float) -> float:
        return float(shape_integrals(radii * (1.0 - depth * weight), arc)[0]) / wanted - 1.0

    depth = CLOSED if excess(CLOSED) < 0.0 else 0.0 if added <= 0.0 else brentq(excess, 0.0, CLOSED, xtol=1e-12)
    return Diffuse(start, end, ramp, float(depth))


def _plateau(arc: np.ndarray, start: float, end: float, ramp: float) -> np.ndarray:
    inside = np.clip(np.minimum(arc - start, end - arc) / ramp, 0.0, 1.0)
    return 0.5 * (1.0 - np.cos(np.pi * inside))
