"""A problem of waveforms without any model, for tests of residuals."""

from collections.abc import Sequence

import numpy as np

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.forward.simulation import Simulation
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy

TREE = left_coronary()
ANATOMY = Anatomy(TREE)


def waveform(time: np.ndarray, period: float, condition="rest", quantity="flow", location="AORTA:lad") -> Measured:
    """Zeros with unit standard deviations at these times (s)."""
    return Measured(condition, quantity, location, "waveform", time, period, np.zeros(time.size), np.ones(time.size))


def series_problem(measured: Sequence[Measured], nuisances: Sequence[Nuisance] = ()) -> Problem:
    """A problem of which all rows are fitted, with standard deviations as in the series."""
    conditions = {series.condition: Condition(series.condition) for series in measured}
    simulation = Simulation(TREE, conditions, ANATOMY, 300)
    forward = Forward(simulation, list(measured), list(nuisances), 1.0)
    return Problem(forward, Settings(model_floor=0.0), np.ones(forward.size, bool))
