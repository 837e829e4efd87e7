"""Waveforms with an oscillation that no time step resolves, and how instruments read them."""

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.instruments import Instruments, places_read
from coronaryuq.discrepancy.forward.predict import Forward, Waveforms
from coronaryuq.zerod.effects.base import Series, Values
from coronaryuq.zerod.solver.lockstep import run_in_lockstep

CYCLE_ERROR = 1e-3
"""Cycle error of the runs, a tenth of the noise: changes between them are of interest that exceed it several times."""


def waveforms(forward: Forward, z: np.ndarray, effects: Hypothesis) -> Waveforms:
    """Return the waveforms, where measured, at z (n, p) of the model with effects on its network."""
    prepared, sizes = forward.simulation.prepared(effects), [effects.physical_sizes(row) for row in z]
    rows, conditions = [(row, effects) for row in z], list(forward.conditions)
    run = forward.simulate(prepared, rows, sizes, [[]] * len(z), conditions, CYCLE_ERROR)
    return run_in_lockstep([run], forward.simulation.threads)[0]


def sampled(forward: Forward, waves: Waveforms, z: np.ndarray, effects: Hypothesis, chain: Instruments) -> np.ndarray:
    """Return the predictions (n, N) from `waveforms` at z (n, p), as instruments read them where measured."""
    prepared, points = forward.simulation.prepared(effects), np.array([effects.nuisances(row) for row in z])
    measured = {(series.condition, series.quantity, series.location) for series in forward.measured}

    def known(series: Series, entry: tuple[PlacedEffect, Values]) -> bool:
        places = places_read(series, [[entry]], forward.anatomy)
        return measured.issuperset((series.condition, *place) for place in places)

    readable = [entry for entry in chain if all(known(series, entry) for series in forward.measured)]
    blocks = forward.readings(waves, points, prepared.topology, prepared.renamed, [readable] * len(z))
    return np.concatenate(blocks, axis=1)
