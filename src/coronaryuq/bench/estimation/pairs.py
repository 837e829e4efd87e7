"""Analytic pairs of a 3D and a 0D model with known means, difficult in different ways, for the coverage benchmark."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


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


PAIRS = {pair.name: pair for pair in (_smooth(), _dissimilar(), _useless(), _non_monotone(), _manifold(), _skewed())}
