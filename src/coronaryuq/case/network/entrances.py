"""The pressure that speeds the blood up where a coronary artery leaves the aorta.

Blood in the aorta is slow and wide; the static pressure in the artery is lower by the kinetic energy that it gains, by
Bernoulli's equation α ρ v̄²/2 with the mean speed v̄ and the kinetic-energy factor α of the velocity profile: 2 if it is
developed, 1 if it is flat. The 0D vessels have losses alone, so the first one of each artery gets this in addition to
its stenosis coefficient; its entry `entrance` says which fraction of the sum this is. Further on the speed changes
little (Murray's law), and what it changes is left out.
"""

import numpy as np

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.network.network import ENTRANCE, Network


def kinetic_coefficient(tree: Tree, vessel: str, kinetic_factor: float, density: float) -> float:
    """Compute S of ΔP = S |Q| Q, the pressure that the blood takes to enter an artery: α ρ / (2 A²), dyn s2/cm8.

    Parameters
    ----------
    tree
        The lumen.
    vessel
        The first vessel of the artery.
    kinetic_factor
        α.
    density
        Of blood, g/cm3.
    """
    area = np.pi * entrance_radius(tree, vessel) ** 2
    return float(kinetic_factor * density / (2.0 * area**2))


def entrance_radius(tree: Tree, vessel: str) -> float:
    """Return the median radius (cm) of an artery's first vessel, which neither a flare nor a throat moves."""
    own = tree[vessel]
    return float(np.median(own.radius_at(np.linspace(tree.emergence(vessel), own.length, 101))))


def entrance_share(network: Network, vessel: str) -> float:
    """Return the fraction of a vessel's stenosis coefficient that stands for its entrance; 0 without one."""
    return float(network.vessel(vessel).get(ENTRANCE, 0.0))
