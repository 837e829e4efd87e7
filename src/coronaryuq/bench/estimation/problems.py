"""Problems with a known mean for the coverage benchmark: analytic pairs drawn anew, published runs subsampled."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.bench.estimation.pairs import Pair
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators.design import Block, Design
from coronaryuq.estimation.runs.table import Row, Runs, States, pair
from coronaryuq.estimation.surrogates.control_variates import Seen
from coronaryuq.estimation.surrogates.emulator import Emulator, informative

SEED, PROPAGATION = 20241117, 2000
ROW = Row("row", "y", "q0", "")


@dataclass(frozen=True)
class Trial:
    """One trial: pilot and its 3D outputs (n,), propagation samples; and the true mean.

    more_y (m,): 3D outputs at the propagation samples, which no estimator may use, if their mean is the truth instead
    of `mean`. states: of a Markov chain, where all samples are such.
    """

    seen: Seen
    y: np.ndarray
    more: Seen
    mean: float = np.nan
    more_y: np.ndarray | None = None
    states: States | None = None

    @property
    def target(self) -> int:
        return 0 if self.more_y is None else len(self.more)

    def blocks(self, k: int) -> list[np.ndarray]:
        """Return the propagation samples of each of k folds."""
        return [np.arange(j, len(self.more), k) for j in range(k)]

    def truth(self, fold: np.ndarray) -> float:
        """Return the true mean; of a finite set, blocks are weighted as the folds (n,) of the pilot."""
        if self.more_y is None:
            return self.mean
        runs = np.bincount(fold)
        return float(np.average([self.more_y[b].mean() for b in self.blocks(len(runs))], weights=runs))


@dataclass(frozen=True)
class Problem:
    """`draw(n, trial)`: the trial's pilot of n runs and more; `low(θ)`: the 0D output (m,) at any inputs (m, d)."""

    name: str
    draw: Callable[[int, int], Trial]
    low: Callable[[np.ndarray], np.ndarray]


def from_pair(of: Pair) -> Problem:
    """Draw everything anew in each trial, with `PROPAGATION` propagation samples."""

    def see(theta: np.ndarray) -> Seen:
        low = of.low(theta)
        return Seen(np.log(theta), low[:, 0], low)

    def draw(n: int, trial: int) -> Trial:
        rng = generator(SEED, "coverage", of.name, n, trial)
        theta, more = of.draw(rng, n), of.draw(rng, PROPAGATION)
        return Trial(see(theta), of.high(theta), see(more), of.mean)

    return Problem(of.name, draw, lambda theta: of.low(theta)[:, 0])


def from_runs(runs: Runs, row: Row) -> Problem:
    """Draw pilots from published runs without replacement.

    The runs left over are the propagation samples, and the mean of their 3D outputs, which no estimator uses, is the
    truth: a finite set without runs of the pilot, so its residuals add var(residuals) / rest to the variance. The 0D
    model at other inputs is an emulator of all runs.
    """
    y, q = pair(runs, row)
    outputs = runs.q[informative(runs.q, [row.column_0d])].to_numpy(float)
    everything = Seen(runs.coordinates(runs.theta), q, outputs)

    def draw(n: int, trial: int) -> Trial:
        order = generator(SEED, "coverage", "runs", n, trial).permutation(len(y))
        index, rest = order[:n], order[n:]
        return Trial(everything[index], y[index], everything[rest], more_y=y[rest])

    @cache
    def emulator() -> Emulator:
        return Emulator(runs.coordinates(runs.theta), runs.q[[row.column_0d]])

    return Problem(f"row {row.name}", draw, lambda theta: emulator().predict(runs.coordinates(theta))[row.column_0d])


def as_design(trial: Trial, fold: np.ndarray) -> Design:
    """Return the trial as a campaign's estimators use it, row `ROW`; its 0D outputs need no emulator."""
    k, more = int(fold.max()) + 1, trial.more
    names = [f"q{i}" for i in range(more.outputs.shape[1])]
    blocks = [
        Block(share, more.log_theta[share], dict(zip(names, more.outputs[share].T, strict=True)), 1)
        for share in trial.blocks(k)
    ]
    held_out = dict(zip(names, trial.seen.outputs.T, strict=True))
    return Design(runs_of(trial), fold, blocks, held_out, names, dict.fromkeys(names, 0.0), False, target=trial.target)


def runs_of(trial: Trial) -> Runs:
    seen, d = trial.seen, trial.seen.log_theta.shape[1]
    q = pd.DataFrame(seen.outputs, columns=[f"q{i}" for i in range(seen.outputs.shape[1])])
    return Runs(
        Path("."), tuple(f"theta_{j}" for j in range(d)), tuple(map(str, range(len(seen)))), np.exp(seen.log_theta),
        pd.DataFrame({"y": trial.y}), q, np.exp(trial.more.log_theta), None, np.empty((0, d)),
        states=trial.states,
    )  # fmt: skip
