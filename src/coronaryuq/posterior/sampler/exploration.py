"""The emulated posterior, explored without any run of the model: how chains move on it, and draws of it."""

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from coronaryuq.core.seeds import generator
from coronaryuq.posterior.model.emulator import FREEDOM
from coronaryuq.posterior.model.linearised import Linearised
from coronaryuq.posterior.sampler.diagnostics import effective_size, split_rhat
from coronaryuq.posterior.sampler.dream import Map
from coronaryuq.posterior.settings import DreamSettings

EXPLORED = 1.05
"""R-hat below which chains on the emulator have explored it."""

LENGTHS = (1, 1, 4, 16)
"""Lengths of the rounds of exploration, over `dream.generations` or `LEAST`; at least two are made."""
LEAST = 200

RECORDED = 4000
"""States of each chain on the emulator that are looked at, at most twice as many."""

KEPT = 100
"""Draws of the emulator that each chain leaves."""

AUTOCORRELATION_TIMES = 2.0
"""Length of a walk: two neighbouring draws are then correlated by a few per cent."""


@dataclass(frozen=True)
class Steps:
    """Crank-Nicolson steps that leave a Student t invariant, and so accept long moves on what is near it.

    In coordinates u in which the t is standard, and with its scale mixture's g, a gamma variable given u,

        v = sqrt(1 - b^2) u + b e / sqrt(g),    e standard normal, b uniform in (0, 1),

    is reversible with respect to the t, and accepted by the ratio of target to t it is so with respect to the target
    (Cotter, Roberts, Stuart and White, Stat. Sci. 28, 2013; with g, Kamatani, Bernoulli 24, 2018). With a Gaussian
    instead of the t, chains would stay in the tails of the emulated posterior, which are those of a t.

    Parameters
    ----------
    centre, root
        (d,) and (d, d): x = centre + root u.
    """

    centre: np.ndarray
    root: np.ndarray

    def walk(
        self, target: Map, x: np.ndarray, count: int, random: np.random.Generator, apart: int = 0
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Make `count` steps on a target from `x` (n, d).

        Returns where they end (n, d), the target's log density there (n,), the number of accepted steps (n,) and, if
        `apart` is not zero, every so many states (m, n, d).
        """
        (n, d), density, states = x.shape, target(x), []
        accepted = np.zeros(n)
        with threadpool_limits(1):
            u = np.linalg.solve(self.root, (x - self.centre).T).T
            distance = np.sum(u**2, axis=1)
            for step in range(count):
                b = random.uniform(size=(n, 1))
                g = random.gamma(0.5 * (FREEDOM + d), size=n) / (0.5 * (FREEDOM + distance))
                v = np.sqrt(1.0 - b**2) * u + b * random.standard_normal((n, d)) / np.sqrt(g)[:, None]
                moved = self.centre + v @ self.root.T
                there, further = target(moved), np.sum(v**2, axis=1)
                ratio = (
                    there - density + 0.5 * (FREEDOM + d) * (np.log1p(further / FREEDOM) - np.log1p(distance / FREEDOM))
                )
                accept = np.log(random.uniform(size=n)) < ratio
                x, u = np.where(accept[:, None], moved, x), np.where(accept[:, None], v, u)
                density, distance = np.where(accept, there, density), np.where(accept, further, distance)
                accepted += accept
                if apart and step % apart == 0:
                    states.append(x)
        return x, density, accepted, np.array(states)


@dataclass(frozen=True)
class Walk:
    """How chains move on the emulator.

    centre (d,), root (d, d): of the steps. generations: steps after which a chain has forgotten where it was. draws
    (m, d): of the emulator, nearly independent.
    """

    centre: np.ndarray
    root: np.ndarray
    generations: int
    draws: np.ndarray

    @property
    def steps(self) -> Steps:
        return Steps(self.centre, self.root)


def explore(
    screen: Map, start: np.ndarray, about: Linearised, settings: DreamSettings, seed: int
) -> tuple[Walk, float]:
    """Move chains on the emulator, in rounds until they agree; return the walk and the largest R-hat of the last round.

    Within a round nothing adapts. Between two, the t of the steps gets the mean and the covariance of the round's later
    half, the covariance weighted by its effective size, that of the linearised posterior by d.

    Parameters
    ----------
    screen
        The emulator's log density.
    start
        Of the chains (chains, d).
    about
        The first t's centre and precision.
    settings
        Their `generations` are the length of a round.
    seed
        Of the campaign.
    """
    d = start.shape[1]
    with threadpool_limits(1):
        first = np.linalg.inv(about.factor).T
    steps, x, rhat = Steps(about.centre, first), start, np.inf
    for attempt, length in enumerate(LENGTHS):
        count = length * max(settings.generations, LEAST)
        apart, random = -(-count // (2 * RECORDED)), generator(seed, "posterior", "exploration", attempt)
        x, _, _, states = steps.walk(screen, x, count, random, apart)
        states = states[len(states) // 2 :]
        by_chain = states.swapaxes(0, 1)
        size = float(effective_size(by_chain, "bulk").min())
        time = apart * states.shape[0] * states.shape[1] / size
        rhat = float(split_rhat(by_chain).max())
        if attempt and rhat < EXPLORED:
            break
        flat = states.reshape(-1, d)
        with threadpool_limits(1):
            covariance = (size * np.cov(flat.T).reshape(d, d) + d * first @ first.T) / (size + d)
            steps = Steps(flat.mean(axis=0), np.linalg.cholesky(covariance))
    draws = states[:: -(-len(states) // KEPT)].reshape(-1, d)
    return Walk(steps.centre, steps.root, int(np.ceil(AUTOCORRELATION_TIMES * time)), draws), rhat
