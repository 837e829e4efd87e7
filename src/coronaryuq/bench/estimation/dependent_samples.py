"""Problems of the coverage benchmark whose samples depend on each other: chains, repeated inputs."""

import numpy as np

from coronaryuq.bench.estimation.problems import PROPAGATION, SEED, Problem, Trial
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.runs.table import States
from coronaryuq.estimation.surrogates.control_variates import Seen

DIMENSIONS = 3
TIME, TIME_OF_PILOT = 19, 3
"""Autocorrelation times of propagation samples and of the pilot, in samples."""
CHAINS, LENGTH, TIME_OF_CHAIN = 8, 250, 5
"""A short posterior: its states have an effective size of about 210."""


def autoregressive(rng: np.random.Generator, count: int, time: float) -> np.ndarray:
    """Return states (count, d) of a stationary Gaussian chain (integrated time about 2 `time`)."""
    rho, noise = np.exp(-1 / time), rng.standard_normal((count, DIMENSIONS))
    states = np.empty_like(noise)
    states[0] = noise[0]
    for k in range(1, count):
        states[k] = rho * states[k - 1] + np.sqrt(1 - rho**2) * noise[k]
    return states


def _independent(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.standard_normal((count, DIMENSIONS))


def _autocorrelated_propagation(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, None]:
    return _independent(rng, n), autoregressive(rng, PROPAGATION, TIME), None


def _autocorrelated(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, None]:
    return autoregressive(rng, n, TIME_OF_PILOT), autoregressive(rng, PROPAGATION, TIME), None


def _near_duplicates(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, None]:
    distinct = _independent(rng, -(-n // 3))
    pilot = distinct[rng.integers(len(distinct), size=n)] + 1e-4 * _independent(rng, n)
    return pilot, _independent(rng, PROPAGATION), None


def _short_chain(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, States]:
    states = np.stack([autoregressive(rng, LENGTH, TIME_OF_CHAIN) for _ in range(CHAINS)])
    chain, draw = rng.integers(CHAINS, size=n + PROPAGATION), rng.integers(LENGTH, size=n + PROPAGATION)
    drawn = states[chain, draw]
    return drawn[:n], drawn[n:], States(chain, draw)


DRAWN = {
    "autocorrelated propagation": _autocorrelated_propagation,
    "autocorrelated pilot and propagation": _autocorrelated,
    "near-duplicates": _near_duplicates,
    "short chain": _short_chain,
}


def problems() -> list[Problem]:
    """Return the problems: y = 1 + 0.1 x_0 + 0.1 x_1 + 0.03 x_1 x_2, q = x_0 + x_1 of x = log θ, standard normal."""
    return [Problem(name, _drawer(name), _low) for name in DRAWN]


def _drawer(name: str):
    def draw(n: int, trial: int) -> Trial:
        pilot, more, states = DRAWN[name](generator(SEED, "coverage", name, n, trial), n)
        y = 1 + 0.1 * (pilot[:, 0] + pilot[:, 1]) + 0.03 * pilot[:, 1] * pilot[:, 2]
        return Trial(_seen(pilot), y, _seen(more), 1.0, states=states)

    return draw


def _seen(x: np.ndarray) -> Seen:
    low = x[:, 0] + x[:, 1]
    return Seen(x, low, low[:, None])


def _low(theta: np.ndarray) -> np.ndarray:
    return np.log(theta[:, 0] * theta[:, 1])
