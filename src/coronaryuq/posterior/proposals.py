"""Proposals of DREAM: differential evolution with subspace crossover, and snooker."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.posterior.settings import DreamSettings


@dataclass(frozen=True)
class Proposal:
    """position (n, d); log_ratio (n,): log of the factor on the Metropolis ratio; crossover (n,): index used, or -1."""

    position: np.ndarray
    log_ratio: np.ndarray
    crossover: np.ndarray

    def replaced(self, rows: np.ndarray, other: "Proposal") -> "Proposal":
        """This proposal with `rows` (n,) bool taken from the other one."""
        return Proposal(
            np.where(rows[:, None], other.position, self.position),
            np.where(rows, other.log_ratio, self.log_ratio),
            np.where(rows, other.crossover, self.crossover),
        )


def differential_evolution(
    position: np.ndarray, pool: np.ndarray, crossover: np.ndarray, settings: DreamSettings, random: np.random.Generator
) -> Proposal:
    """Proposal of step 2 of `Dream` for `position` (n, d) with partners from `pool` (m, d)."""
    n, d = position.shape
    pairs = random.integers(1, settings.pairs + 1, size=n)
    partners = np.argsort(random.uniform(size=(n, len(pool))), axis=1)[:, : 2 * settings.pairs]
    difference = pool[partners[:, ::2]] - pool[partners[:, 1::2]]
    counted = np.arange(settings.pairs) < pairs[:, None]
    jump = np.sum(np.where(counted[:, :, None], difference, 0.0), axis=1)

    used = np.searchsorted(np.cumsum(crossover)[:-1], random.uniform(size=n), side="right")
    probability = (used + 1.0) / len(crossover)
    update = random.uniform(size=(n, d)) < probability[:, None]
    at_least_one = random.integers(0, d, size=n)
    update[np.arange(n), at_least_one] |= ~update.any(axis=1)

    rate = 2.38 / np.sqrt(2.0 * pairs * update.sum(axis=1))
    rate = np.where(random.uniform(size=n) < settings.unit_jump, 1.0, rate)
    factor = 1.0 + random.uniform(-settings.spread, settings.spread, size=(n, d))
    jitter = settings.jitter * random.standard_normal((n, d))
    step = factor * rate[:, None] * jump + jitter
    return Proposal(position + np.where(update, step, 0.0), np.zeros(n), used)


def snooker(position: np.ndarray, pool: np.ndarray, random: np.random.Generator) -> Proposal:
    """Snooker update (ter Braak & Vrugt 2008) for `position` (n, d), with partners from `pool` (m, d)."""
    n, d = position.shape
    partners = np.argsort(random.uniform(size=(n, len(pool))), axis=1)[:, :3]
    anchor, one, other = (pool[partners[:, k]] for k in range(3))
    axis = position - anchor
    apart = np.any(axis != 0, axis=1)
    length = np.where(apart, np.sum(axis**2, axis=1), 1.0)
    rate = random.uniform(1.2, 2.2, size=n)
    along = np.sum((one - other) * axis, axis=1) / length
    proposal = position + (rate * along)[:, None] * axis
    ratio = np.sum((proposal - anchor) ** 2, axis=1) / length
    with np.errstate(divide="ignore"):
        log_ratio = np.where(apart, (d - 1) * 0.5 * np.log(ratio), -np.inf)
    return Proposal(proposal, log_ratio, np.full(n, -1))
