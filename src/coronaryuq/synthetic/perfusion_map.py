"""The bundled patient's perfusion: territories of the outlets, and a map that integrates to their flows."""

import numpy as np
from scipy.spatial import cKDTree

from coronaryuq.core import seeds

WAVES = 64
"""Random plane waves that make up the texture; enough for a nearly Gaussian field."""

BORDER = 0.25
"""cm over which perfusion changes from one territory's level to the next one's: collaterals, and the scanner's blur."""


def territories(centres: np.ndarray, outlets: np.ndarray) -> np.ndarray:
    """Return the index (n,) of the outlet (k, 3) nearest to each cell centre (n, 3) (paper, section 2.1)."""
    return cKDTree(outlets).query(centres)[1]


def texture(centres: np.ndarray, deviation: float, length: float, seed: int) -> np.ndarray:
    """Draw a lognormal random field (n,) of mean about 1, with relative `deviation` and correlation `length` (cm).

    A sum of plane waves with normal wave vectors has the correlation exp(-d²/2 length²) (spectral simulation,
    Shinozuka & Deodatis 1996); the field depends on place alone, not on how the wall is meshed.
    """
    random = seeds.generator(seed, "patient", "texture")
    wave = random.normal(0.0, 1.0 / length, (WAVES, 3))
    phase = random.uniform(0.0, 2.0 * np.pi, WAVES)
    field = np.sqrt(2.0 / WAVES) * np.cos(centres @ wave.T + phase).sum(axis=1)
    spread = np.sqrt(np.log1p(deviation**2))
    return np.exp(spread * field - 0.5 * spread**2)


def perfusion_map(
    centres: np.ndarray, masses: np.ndarray, outlets: np.ndarray, flows: np.ndarray, pattern: np.ndarray
) -> np.ndarray:
    """Compute flow per gram (n,), mL/s/g, whose integral over each outlet's territory is exactly that outlet's flow.

    Every outlet has one level of perfusion; a cell mixes the levels of the outlets about as near as its nearest one
    (see `BORDER`), times the pattern.

    Parameters
    ----------
    centres : array (n, 3)
        Cell centres, cm.
    masses : array (n,)
        Cell masses, g.
    outlets : array (k, 3)
        Positions of the outlets, cm.
    flows : array (k,)
        Flows of the outlets, mL/s.
    pattern : array (n,)
        Positive relative perfusion, such as `texture`.

    Raises
    ------
    ValueError
        If no positive levels give the flows.
    """
    distance = np.sqrt(((centres[:, None, :] - outlets[None, :, :]) ** 2).sum(axis=2))
    nearest = distance.argmin(axis=1)
    excess = distance - distance.min(axis=1, keepdims=True)
    mix = np.exp(-excess / BORDER)
    mix /= mix.sum(axis=1, keepdims=True)
    weight = (masses * pattern)[:, None] * mix
    integral = np.zeros((len(outlets), len(outlets)))
    np.add.at(integral, nearest, weight)
    levels = np.linalg.solve(integral, flows)
    if not (levels > 0.0).all():
        raise ValueError("no positive perfusion map has these flows: neighbouring territories differ too much")
    return pattern * (mix @ levels)
