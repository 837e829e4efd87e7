"""A synthetic aorta for coronary trees without one, which the 0D loop needs; only the domain `whole` meshes it."""

from dataclasses import replace

import numpy as np

from coronaryuq.case.anatomy.tree import Tree, Vessel

RADIUS = 1.3
"""cm, of an adult's ascending aorta (Hager et al. 2002)."""
LENGTHS = (2.0, 4.0)
"""cm, from the valve to the ostium and on from there."""
NAMES = ("aorta", "aorta_outlet")


def with_aorta(tree: Tree) -> Tree:
    """Return the tree attached to the side of a straight aorta, with its former root on the aortic wall.

    Like every ostial vessel, that vessel then starts on the aortic axis, so its arc length grows by `RADIUS`. Raises
    ValueError if a vessel already has an aortic name.
    """
    for name in NAMES:
        if name in tree:
            raise ValueError(f"vessel {name}: rename it; the name is reserved for the added aorta")
    root = tree.root
    away = root.tangent_at(0.0)
    centre = root.points[0] - RADIUS * away
    axis = np.linalg.svd(away[None])[2][1]
    share = np.linspace(0.0, 1.0, 21)[:, None]
    radii = np.full(21, RADIUS)
    before = Vessel(NAMES[0], centre + LENGTHS[0] * (share - 1.0) * axis, radii, None)
    behind = Vessel(NAMES[1], centre + LENGTHS[1] * share * axis, radii, NAMES[0])
    first = replace(
        root, points=np.vstack([centre, root.points]), radii=np.r_[root.radii[0], root.radii], parent=NAMES[0]
    )
    return Tree([before, behind, first, *(v for v in tree if v is not root)])
