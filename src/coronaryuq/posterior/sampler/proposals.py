"""Proposals of DREAM: differential evolution with subspace crossover, and snooker."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.posterior.settings import DreamSettings


@dataclass(frozen=True)
class Proposal:
    """position (n, d); log_ratio (n,): log of the factor on the Metropolis ratio; crossover (n,): index used, or -1."""

    position: np.ndarray
    log_ratio: np.ndarray
    crossover: np.ndarray

    def replaced(self, rows: np.ndarray, other: "Proposal") -> "Proposal":
        """Return this proposal with `rows` (n,) bool taken from the other one."""
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
    uniforms = random.uniform(size=(n, 4 + 2 * d + len(pool)))
    normals = random.standard_normal((n, d))
    proposed, used = _differential_evolution(
        position, pool, np.cumsum(crossover), uniforms, normals,
        settings.pairs, settings.unit_jump, settings.spread, settings.jitter,
    )  # fmt: skip
    return Proposal(proposed, np.zeros(n), used)


@njit(cache=True)
def _differential_evolution(
    position, pool, cumulative, uniforms, normals, most_pairs, unit_jump, half_width, jitter
):  # fmt: skip
    n, d = position.shape
    proposed = position.copy()
    used = np.empty(n, dtype=np.int64)
    update = np.empty(d, dtype=np.bool_)
    for row in range(n):
        u = uniforms[row]
        pairs = min(1 + int(u[0] * most_pairs), most_pairs)
        choice = 0
        while choice < cumulative.size - 1 and u[1] >= cumulative[choice]:
            choice += 1
        used[row] = choice
        rate = (choice + 1.0) / cumulative.size
        updates = 0
        for k in range(d):
            update[k] = u[4 + k] < rate
            updates += update[k]
        if updates == 0:
            update[min(int(u[2] * d), d - 1)] = True
            updates = 1
        gamma = 1.0 if u[3] < unit_jump else 2.38 / np.sqrt(2.0 * pairs * updates)
        partner = np.argsort(u[4 + 2 * d :])
        for k in range(d):
            if update[k]:
                jump = 0.0
                for pair in range(pairs):
                    jump += pool[partner[2 * pair], k] - pool[partner[2 * pair + 1], k]
                factor = 1.0 + half_width * (2.0 * u[4 + d + k] - 1.0)
                proposed[row, k] += factor * gamma * jump + jitter * normals[row, k]
    return proposed, used


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
