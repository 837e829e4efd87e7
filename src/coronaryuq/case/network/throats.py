"""The radius and the throat of a 0D vessel that comes without an anatomy, from its elements."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.case.network.schematic import radius_from_inertance
from coronaryuq.case.network.topology import Topology
from coronaryuq.case.settings import STENOSIS_LOSS

SHORTEST_THROAT, LONGEST_THROAT = 0.02, 0.8
"""Share of the vessel that a throat takes at least and at most."""


@dataclass(frozen=True)
class Bore:
    """Inside of a straight vessel: healthy `radius` (cm); a throat of `ratio` of its area over `share` of its length.

    Without a throat the ratio is 1 and the share 0.
    """

    radius: float
    ratio: float = 1.0
    share: float = 0.0


def implied_bore(topology: Topology, vessel: str, density: float, viscosity: float) -> Bore | None:
    """Return the bore that resistance, inertance and stenosis coefficient imply; None if they imply no radius.

    A tube with a throat has three unknowns, and the three elements are integrals over it: ∫ r⁻⁴, ∫ r⁻² and the loss at
    the throat; of two such tubes the one with the shorter throat is taken. Where no tube has all three, the radius is
    that of the inertance, and the throat is as long as the resistance demands. Without an inertance the radius is that
    of the resistance, and there is no throat.

    The stenosis coefficient is read with the published K_t. The setting `patient.stenosis_loss` is that of networks
    built here from an anatomy; this one was built elsewhere, and says nothing of its own.
    """
    values, length = topology.network.vessel_values(vessel), topology.length(vessel)
    resistance, coefficient = (float(values.get(name) or 0.0) for name in ("R_poiseuille", "stenosis_coefficient"))
    uniform = radius_from_inertance(topology, vessel, density)
    if uniform is None:
        known = length > 0.0 and resistance > 0.0
        return Bore(float((8.0 * viscosity * length / (np.pi * resistance)) ** 0.25)) if known else None
    if coefficient <= 0.0:
        return Bore(uniform)
    loss = np.pi * np.sqrt(2.0 * coefficient / (STENOSIS_LOSS * density))
    fourth = np.pi * resistance / (8.0 * viscosity * length)
    # With q = 1 + loss r² of healthy over throat area, and the share f: 1 + f (q - 1) = (r / uniform)² by the inertance
    # and 1 + f (q² - 1) = fourth r⁴ by the resistance, a quadratic equation in r².
    linear, quadratic = 2.0 / uniform**2 - loss, loss / uniform**2 - fourth
    root = linear + np.sqrt(max(linear**2 + 4.0 * quadratic, 0.0))
    square = 2.0 / root if root > 0.0 else 0.0
    share = (square / uniform**2 - 1.0) / (loss * square) if square > 0.0 else 0.0
    if not 0.0 < share <= LONGEST_THROAT:
        square = uniform**2
        inverse = 1.0 + loss * square
        share = float(np.clip((fourth * square**2 - 1.0) / (inverse**2 - 1.0), SHORTEST_THROAT, LONGEST_THROAT))
    return Bore(float(np.sqrt(square)), float(1.0 / (1.0 + loss * square)), float(share))
