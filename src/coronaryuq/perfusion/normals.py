"""Standard normal numbers by index: skipping some changes none of the others."""

import numpy as np

from coronaryuq.core.jit import njit

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)


_TAIL = np.array([0.5, 0.1586552540, 0.0227501320, 0.0013498981, 3.16713e-5, 2.86653e-7, 9.866e-10, 1.28e-12, 0.0])
"""Upper bounds of the probability of a normal number below 0, -1, -2, ... standard deviations."""


@njit(cache=True, inline="always")
def uniform_at(key: np.uint64, index: np.uint64) -> float:
    """Return uniform number `index`, in (0, 1), of stream `key`: SplitMix64 (Steele, Lea & Flood 2014), 53 bits."""
    z = key + (index + np.uint64(1)) * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * _MIX1
    z = (z ^ (z >> np.uint64(27))) * _MIX2
    z = z ^ (z >> np.uint64(31))
    return (np.float64(z >> np.uint64(11)) + 0.5) * (1.0 / 9007199254740992.0)


@njit(cache=True, inline="always")
def is_certainly_above(uniform: float, bound: float) -> bool:
    """Return whether the normal number of `uniform` exceeds `bound`; False if only its quantile can decide."""
    return bound < 0.0 and uniform > _TAIL[min(int(-bound), 8)]


@njit(cache=True, inline="always")
def quantile(p: float) -> float:
    """Compute the standard normal quantile by PPND7 (Wichura 1988), with a relative error below 1e-7."""
    q = p - 0.5
    if abs(q) <= 0.425:
        r = 0.180625 - q * q
        return (
            q
            * (((59.109374720 * r + 159.29113202) * r + 50.434271938) * r + 3.3871327179)
            / (((67.187563600 * r + 78.757757664) * r + 17.895169469) * r + 1.0)
        )
    r = np.sqrt(-np.log(min(p, 1.0 - p)))
    if r <= 5.0:
        r -= 1.6
        z = (((0.17023821103 * r + 1.3067284816) * r + 2.7568153900) * r + 1.4234372777) / (
            (0.12021132975 * r + 0.73700164250) * r + 1.0
        )
    else:
        r -= 5.0
        z = (((0.017337203997 * r + 0.42868294337) * r + 3.0812263860) * r + 6.6579051150) / (
            (0.012258202635 * r + 0.24197894225) * r + 1.0
        )
    return z if q > 0.0 else -z
