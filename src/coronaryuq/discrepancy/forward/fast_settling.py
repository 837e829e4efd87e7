"""How runs of a closed loop settle in fewer cycles: by the slow modes of the model as it is, under each condition."""

from weakref import WeakKeyDictionary

import numpy as np

from coronaryuq.discrepancy.forward.jobs import Job, Prepared, stacked
from coronaryuq.discrepancy.forward.network_values import carried_over
from coronaryuq.discrepancy.forward.warm_starts import Point
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.periodic import Ahead
from coronaryuq.zerod.solver.slow_modes import SlowModes, slow_modes

MOST_STEPS = 300
"""Time steps of the cycles behind slow modes: what lasts does not hang on finer ones."""


class Settling:
    """Slow modes of one network by condition, found when they are first asked for.

    They serve other parameters and added elements too: modes that are not quite a run's own settle it a cycle later.
    """

    def __init__(self):
        self._modes: dict[str, SlowModes | None] = {}
        self._origins: WeakKeyDictionary[Prepared, np.ndarray] = WeakKeyDictionary()

    def ahead(
        self, plain: Prepared, prepared: Prepared, jobs: list[Job], changes: dict, steps_per_cycle: int
    ) -> Ahead | None:
        """For a batch of runs, which keep the blood that they hold; None where no mode is slow.

        plain: the network without added elements. changes: of the runs, as the engine takes them.
        """
        conditions = list(dict.fromkeys(job.condition for job in jobs))
        modes = [self._of(condition, plain, prepared, steps_per_cycle) for condition in conditions]
        if all(of is None for of in modes):
            return None
        which = np.array([conditions.index(job.condition) for job in jobs])
        volume = BloodVolume(prepared.engine.model)
        numbers = {name: value for name, value in changes.items() if np.ndim(value) == 1}

        def ahead(who: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
            found = end.copy()
            for number, of in enumerate(modes):
                mine = which[who] == number
                if of is not None and mine.any():
                    found[mine] = of.ahead(start[mine], end[mine])
            values = {name: value[who] for name, value in numbers.items()}
            return volume.filled(found, volume.of(end, values) - volume.of(found, values))

        return ahead

    def _of(self, condition: str, plain: Prepared, prepared: Prepared, steps_per_cycle: int) -> SlowModes | None:
        if condition not in self._modes:
            changes = stacked(plain, [Job(Point(np.zeros(0), {}), condition)])
            steps = min(steps_per_cycle, MOST_STEPS)
            self._modes[condition] = slow_modes(plain.engine, plain.start[condition], changes, steps)
        found = self._modes[condition]
        if found is None or prepared is plain:
            return found
        if prepared not in self._origins:
            self._origins[prepared] = _origin(plain, prepared)
        return found.moved(self._origins[prepared])


def _origin(plain: Prepared, prepared: Prepared) -> np.ndarray:
    """Of each unknown of a network with added elements, and each rate, the number in the one without, or -1."""
    size = 2 * plain.engine.model.size
    numbers = np.arange(1.0, len(plain.engine.state_names) + 1.0)
    found = carried_over(plain.engine.state_names, numbers, prepared.engine.state_names, prepared.renamed)
    found = found[: 2 * prepared.engine.model.size].astype(int) - 1
    return np.where(found < size, found, -1)
