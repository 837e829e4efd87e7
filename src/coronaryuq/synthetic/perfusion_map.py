"""The bundled patient's perfusion: who feeds which part of the wall, and a map that integrates to given flows."""

import numpy as np
from scipy.spatial import cKDTree

from coronaryuq.core import seeds

WAVES = 64
"""Random plane waves that make up the texture; enough for a nearly Gaussian field."""

BORDER = 0.25
"""cm over which perfusion passes from one territory's level to the next one's: collaterals and the scanner's blur."""


def territories(centres: np.ndarray, outlets: np.ndarray) -> np.ndarray:
    """Index of the outlet (k, 3) nearest to each cell centre (n, 3): Voronoi territories (paper, section 2.1)."""
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
    """Flow per gram (n,) whose integral over each outlet's territory is that outlet's flow, exactly.

    centres (n, 3) cm and masses (n,) g of cells, outlets (k, 3) cm, flows (k,) mL/s, pattern (n,) positive. Every
    outlet has one level; a cell mixes the levels of the outlets nearly as near as its own (see `BORDER`), times the
    pattern. Raises ValueError where no positive levels give the flows.
    """
    distance = np.sqrt(((centres[:, None, :] - outlets[None, :, :]) ** 2).sum(axis=2))
    nearest = distance.argmin(axis=1)
    beyond = distance - distance.min(axis=1, keepdims=True)
    mix = np.exp(-beyond / BORDER)
    mix /= mix.sum(axis=1, keepdims=True)
    weight = (masses * pattern)[:, None] * mix
    integral = np.zeros((len(outlets), len(outlets)))
    np.add.at(integral, nearest, weight)
    levels = np.linalg.solve(integral, flows)
    if not (levels > 0.0).all():
        raise ValueError("no positive perfusion map has these flows: neighbouring territories differ too much")
    return pattern * (mix @ levels)
