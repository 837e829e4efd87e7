"""Single samples of waveforms that stand out from their neighbours: artefacts of a recording, most likely."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.inference.problem import Problem

STANDS_OUT = 6.0
"""Standard deviations off the line between both neighbours: one in 5e8 samples of normal noise."""
SAME_TIME, SEVERAL = 1.5, 2
"""Samples apart within which series stand out at one time of the beat, and how many others have to, for the fault to be
the model's and not theirs."""


@dataclass(frozen=True)
class Spike:
    """A sample (time in s) and how far it is off its neighbours, standard deviations."""

    quantity: str
    location: str
    condition: str
    time: float
    off: float


def spikes(problem: Problem, residual: np.ndarray) -> list[Spike]:
    """Of the whitened residuals (N,) of all rows, held-out ones too, the worst first.

    A sample is taken off the line between its neighbours, over the standard deviation that this has of white noise
    (Gasser, Sroka & Jennen-Steinmetz 1986); the worst is put there, and so on. Ends of a waveform have one neighbour
    only and are not looked at. What stands out in three series at one time of the beat is no artefact.
    """
    found, phases, apart = [], [], []
    for number, series in enumerate(problem.forward.measured):
        if series.time is None:
            continue
        left = np.array(residual[problem.owner == number])
        after = (series.time[1:-1] - series.time[:-2]) / np.maximum(series.time[2:] - series.time[:-2], 1e-12)
        scale = np.sqrt(1.0 + after**2 + (1.0 - after) ** 2)
        while True:
            line = (1.0 - after) * left[:-2] + after * left[2:]
            off = (left[1:-1] - line) / scale
            worst = int(np.argmax(np.abs(off)))
            if not abs(off[worst]) > STANDS_OUT:
                break
            time = float(series.time[worst + 1])
            found.append(Spike(series.quantity, series.location, series.condition, time, float(off[worst])))
            phases.append(time / series.period)
            apart.append((number, SAME_TIME / series.time.size))
            left[worst + 1] = line[worst]
    places = list(zip(phases, apart, strict=True))
    alone = []
    for spike, (phase, (owner, near)) in zip(found, places, strict=True):
        others = {other for at, (other, _) in places if other != owner and abs(phase - at) < near}
        if len(others) < SEVERAL:
            alone.append(spike)
    return sorted(alone, key=lambda spike: -abs(spike.off))
