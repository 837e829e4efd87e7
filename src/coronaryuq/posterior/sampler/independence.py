"""Independence steps: proposals that end a walk on the emulator long enough to forget where it began."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from coronaryuq.core.importance_weights import good_enough, pareto_smoothed
from coronaryuq.core.seeds import generator
from coronaryuq.posterior.model.emulator import Emulator
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.model.linearised import Linearised
from coronaryuq.posterior.model.total_resistance import Rescaled
from coronaryuq.posterior.sampler.dream import Dream, Map, State, Target
from coronaryuq.posterior.sampler.exploration import EXPLORED, Walk, explore
from coronaryuq.posterior.settings import Settings

BURN_IN = 5
"""Draws of each chain to discard: chains start almost in the posterior, and every draw nearly forgets the last one."""

PILOT = 10
"""Pilot runs per chain."""

REFINED, ATTEMPTS = 3, 5
"""Emulators, each fitted to all runs made so far, that are tried before the limit of k decides, and at most."""


@dataclass(frozen=True)
class Pilot:
    """First runs of the model at draws of the emulator, and whether independence steps can be taken.

    emulator: fitted to all runs but those of the last pilot. k_hat: Pareto k of the last pilot's runs; nan if
    none was made. refused: why no steps can be taken, or empty. start: if they can, runs drawn in proportion to their
    smoothed weights: positions (chains, d), log densities, flows (chains, N).
    """

    emulator: Emulator
    walk: Walk
    runs: int
    k_hat: float
    refused: str
    start: tuple[np.ndarray, np.ndarray, np.ndarray] | None


class Independence(Dream):
    """Markov chains whose proposals are nearly independent draws of the emulator q, exact for any q.

    Each draw is DREAM's decision with an emulator: a walk of `walk.generations` steps on q, from x to y, and y accepted
    with probability min(1, p(y) q(x) / (p(x) q(y))). But the steps are those of `walk`, which need no other chain:
    chains move independently, all at once, and nothing adapts. The walk is reversible with respect to q, so that every
    draw leaves p invariant, however short the walk and however poor q. A walk that forgets x proposes an independent
    draw of q, and if q is near p, the effective size is near the number of draws.
    """

    def __init__(self, target: Target, screen: Map, walk: Walk, settings: Settings, seed: int, length: int = 1):
        super().__init__(target, settings.dream, seed, screen=screen, every=walk.generations)
        self.emulator, self.steps, self.burn_in = screen, walk.steps, BURN_IN
        self.decisions = BURN_IN + length * (settings.independence.draws - BURN_IN)

    def advance(self, state: State) -> None:
        """Make one draw of every chain. Changes `state`."""
        draw = int(state.generation) // self.every
        random = generator(self.seed, "independence", "draw", draw)
        self._count_from_here(state, draw)
        here = self.emulator(state.position)
        after, there, accepted, _ = self.steps.walk(self.emulator, state.position, self.every, random)
        state.screen_accepted += accepted
        self._decide(state, np.arange(len(after)), after, here, there, accepted > 0, random)
        self._decided(state)


def try_emulator(
    posterior: Posterior, linearised: Linearised, y: np.ndarray, flows: np.ndarray, settings: Settings, seed: int
) -> Pilot:
    """Run the model at draws of the emulator and decide by their Pareto k; all ranks together.

    Where these runs find the emulator too poor, it is fitted to them as well, and tried again: they lie where the first
    design, coordinates `y` (n, d) with `flows` (n, N), had too few. A pilot costs little beside the chains: unless no
    ratio is twice their mean, `REFINED` emulators are tried, and up to `ATTEMPTS` while k is above its limit.
    """
    dream, ranks, space = settings.dream, posterior.ranks, posterior.space
    assert not isinstance(space, Rescaled)  # its states have no emulator
    start, made, k_hat, refused = y[: dream.chains], 0, np.nan, ""
    for attempt in range(ATTEMPTS):
        emulator = ranks.run_on_first(partial(Emulator.of_runs, posterior, linearised, y, flows))
        screen = emulator.screen(space, posterior.likelihood, posterior.inverse_steady)
        walk, rhat = ranks.run_on_first(partial(explore, screen, start, linearised, dream, seed))
        if not rhat < EXPLORED:
            refused = f"R-hat of chains on the emulator is {rhat:.3f}, should be below {EXPLORED}"
            break
        random = generator(seed, "independence", "pilot", attempt)
        count = min(PILOT * dream.chains, len(walk.draws))
        points = walk.draws[random.choice(len(walk.draws), size=count, replace=False)]
        log_density, at_points = posterior(points)
        made += count
        k_hat, weights = pareto_smoothed(log_density - screen(points))
        if good_enough(k_hat, weights, settings.independence.k_limit if attempt >= REFINED - 1 else -np.inf):
            chosen = random.choice(count, size=dream.chains, p=weights)
            return Pilot(emulator, walk, made, k_hat, "", (points[chosen], log_density[chosen], at_points[chosen]))
        refused = (
            f"Pareto k of the last {count} of {made} runs at draws of the emulator is {k_hat:.2f}, "
            f"should be below {settings.independence.k_limit}"
        )
        alive = np.isfinite(log_density)
        y, flows = np.vstack([y, points[alive]]), np.vstack([flows, at_points[alive]])
    return Pilot(emulator, walk, made, k_hat, refused, None)
