"""What of a disturbance lasts for many cycles, and where a state that has it will settle.

A cycle maps its start x to its end P(x). Most of a small disturbance of a periodic state is gone after a cycle; a few
modes, in which a circulation shifts blood from one large compliance to another, decay by the same share in each. They
are the eigenvectors of the derivative M of P with the largest eigenvalues, found by subspace iteration on runs (Saad
2011, Numerical Methods for Large Eigenvalue Problems, chapter 5). With them, Newton's step x + (I - M)^-1 (P(x) - x) is
taken in the slow modes, and a plain cycle in all others, whose derivatives valves make useless.
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
"""Share that is left of a slow mode after a cycle, at least: coronary beds keep a quarter, and forget by themselves.
And at most: where a mode will lead that hardly decays, a cycle does not tell."""
PROBES, ROUNDS = LANES - 1, 4
"""Disturbances that are run, as many as one group of samples holds, and rounds in which they turn to what lasts."""
PROBE = 3e-2
"""Their size over each unknown's range: valves may open a step earlier or later, which beside smaller ones looks large.
"""
SETTLING = 10
"""Cycles at most in which a state that is periodic with other time steps settles to those that are used here."""
_RANK = 1e-4


@dataclass(frozen=True)
class SlowModes:
    """M (I - M)^-1 in the slow modes: the product of `toward` (2 unknowns, k) and `along` (k, 2 unknowns)."""

    toward: np.ndarray
    along: np.ndarray

    def ahead(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Where cycles from `start` to `end`, both (n, 2 unknowns), will lead."""
        return end + (end - start) @ self.toward @ self.along

    def moved(self, origin: np.ndarray) -> "SlowModes":
        """For a network with added elements. origin: (2 unknowns there,), of each the number here, or -1."""
        known = origin >= 0
        toward, along = np.zeros((len(origin), self.toward.shape[1])), np.zeros((len(self.along), len(origin)))
        along[:, known] = self.along[:, origin[known]]
        numbers, first = np.unique(origin, return_index=True)
        toward[first[numbers >= 0]] = self.toward[numbers[numbers >= 0]]
        return SlowModes(toward, along)


def slow_modes(
    engine: Engine, state: np.ndarray, changes: Mapping[str, np.ndarray], steps_per_cycle: int
) -> SlowModes | None:
    """Of a closed loop about the periodic state next to `state` (columns of state,); None where no mode is slow.

    changes: as `Engine.run_cycles` takes them, of one sample: (1,) each, or (1, points). Disturbances leave the
    loop's blood volume as it is: it is kept for ever.
    """
    size, volume = engine.model.size, BloodVolume(engine.model)

    def run(starts: np.ndarray, quantities=()):
        mine = {name: np.repeat(value, len(starts), axis=0) for name, value in changes.items()}
        starts = volume.filled(starts, volume.of(state[None, :], changes) - volume.of(starts, mine))
        return starts, engine.run_cycles(mine, quantities, cycles=1, steps_per_cycle=steps_per_cycle, start=starts)

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
