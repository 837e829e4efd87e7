"""Faster settling of closed-loop runs by extrapolating the slow modes of the unmodified model."""

from weakref import WeakKeyDictionary

import numpy as np

from coronaryuq.discrepancy.forward.jobs import Job, Prepared, stack
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.carry_over import carry_over
from coronaryuq.zerod.solver.periodic import Extrapolate
from coronaryuq.zerod.solver.slow_modes import SlowModes, slow_modes
from coronaryuq.zerod.solver.warm_starts import Point

MOST_STEPS = 300
"""Time steps per cycle for slow modes, which do not depend on finer steps."""


class FastSettling:
    """Slow modes of one network by condition, computed on first use.

    They are used for other parameters and added elements as well: with approximate modes a run takes one cycle more.
    """

    def __init__(self) -> None:
        self._modes: dict[str, SlowModes | None] = {}
        self._origins: WeakKeyDictionary[Prepared, np.ndarray] = WeakKeyDictionary()

    def ahead(
        self, plain: Prepared, prepared: Prepared, jobs: list[Job], changes: dict, steps_per_cycle: int
    ) -> Extrapolate | None:
        """Return the extrapolation for a batch of runs, which conserves their blood volume; None if no mode is slow.

        plain: the network without added elements. changes: solver parameters of the runs.
        """
        conditions = list(dict.fromkeys(job.condition for job in jobs))
        modes = [self._modes_of(condition, plain, prepared, steps_per_cycle) for condition in conditions]
        if all(mode is None for mode in modes):
            return None
        which = np.array([conditions.index(job.condition) for job in jobs])
        volume = BloodVolume(prepared.engine.model)

        def ahead(who: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
            state = end.copy()
            for number, mode in enumerate(modes):
                rows = which[who] == number
                if mode is not None and rows.any():
                    state[rows] = mode.extrapolate(start[rows], end[rows])
            values = {name: value[who] for name, value in changes.items()}
            return volume.with_blood_added(state, volume.evaluate(end, values) - volume.evaluate(state, values))

        return ahead

    def _modes_of(self, condition: str, plain: Prepared, prepared: Prepared, steps_per_cycle: int) -> SlowModes | None:
        if condition not in self._modes:
            changes = stack(plain, [Job(Point(np.zeros(0), {}), condition)])
            steps = min(steps_per_cycle, MOST_STEPS)
            start = plain.start[condition]
            assert start is not None, "fast settling needs a periodic state under every condition"
            self._modes[condition] = slow_modes(plain.engine, start, changes, steps)
        modes = self._modes[condition]
        if modes is None or prepared is plain:
            return modes
        if prepared not in self._origins:
            self._origins[prepared] = _origin(plain, prepared)
        return modes.for_extended_network(self._origins[prepared])


def _origin(plain: Prepared, prepared: Prepared) -> np.ndarray:
    """Return the number of each unknown and rate in the network without added elements, or -1 for new ones."""
    size = 2 * plain.engine.model.size
    numbers = np.arange(1.0, len(plain.engine.state_names) + 1.0)
    origin = carry_over(plain.engine.state_names, numbers, prepared.engine.state_names, prepared.renamed)
    origin = origin[: 2 * prepared.engine.model.size].astype(int) - 1
    return np.where(origin < size, origin, -1)
