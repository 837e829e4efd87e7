"""The narrowest place of a stenosis: a few coordinates leave out what makes it narrower, the noise along its length.

Every place of a carried law has the exact mean and variance. The narrowest of all places has not: where the error
varies within the stenosis, some place is tighter than the segmented throat, and a few smooth terms vary less than the
error that is stated. The jet forms at the narrowest place, so the law is moved there.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from coronaryuq.case.anatomy.tree import Stenosis, Tree
from coronaryuq.case.lumen.law import COMMON, REST, LumenLaw, VesselLaw
from coronaryuq.core.seeds import generator

DRAWS = 1 << 14
"""Of both laws, with shared coordinates: the shift of a throat has an error of some 0.0005."""
LARGEST = 1.0
"""Largest shift of the logarithm of a radius that is looked for."""


def with_exact_throats(law: LumenLaw, tree: Tree, stenoses: Sequence[Stenosis], length: float) -> LumenLaw:
    """Return the law with the mean at each throat lowered so that the narrowest place has the median of the exact law.

    The mean of the logarithm of the radius changes along the vessel as the left-out error does, given that it is one at
    the segmented throat.

    Parameters
    ----------
    law
        Law of a few coordinates, see `lumen_law`.
    tree, stenoses
        The segmented lumen.
    length
        Correlation length of the local error, cm.
    """
    vessels = dict(law.vessels)
    for stenosis in stenoses:
        if stenosis.vessel in vessels:
            vessels[stenosis.vessel] = _moved(vessels[stenosis.vessel], tree, stenosis, length)
    return replace(law, vessels=vessels)


def _moved(own: VesselLaw, tree: Tree, stenosis: Stenosis, length: float) -> VesselLaw:
    inside = (own.arc >= stenosis.start) & (own.arc <= stenosis.end)
    if not inside.any():
        return own
    terms, left_sd, left_out = _parts(own, length)
    radii = tree[stenosis.vessel].radius_at(own.arc)
    throat = int(np.argmin(np.where(inside, radii, np.inf)))
    if left_out[throat, throat] <= 0.0:
        return own
    along = left_out[:, throat] / left_out[throat, throat]
    random = generator(0, "lumen", "throat")
    smooth = np.log(radii[inside]) + own.mean[inside] + random.standard_normal((DRAWS, len(terms))) @ terms[:, inside]
    value, vector = np.linalg.eigh(left_out[np.ix_(inside, inside)])
    rough = (random.standard_normal((DRAWS, len(value))) * np.sqrt(np.clip(value, 0.0, None))) @ vector.T
    carried = smooth + random.standard_normal((DRAWS, 1)) * left_sd[inside]
    wanted = np.median((smooth + rough).min(axis=1))

    def too_wide(shift: float) -> float:
        return float(np.median((carried - shift * along[inside]).min(axis=1)) - wanted)

    if too_wide(0.0) <= 0.0:
        return own
    return replace(own, mean=own.mean - brentq(too_wide, 0.0, LARGEST, xtol=1e-6) * along)


def _parts(own: VesselLaw, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return terms (k, n) of a vessel's error, and what they leave: standard deviation (n,), covariance (n, n)."""
    names = [name for name in own.columns if not name.endswith(REST)]
    terms = np.array([own.columns[name] for name in names]).reshape(-1, len(own.arc))
    local = np.array([own.columns[name] for name in names if name != COMMON]).reshape(-1, len(own.arc))
    left = np.array([column for name, column in own.columns.items() if name.endswith(REST)]).reshape(-1, len(own.arc))
    left_sd = np.sqrt((left**2).sum(axis=0))
    sd = np.sqrt((local**2).sum(axis=0) + left_sd**2)
    distance = np.abs(own.arc[:, None] - own.arc)
    return terms, left_sd, np.exp(-distance / length) * np.outer(sd, sd) - local.T @ local
