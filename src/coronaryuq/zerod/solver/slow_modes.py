"""Slow Floquet modes of a closed loop, and extrapolation along them to the periodic state.

A cycle maps its start x to its end P(x). Most of a small disturbance of a periodic state is gone after a cycle; a few
modes, which shift blood from one large compliance to another, decay by the same factor in every cycle. They are the
eigenvectors of the derivative M of P with the largest eigenvalues, found by subspace iteration on runs (Saad 2011,
Numerical Methods for Large Eigenvalue Problems, chapter 5). With them, Newton's step x + (I - M)^-1 (P(x) - x) is taken
in the slow modes and a plain cycle in all others, whose derivatives are unreliable because of the valves.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.lanes import LANES
from coronaryuq.zerod.solver.periodic import Periodicity

SLOW, LASTING = 0.5, 0.98
"""Range of the fraction of a slow mode that remains after a cycle. Faster modes, such as those of coronary beds (a
quarter), decay by themselves; a mode that hardly decays cannot be extrapolated from one cycle."""
PROBES, ROUNDS = LANES - 1, 4
"""Number of disturbances, which fill one group of samples, and of rounds of the subspace iteration."""
PROBE = 3e-2
"""Size of a disturbance over each unknown's range; a valve that opens a step earlier or later would dominate a smaller
one."""
SETTLING = 10
"""Maximum number of cycles to adapt a state that is periodic with other time steps."""
_RANK = 1e-4


@dataclass(frozen=True)
class SlowModes:
    """M (I - M)^-1 in the slow modes: the product of `toward` (2 unknowns, k) and `along` (k, 2 unknowns)."""

    toward: np.ndarray
    along: np.ndarray

    def extrapolate(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the periodic state that cycles from `start` to `end`, both (n, 2 unknowns), approach."""
        return end + (end - start) @ self.toward @ self.along

    def for_extended_network(self, origin: np.ndarray) -> "SlowModes":
        """Return the modes of a network with added elements; origin: (2 unknowns there,) number here of each, or -1."""
        known = origin >= 0
        toward, along = np.zeros((len(origin), self.toward.shape[1])), np.zeros((len(self.along), len(origin)))
        along[:, known] = self.along[:, origin[known]]
        numbers, first = np.unique(origin, return_index=True)
        toward[first[numbers >= 0]] = self.toward[numbers[numbers >= 0]]
        return SlowModes(toward, along)


def slow_modes(
    engine: Engine, state: np.ndarray, changes: Mapping[str, np.ndarray], steps_per_cycle: int
) -> SlowModes | None:
    """Compute the slow modes of a closed loop about a periodic state.

    Disturbances keep the loop's blood volume, which is conserved.

    Parameters
    ----------
    engine : Engine
        Of the closed loop.
    state : array (columns of state,)
        A state close to the periodic one.
    changes : mapping of str to array (1,) or (1, points)
        As for `Engine.run_cycles`, of one sample.
    steps_per_cycle : int
        Time steps per cycle.

    Returns
    -------
    SlowModes or None
        None if no mode is slow.
    """
    size, volume = engine.model.size, BloodVolume(engine.model)

    def run(starts: np.ndarray, quantities=()):
        repeated = {name: np.repeat(value, len(starts), axis=0) for name, value in changes.items()}
        missing = volume.evaluate(state[None, :], changes) - volume.evaluate(starts, repeated)
        starts = volume.with_blood_added(starts, missing)
        return starts, engine.run_cycles(repeated, quantities, cycles=1, steps_per_cycle=steps_per_cycle, start=starts)

    settled = engine.run_to_periodic(
        changes, periodicity=Periodicity(cycles=SETTLING), steps_per_cycle=steps_per_cycle, start=state[None, :]
    )
    state, names = settled.state[0], engine.unknowns
    _, own = run(state[None, :], [f"{statistic}_{name}" for statistic in ("min", "max") for name in names])
    if not own.ok[0]:
        return None
    ranges = np.array([own.values[f"max_{name}"][0] - own.values[f"min_{name}"][0] for name in names])
    weight = np.divide(1.0, ranges, out=np.zeros(size), where=ranges > 0.0)
    probes = PROBE * ranges * generator(0, "zerod", "slow modes").standard_normal((PROBES, size))
    for _ in range(ROUNDS):
        starts = np.repeat(state[None, :], len(probes), axis=0)
        starts[:, : probes.shape[1]] += probes
        starts, ends = run(starts)
        if not ends.ok.any():
            return None
        before, after = (starts - state)[ends.ok, : 2 * size], (ends.state - own.state)[ends.ok, : 2 * size]
        left, lengths, _ = np.linalg.svd(after[:, :size] * weight, full_matrices=False)
        kept = lengths > _RANK * lengths[0]
        probes = np.sqrt(size) * PROBE * (left[:, kept] / lengths[kept]).T @ after
    whitened = before[:, :size] * weight
    toward = np.zeros((2 * size, len(before)))
    toward[:size] = (np.linalg.solve(whitened @ whitened.T, whitened) * weight).T
    shares, vectors = np.linalg.eig(after @ toward)
    slow = (np.abs(shares) > SLOW) & (np.abs(shares) < LASTING)
    if not slow.any():
        return None
    gains = (vectors[:, slow] * (shares[slow] / (1.0 - shares[slow]))) @ np.linalg.inv(vectors)[slow]
    return SlowModes(toward, gains.real @ before)
