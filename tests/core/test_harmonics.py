"""Fourier basis: orthogonal on an even grid."""

import numpy as np
import pytest

from coronaryuq.core.harmonics import fourier_basis


def test_waves_of_an_even_grid_are_orthogonal_and_in_the_stated_order():
    phase = np.arange(32) / 32
    basis = fourier_basis(phase, 5)
    assert basis.T @ basis == pytest.approx(np.diag([32.0] + [16.0] * 10), abs=1e-12)
    assert basis[:, 3] == pytest.approx(np.cos(6.0 * np.pi * phase), abs=1e-12)
    assert basis[:, 8] == pytest.approx(np.sin(6.0 * np.pi * phase), abs=1e-12)


def test_without_harmonics_the_constant_is_left():
    assert np.array_equal(fourier_basis(np.array([0.1, 0.7]), 0), np.ones((2, 1)))
