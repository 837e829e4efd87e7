"""Parts of the simulated waveforms that no run resolves, and how instruments read them."""

from dataclasses import replace

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis
from coronaryuq.discrepancy.forward.instruments import instruments, places_read
from coronaryuq.discrepancy.forward.lockstep import run_in_lockstep
from coronaryuq.discrepancy.forward.predict import Forward, Waveforms


def waveforms(forward: Forward, z: np.ndarray) -> Waveforms:
    """Return the waveforms of the model without effects at z (n, p)."""
    none: list = [[] for _ in z]
    rows, conditions = [(row, PLAIN) for row in z], list(forward.conditions)
    run = forward.simulate(forward.simulation.prepared([]), rows, none, none, conditions)
    return run_in_lockstep([run], forward.simulation.threads)[0]


def sampled(forward: Forward, waves: Waveforms, z: np.ndarray) -> np.ndarray:
    """Return the predictions (n, N) from waveforms of the model without effects at z (n, p)."""
    return np.concatenate(forward.readings(waves, z, forward.simulation.prepared([]).topology), axis=1)


def changed_by_instruments(forward: Forward, parts: Waveforms, z: np.ndarray, hypothesis: Hypothesis) -> np.ndarray:
    """Return what the instruments of a hypothesis change of the readings of parts of the waveforms.

    Linear instruments read a sum as the sum of its parts; a meter that saturates is taken to read each part alone.

    Parameters
    ----------
    forward
        The model.
    parts
        Waveforms to be added to simulated ones: (k, steps + 1) each.
    z
        Point (p,) with the sizes of the effects.
    hypothesis
        Effects, of which those that act on waveforms count.

    Returns
    -------
    np.ndarray
        (k, N) in CGS; zero where the instruments also read a place whose part is unknown.
    """
    chain = instruments(hypothesis, hypothesis.physical_sizes(z))
    count = len(next(iter(next(iter(parts.values())).values())))
    change, origin = np.zeros((count, forward.size)), np.zeros((count, len(forward.nuisances)))
    for series, rows in zip(forward.measured if chain else [], forward.rows, strict=False):
        own, places = parts[series.condition], places_read(series, [chain], forward.anatomy)
        names = {forward.variables(replace(series, location=place), {})[0] for place in places}
        if series.pullback is None and series.quantity != "ratio" and names <= own.keys():
            read, plain = (forward.reading(series, own, origin, {}, [each] * count) for each in (chain, []))
            change[:, rows] = read - plain
    return change
