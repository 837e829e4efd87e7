"""The emulated posterior, explored by DREAM without any run of the model: how chains move on it."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.posterior.sampler.diagnostics import effective_size, split_rhat
from coronaryuq.posterior.sampler.dream import Dream, Map, State
from coronaryuq.posterior.settings import DreamSettings

EXPLORED = 1.05
"""R-hat below which chains on the emulator have explored it."""

LENGTHS = (1, 4, 16)
"""Lengths of the chains on the emulator that are tried, over `dream.generations` or `LEAST`."""
LEAST = 200

EXPLORERS = 2
"""Chains on the emulator, over its dimensions: the differences of few chains do not span the space (ter Braak 2006)."""

RECORDED = 4000
"""States of each chain on the emulator that are looked at."""

KEPT = 100
"""States of each chain on the emulator that serve as partners."""

AUTOCORRELATION_TIMES = 2.0
"""Length of a walk: two neighbouring draws are then correlated by a few per cent."""


@dataclass(frozen=True)
class Walk:
    """How chains move on the emulator, as learnt by DREAM there.

    partners (m, d): states whose differences are the jumps. crossover: probability of each crossover value.
    generations: of a walk.
    """

    partners: np.ndarray
    crossover: np.ndarray
    generations: int


def explorers(chains: int, dimension: int) -> int:
    """Return the number of chains on the emulator: even, at least `chains`."""
    return max(chains, 2 * -(-EXPLORERS * dimension // 2))


def explore(screen: Map, start: np.ndarray, settings: DreamSettings, seed: int) -> tuple[Walk, float]:
    """Run DREAM on the emulator, longer if need be, from `start` (chains, d); return the walk and the largest R-hat."""
    rhat = np.inf
    for length in LENGTHS:
        kept, apart, state = _chains(screen, start, settings, seed, length)
        rhat = float(split_rhat(kept.swapaxes(0, 1)).max())
        if rhat < EXPLORED:
            break
    time = apart * kept.shape[0] * kept.shape[1] / effective_size(kept.swapaxes(0, 1), "bulk").min()
    partners = kept[:: -(-len(kept) // KEPT)].reshape(-1, kept.shape[2])
    return Walk(partners, state.crossover, int(np.ceil(AUTOCORRELATION_TIMES * time))), rhat


def _chains(
    screen: Map, start: np.ndarray, settings: DreamSettings, seed: int, length: int
) -> tuple[np.ndarray, int, State]:
    """Return states of chains on the emulator (n, chains, d), generations between two of them, and the last state."""

    def target(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return screen(x), np.empty((len(x), 0))

    generations = length * max(settings.generations, LEAST)
    dream = Dream(target, settings.model_copy(update={"generations": generations}), seed)
    apart = -(-(dream.decisions - dream.burn_in) // RECORDED)
    state, states = dream.start(start), []
    for generation in range(dream.decisions):
        dream.advance(state)
        if generation >= dream.burn_in and (generation - dream.burn_in) % apart == 0:
            states.append(state.position.copy())
    return np.array(states), apart, state
