"""Effects for the small closed loop, as a search would have found them."""

import numpy as np

from coronaryuq.adoption.choice import Placed
from coronaryuq.adoption.network import with_effects
from support.small_loop import loop

SCALES = {"pressure": 1.2e5, "period": 1.0, "flow": {"aorta": 90.0, "outlet": 86.0, "lca1": 2.4, "lca2": 1.6}}
KINDS = {
    "quadratic_stenosis": ("lca1", 1),
    "stenosis_with_viscous_loss": ("lca1", 2),
    "diffuse_narrowing": ("lca2", 1),
    "side_branch_leak": ("lca1", 1),
    "collateral": ("lca1~lca2", 1),
    "aortic_stenosis": ("aortic valve", 1),
    "haematocrit": ("everywhere", 1),
}


def placed(name, probability=1.0, measurement=False, z=0.3, sd=0.2):
    place, sizes = KINDS.get(name, ("lca1:BC_lca1", 1))
    covariance = (sd**2 * np.eye(sizes)).tolist()
    return Placed(name, place, probability, measurement, [z] * sizes, covariance)


def adopted(*classes):
    return with_effects(loop(), loop(), classes, SCALES).network
