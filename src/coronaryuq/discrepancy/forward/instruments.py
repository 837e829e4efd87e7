"""Waveforms as instruments with errors read them."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect, Sizes
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Channel, Series, Values

Instruments = list[tuple[PlacedEffect, Values]]
"""Effects on the waveforms of one sample, with their sizes (1,)."""


def instruments(hypothesis: Hypothesis, sizes: Sizes) -> Instruments:
    """Return the effects that act on waveforms, sorted by name so that the order of the hypothesis does not matter."""
    found = [
        (placed, {name: np.array([value]) for name, value in values.items()})
        for placed, values in zip(hypothesis, sizes, strict=True)
        if placed.effect.reads_waveforms
    ]
    return sorted(found, key=lambda entry: entry[0].key)


def places_read(series: Series, rows: Iterable[Instruments], anatomy: Anatomy) -> set[Channel]:
    """Return quantity and location of the other waveforms that the readings of a series contain."""
    placed = {entry for row in rows for entry, _ in row}
    return {read for effect, place in placed if (read := effect.elsewhere(place, series, anatomy)) is not None}


def as_read(
    series: Series, wave: np.ndarray, at: Callable[[Channel], np.ndarray], rows: Sequence[Instruments], anatomy: Anatomy
) -> np.ndarray:
    """Return the waveforms of a series as the instruments of each sample read them.

    Parameters
    ----------
    series
        The series.
    wave
        (n, k + 1) over a cycle, both ends included.
    at
        Returns another waveform, in the same form, from its quantity and location.
    rows
        The instruments of each of the n samples.
    anatomy
        Anatomy of the network without effects.
    """
    read = wave
    for number, row in enumerate(rows):
        if not row:
            continue
        own = start = wave[number : number + 1, :-1]
        for (effect, place), sizes in row:
            found = effect.elsewhere(place, series, anatomy)
            other = None if found is None else at(found)[number : number + 1, :-1]
            own = effect.read(place, sizes, series, own, other, anatomy)
        if own is not start:
            read = wave.copy() if read is wave else read
            read[number] = np.append(own[0], own[0, 0])
    return read


def delays(series: Series, rows: Sequence[Instruments], count: int) -> np.ndarray:
    """Return by how much later than stated each of `count` samples reads a series, (count,), s."""
    late = np.zeros(count)
    for number, row in enumerate(rows):
        late[number] = sum(effect.delay(place, sizes, series)[0] for (effect, place), sizes in row)
    return late


def run_key(z: np.ndarray, hypothesis: Hypothesis) -> tuple:
    """Identity of the readings before effects on the measurements that do not act on waveforms."""
    sizes = zip(hypothesis, hypothesis.physical_sizes(z), strict=True)
    simulated = [(e.name, place, *v.values()) for (e, place), v in sizes if e.side == "network" or e.reads_waveforms]
    return hypothesis.nuisances(z).tobytes(), *simulated
