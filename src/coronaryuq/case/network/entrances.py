"""The pressure that speeds the blood up where a coronary artery leaves the aorta.

Blood in the aorta is slow and wide; the static pressure in the artery is lower by the kinetic energy that it gains, by
Bernoulli's equation α ρ v̄²/2 with the mean speed v̄ and the kinetic-energy factor α of the velocity profile: 2 if it is
developed, 1 if it is flat. The 0D vessels have losses alone, so the first one of each artery gets this as a quadratic
term. Further on the speed changes little (Murray's law), and what it changes is left out.
"""

from collections.abc import Sequence

import numpy as np

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.network.build import Segment
from coronaryuq.case.network.network import ENTRANCE, Network

QUADRATIC = "stenosis_coefficient"


def with_entrances(
    network: Network, tree: Tree, along: Sequence[Segment], kinetic_factor: float, density: float
) -> Network:
    """Return the network with the pressure that the blood takes to enter each coronary artery.

    The first 0D vessel of each artery gets α ρ / (2 A²) in addition to its stenosis coefficient; its entry `entrance`
    says which fraction of the sum this is.

    Parameters
    ----------
    network
        The 0D network.
    tree
        The lumen.
    along
        The 0D vessels along it, in the tree's order.
    kinetic_factor
        α; 0 leaves the network as it is.
    density
        Of blood, g/cm3.

    Returns
    -------
    Network
        A copy, or the network itself with a factor of zero.
    """
    if kinetic_factor == 0.0:
        return network
    network = network.deep_copy()
    for vessel in tree:
        first = next((segment for segment in along if segment.vessel == vessel.name), None)
        if first is None or not tree.ostial(vessel):
            continue
        block = network.vessel(first.name)
        values = block["zero_d_element_values"]
        own = float(values.get(QUADRATIC) or 0.0)
        added = kinetic_factor * density / (2.0 * (np.pi * entrance_radius(tree, vessel.name) ** 2) ** 2)
        values[QUADRATIC] = own + added
        block[ENTRANCE] = added / (own + added)
    return network


def entrance_radius(tree: Tree, vessel: str) -> float:
    """Return the median radius (cm) of an artery's first vessel, which neither a flare nor a throat moves."""
    own = tree[vessel]
    return float(np.median(own.radius_at(np.linspace(tree.emergence(vessel), own.length, 101))))


def entrance_share(network: Network, vessel: str) -> float:
    """Return the fraction of a vessel's stenosis coefficient that stands for its entrance; 0 without one."""
    return float(network.vessel(vessel).get(ENTRANCE, 0.0))
