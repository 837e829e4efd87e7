"""Activation functions of chambers: degree of contraction, 0 to 1, over the cardiac cycle.

Names and formulas are those of svZeroDSolver (`ActivationFunction.cpp`). Each function returns (samples or 1, times).
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from coronaryuq.zerod.network.numbering import Block
from coronaryuq.zerod.solver.assembly import Context, fourier_elastance

_GRID = 1e-5
"""Step (s) of the grid on which svZeroDSolver finds the maximum of the two-hill function."""
_FOURIER_GRID = 10_000


def half_cosine(block: Block, at: Context) -> np.ndarray:
    """Evaluate (1 - cos(2π τ / t_twitch)) / 2 for 0 ≤ τ ≤ t_twitch, with τ = t - t_active, and 0 elsewhere."""
    start, duration = _columns(block, at, "t_active", "t_twitch")
    time = at.time_in_cycle - start
    return np.where((time >= 0.0) & (time <= duration), 0.5 - 0.5 * np.cos(2.0 * np.pi * time / duration), 0.0)


def piecewise_cosine(block: Block, at: Context) -> np.ndarray:
    """Evaluate a rise as half a cosine, then a fall as another (Regazzoni et al. 2022, J. Comput. Phys. 457, 111083).

    (1 - cos(π τ_c / T_c)) / 2 for τ_c < T_c, else (1 + cos(π τ_r / T_r)) / 2 for τ_r < T_r, else 0, where τ_c and τ_r
    count from the start of contraction and of relaxation and wrap around at the end of the cycle. (In the very first
    cycle svZeroDSolver leaves out what began before time 0.)
    """
    contract_start, relax_start, contract, relax = _columns(
        block, at, "contract_start", "relax_start", "contract_duration", "relax_duration"
    )
    period = at.period[:, None]
    rising = np.mod(at.time_in_cycle - contract_start, period)
    falling = np.mod(at.time_in_cycle - relax_start, period)
    fall = np.where(falling < relax, 0.5 * (1.0 + np.cos(np.pi * falling / relax)), 0.0)
    return np.where(rising < contract, 0.5 * (1.0 - np.cos(np.pi * rising / contract)), fall)


def two_hill(block: Block, at: Context) -> np.ndarray:
    """Evaluate a product of two Hill functions over its maximum (Mynard et al. 2012; Ann. Biomed. Eng. 50, 2022).

    g1 / (1 + g1) / (1 + g2), with g_k = (τ / tau_k)^m_k and τ = t - t_shift, which wraps around.
    """
    (shift,) = _columns(block, at, "t_shift")
    shape = np.stack(at.values(block, "tau_1", "tau_2", "m1", "m2"), axis=1)
    largest = np.array([_largest_hill(*row) for row in np.column_stack([shape, at.period]).tolist()])[:, None]
    time = np.mod(at.time_in_cycle - shift, at.period[:, None])
    return _hills(time, *(column[:, None] for column in shape.T)) / largest


def fourier(block: Block, at: Context) -> np.ndarray:
    """Evaluate the ventricles' Fourier series, shifted and scaled to the range 0 to 1 (Menon et al. 2023)."""
    least, greatest = _fourier_range()
    return (at.ventricular_elastance - least) / (greatest - least)


def wrapping_cosine(block: Block, at: Context) -> np.ndarray:
    """Evaluate the atria's activation, a cosine that wraps around (Sankaran et al. 2012).

    Tsa is a fraction of the period, tpwave the period over the time of the P wave.
    """
    return at.atrial_activation(block)


def _columns(block: Block, at: Context, *names: str) -> list[np.ndarray]:
    return [value[:, None] for value in at.values(block, *names)]


def _hills(time, tau_1, tau_2, m1, m2):
    first, second = (time / tau_1) ** m1, (time / tau_2) ** m2
    return first / (1.0 + first) / (1.0 + second)


@cache
def _largest_hill(tau_1: float, tau_2: float, m1: float, m2: float, period: float) -> float:
    return float(_hills(np.arange(0.0, period, _GRID), tau_1, tau_2, m1, m2).max())


@cache
def _fourier_range() -> tuple[float, float]:
    series = fourier_elastance(np.arange(_FOURIER_GRID) / _FOURIER_GRID)
    return float(series.min()), float(series.max())


ACTIVATION: dict[str, Callable[[Block, Context], np.ndarray]] = {
    "half_cosine": half_cosine,
    "piecewise_cosine": piecewise_cosine,
    "two_hill": two_hill,
    "fourier": fourier,
    "wrapping_cosine": wrapping_cosine,
}
