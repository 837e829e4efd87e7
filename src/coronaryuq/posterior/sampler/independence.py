"""Independence steps: proposals that end a walk on the emulator long enough to forget where it began."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.sampler.diagnostics import effective_size, good_enough, pareto_smoothed, split_rhat
from coronaryuq.posterior.sampler.dream import Dream, Map, State, Target
from coronaryuq.posterior.settings import DreamSettings, Settings

BURN_IN = 5
"""Draws of each chain to discard: chains start almost in the posterior, and every draw nearly forgets the last one."""

PILOT = 10
"""Pilot runs per chain."""

EXPLORED = 1.05
"""R-hat below which chains on the emulator have explored it."""

LENGTHS = (1, 4, 16)
"""Lengths of the chains on the emulator that are tried, over `dream.generations` or `LEAST`."""
LEAST = 200

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


@dataclass(frozen=True)
class Pilot:
    """First runs of the model at draws of the emulator, and whether independence steps can be taken.

    k_hat: Pareto k of these runs; nan if none was made. refused: why no steps can be taken, or empty. start: if they
    can, runs drawn in proportion to their smoothed weights: positions (chains, d), log densities, flows (chains, N).
    """

    walk: Walk
    runs: int
    k_hat: float
    refused: str
    start: tuple[np.ndarray, np.ndarray, np.ndarray] | None


class Independence(Dream):
    """Markov chains whose proposals are nearly independent draws of the emulator q, exact for any q.

    Each draw is DREAM's decision with an emulator: a walk of `walk.generations` steps on q, from x to y, and y accepted
    with probability min(1, p(y) q(x) / (p(x) q(y))). But the partners of a walk are a random subset of fixed states,
    drawn before it begins, and not the other chains: chains move independently, all at once, and nothing adapts. Given
    the partners, the walk is reversible with respect to q, so that every draw leaves p invariant, however short the
    walk and however poor q. A walk that forgets x proposes an independent draw of q, and if q is near p, the effective
    size is near the number of draws.
    """

    def __init__(self, target: Target, screen: Map, walk: Walk, settings: Settings, seed: int, length: int = 1):
        fixed = settings.dream.model_copy(update={"adapt_crossovers": False})
        super().__init__(target, fixed, seed, screen=screen, every=walk.generations)
        self.walk, self.burn_in = walk, BURN_IN
        self.decisions = BURN_IN + length * (settings.independence.draws - BURN_IN)

    def start(self, position: np.ndarray, evaluated: tuple[np.ndarray, np.ndarray] | None = None) -> State:
        state = super().start(position, evaluated)
        state.crossover = self.walk.crossover.copy()
        return state

    def advance(self, state: State) -> None:
        """Make one draw of every chain. Changes `state`."""
        draw = int(state.generation) // self.every
        random = generator(self.seed, "independence", "draw", draw)
        self._count_from_here(state, draw)
        partners = self.walk.partners
        pool = partners[random.choice(len(partners), size=pool_size(*partners.shape), replace=False)]
        self.move(state, np.arange(len(state.position)), pool, random)
        self._decided(state)


def pool_size(count: int, dimension: int) -> int:
    """Partners of one walk: enough for their differences to span the space several times."""
    return min(count, max(4 * (dimension + 1), 12))


def explore(screen: Map, start: np.ndarray, settings: DreamSettings, seed: int) -> tuple[Walk, float]:
    """Run DREAM on the emulator, longer if need be, from `start` (chains, d); return the walk and the largest R-hat."""

    def target(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return screen(x), np.empty((len(x), 0))

    rhat = np.inf
    for length in LENGTHS:
        generations = length * max(settings.generations, LEAST)
        dream = Dream(target, settings.model_copy(update={"generations": generations}), seed)
        state, states = dream.start(start), []
        for _ in range(dream.decisions):
            dream.advance(state)
            states.append(state.position.copy())
        kept = np.array(states[dream.burn_in :])
        rhat = float(split_rhat(kept.swapaxes(0, 1)).max())
        if rhat < EXPLORED:
            break
    time = kept.shape[0] * kept.shape[1] / effective_size(kept.swapaxes(0, 1), "bulk").min()
    partners = kept[:: -(-len(kept) // KEPT)].reshape(-1, kept.shape[2])
    return Walk(partners, state.crossover, int(np.ceil(AUTOCORRELATION_TIMES * time))), rhat


def try_emulator(posterior: Posterior, screen: Callable, start: np.ndarray, settings: Settings, seed: int) -> Pilot:
    """Run the model at draws of the emulator and decide by their Pareto k; all ranks together."""
    walk, rhat = posterior.ranks.run_on_first(lambda: explore(screen, start, settings.dream, seed))
    if not rhat < EXPLORED:
        refused = f"R-hat of chains on the emulator is {rhat:.3f}, should be below {EXPLORED}"
        return Pilot(walk, 0, np.nan, refused, None)
    chains, limit = settings.dream.chains, settings.independence.k_limit
    random = generator(seed, "independence", "pilot")
    count = min(PILOT * chains, len(walk.partners))
    points = walk.partners[random.choice(len(walk.partners), size=count, replace=False)]
    log_density, flows = posterior(points)
    k_hat, weights = pareto_smoothed(log_density - screen(points))
    if not good_enough(k_hat, weights, limit):
        refused = f"{count} runs at draws of the emulator have Pareto k {k_hat:.2f}, should be below {limit}"
        return Pilot(walk, count, k_hat, refused, None)
    chosen = random.choice(count, size=chains, p=weights)
    return Pilot(walk, count, k_hat, "", (points[chosen], log_density[chosen], flows[chosen]))
