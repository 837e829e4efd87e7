"""Analytic pairs of a 3D and a 0D model with known means, difficult in different ways, for the coverage benchmark."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri


@dataclass(frozen=True)
class Pair:
    """θ (n, d), positive, from `draw(rng, n)`; `high(θ)` (n,), `low(θ)` (n, p) with the paired 0D output first."""

    name: str
    draw: Callable[[np.random.Generator, int], np.ndarray]
    high: Callable[[np.ndarray], np.ndarray]
    low: Callable[[np.ndarray], np.ndarray]
    mean: float


def _box(d: int):
    return lambda rng, n: rng.uniform(0.5, 2.0, (n, d))


def moment(p: float, low: float = 0.5, high: float = 2.0) -> float:
    """E[x^p] of a uniform x, p not −1."""
    return (high ** (p + 1) - low ** (p + 1)) / ((p + 1) * (high - low))


def _smooth() -> Pair:
    """Correlated smooth models: a power law and its linear shadow."""
    return Pair(
        "smooth", _box(3), lambda t: t[:, 0] ** 2 * np.sqrt(t[:, 1]) + 0.3 * t[:, 2],
        lambda t: np.column_stack([t[:, 0] + 0.2 * t[:, 1], t[:, 2]]), moment(2) * moment(0.5) + 0.3 * moment(1),
    )  # fmt: skip


def _dissimilar() -> Pair:
    """Make a pair whose 0D and 3D models have only one of five inputs in common."""
    return Pair(
        "dissimilar inputs", _box(5), lambda t: t[:, 0] * t[:, 1] + t[:, 2] ** 3,
        lambda t: np.column_stack([t[:, 2] * t[:, 3], t[:, 3] + t[:, 4]]), moment(1) ** 2 + moment(3),
    )  # fmt: skip


def _useless() -> Pair:
    """Make a pair with an uninformative 0D output and a 3D output too rough for any regression."""
    high = lambda t: t[:, 0] + 0.6 * np.sign(np.sin(2 * np.pi * 400 * t[:, 1]))  # noqa: E731
    return Pair("useless 0D", _box(3), high, lambda t: np.column_stack([np.cos(300 * t[:, 2])]), moment(1))


def _non_monotone() -> Pair:
    """Make a pair whose 3D quantity is quadratic in the 0D output: almost no linear correlation."""
    return Pair(
        "non-monotone", _box(2), lambda t: (t[:, 0] + t[:, 1] - 2.5) ** 2,
        lambda t: np.column_stack([t[:, 0] + t[:, 1]]), 2 * (moment(2) - moment(1) ** 2),
    )  # fmt: skip


def _manifold() -> Pair:
    """Fourteen resistances whose conductances add up to a constant, and a total scaling."""
    concentration = np.linspace(6, 14, 14)
    total = concentration.sum()

    def draw(rng, n):
        share = rng.dirichlet(concentration, n)
        return np.column_stack([(concentration / total) / share, rng.uniform(0.7, 1.25, n)])

    def share(t):
        return (concentration / total) / t[:, :-1]

    first = concentration[0] * (concentration[0] + 1) / (total * (total + 1))
    mean = first / (0.7 * 1.25) + concentration[3:6].sum() / total * moment(-0.5, 0.7, 1.25)
    return Pair(
        "constrained manifold", draw,
        lambda t: share(t)[:, 0] ** 2 / t[:, -1] ** 2 + share(t)[:, 3:6].sum(axis=1) / np.sqrt(t[:, -1]),
        lambda t: np.column_stack([share(t)[:, 0] / t[:, -1], share(t)[:, 3] / t[:, -1]]), mean,
    )  # fmt: skip


def _skewed() -> Pair:
    """Make a pair with a long-tailed quantity, such as a ratio near collapse."""
    return Pair(
        "long tail", _box(2), lambda t: np.exp(1.5 * t[:, 0]) + t[:, 1],
        lambda t: np.column_stack([t[:, 0], t[:, 1]]), (np.exp(3.0) - np.exp(0.75)) / 1.5**2 + moment(1),
    )  # fmt: skip


def _normal(d: int):
    return lambda rng, n: np.exp(rng.standard_normal((n, d)))


def _noise(theta: np.ndarray) -> np.ndarray:
    """Return a standard normal number (n,) that no regression on the inputs can predict."""
    return ndtri(np.clip((1e5 * theta[:, -1]) % 1.0, 1e-12, 1 - 1e-12))


def _lognormal() -> Pair:
    """Make a pair with a lognormal quantity, sigma 1.2, of whose logarithm half the variance is unpredictable."""
    sigma = 1.2 / np.sqrt(2)
    return Pair(
        "lognormal", _normal(3), lambda t: t[:, 0] ** sigma * np.exp(sigma * _noise(t)),
        lambda t: np.column_stack([t[:, 0] ** sigma, t[:, 1]]), float(np.exp(sigma**2)),
    )  # fmt: skip


def _onset() -> Pair:
    """Make a pair with a response that sets in for 3 % of the inputs and that the 0D output does not show."""
    at = float(ndtri(0.97))
    beyond = np.exp(-(at**2) / 2) / np.sqrt(2 * np.pi) - at * 0.03
    return Pair(
        "rare onset", _normal(3), lambda t: 1 + 0.1 * np.log(t[:, 0]) + 5 * np.maximum(0, np.log(t[:, 1]) - at),
        lambda t: np.column_stack([np.log(t[:, 0]), t[:, 2]]), 1 + 5 * float(beyond),
    )  # fmt: skip


def _indicator() -> Pair:
    """Make a pair whose quantity is 0 or 1."""
    return Pair(
        "indicator", _normal(3), lambda t: (np.log(t[:, 0]) + 0.3 * np.log(t[:, 1]) < -0.8).astype(float),
        lambda t: np.column_stack([np.log(t[:, 0]), np.log(t[:, 2])]), float(ndtr(-0.8 / np.sqrt(1.09))),
    )  # fmt: skip


def _heteroscedastic() -> Pair:
    """Make a smooth pair with a solver noise that grows with an input."""
    return Pair(
        "heteroscedastic noise", _normal(3),
        lambda t: 1 + 0.3 * np.log(t[:, 0]) + 0.05 * np.log(t[:, 1]) ** 2 + 0.05 * np.minimum(t[:, 1], 10) * _noise(t),
        lambda t: np.column_stack([np.log(t[:, 0]), np.log(t[:, 1])]), 1.05,
    )  # fmt: skip


PAIRS = {
    pair.name: pair
    for pair in (
        _smooth(), _dissimilar(), _useless(), _non_monotone(), _manifold(), _skewed(),
        _lognormal(), _onset(), _indicator(), _heteroscedastic(),
    )
}  # fmt: skip
