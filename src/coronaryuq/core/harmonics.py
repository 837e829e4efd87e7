"""Fourier basis of a cycle."""

import numpy as np


def fourier_basis(phase: np.ndarray, harmonics: int) -> np.ndarray:
    """Return a constant and the waves of the first harmonics, (k, 2 harmonics + 1), at phases (k,) in cycles.

    Columns: 1, then the cosine of each harmonic, then the sine of each.
    """
    angles = 2.0 * np.pi * np.outer(phase, np.arange(1, harmonics + 1))
    return np.hstack([np.ones((len(phase), 1)), np.cos(angles), np.sin(angles)])
