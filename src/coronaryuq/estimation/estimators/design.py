"""Folds, propagation blocks and their 0D outputs, run or emulated, that all rows of one campaign share."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import stats

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import folds
from coronaryuq.estimation.estimators.crossfit import Propagated
from coronaryuq.estimation.estimators.dependence import INDEPENDENT, Dependence, Segments, assign_runs
from coronaryuq.estimation.estimators.regression import Regression
from coronaryuq.estimation.runs.table import CoarseRuns, Row, Runs, pair
from coronaryuq.estimation.surrogates.control_variates import Seen
from coronaryuq.estimation.surrogates.emulator import FAMILIES, Emulator, informative

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
MOST = 125_000
"""Predictions of one control variate at most, nodes of an integrated input included."""


@dataclass(frozen=True)
class Block:
    """Propagation samples of one fold at which control variates predict: indices (m,), and log θ (m · s, d).

    outputs: 0D output → values (m · s,), of 0D runs or emulated. repeats: s, the number of values of the integrated
    input, 1 where there is none. regression: of predictions on the inputs of all samples of the fold, where m are a
    part of these.
    """

    index: np.ndarray
    log_theta: np.ndarray
    outputs: dict[str, np.ndarray]
    repeats: int
    regression: Regression | None = None

    @property
    def every(self) -> np.ndarray:
        """Indices of all propagation samples of the fold."""
        return self.index if self.regression is None else self.regression.index

    def average(self, values: np.ndarray) -> np.ndarray:
        """Values (m · s,) integrated over the known input: (m,)."""
        if self.repeats == 1:
            return values
        return values.reshape(-1, self.repeats) @ (WEIGHTS / 2)

    def weights(self, samples: int) -> np.ndarray:
        """Weights of the first `samples` propagation samples at every value of the integrated input."""
        return np.ones(samples) if self.repeats == 1 else np.tile(WEIGHTS / 2, samples)


@dataclass(frozen=True)
class Design:
    """Everything that is fixed before any 3D output is used.

    fold (n,); blocks, one per fold; held_out: 0D output → (n,), from the same source as in the blocks; an emulator has
    not seen the sample's own fold; shared: names of the 0D outputs that every control variate may see, those of all
    `shared` rows among them; emulator_error: 0D output → held-out mean square error over variance, 0 without an
    emulator. coarse: per fold its samples of the coarse 3D level beyond the pilot; empty without such a level. target:
    as in `crossfit.Options`. dependence: how samples depend on each other.
    """

    runs: Runs
    fold: np.ndarray
    blocks: list[Block]
    held_out: dict[str, np.ndarray]
    shared: list[str]
    emulator_error: dict[str, float]
    integrated: bool
    coarse: tuple[Block, ...] = ()
    target: int = 0
    dependence: Dependence = INDEPENDENT

    @property
    def log_theta(self) -> np.ndarray:
        return self.runs.coordinates(self.runs.theta)

    @property
    def more_0d(self) -> int:
        """Number of 0D runs at propagation samples that predictions rest on; 0 where they are emulated."""
        return 0 if self.integrated or self.runs.q_more is None else len(self.runs.q_more)

    def training(self, row: Row, k: int) -> tuple[Seen, np.ndarray]:
        """Return what a control variate may use of the training runs of fold k (own 0D outputs), and their indices."""
        index = np.flatnonzero(self.fold != k)
        q = self.runs.q
        seen = Seen(self.log_theta, q[row.column_0d].to_numpy(float), q[self.shared].to_numpy(float))
        return seen[index], index

    def held(self, row: Row, k: int) -> tuple[Seen, np.ndarray]:
        """Return what it may use of the held-out runs of fold k (0D outputs as in the blocks), and their indices."""
        index = np.flatnonzero(self.fold == k)
        outputs = np.column_stack([self.held_out[c] for c in self.shared])
        return Seen(self.log_theta, self.held_out[row.column_0d], outputs)[index], index

    def propagated(self, row: Row, k: int) -> Seen:
        """Return what it may use of the propagation samples of fold k."""
        return self._of(row, self.blocks[k])

    def coarse_training(self, coarse: CoarseRuns, row: Row, k: int) -> tuple[Seen, np.ndarray]:
        """Return what it may use of the coarse samples outside fold k, and their indices: the pilot comes first."""
        pilot, index = self.training(row, k)
        part = np.ones(len(coarse.theta), dtype=bool)
        part[self.coarse[k].index] = False
        outputs = coarse.q[row.column_0d].to_numpy(float), coarse.q[self.shared].to_numpy(float)
        more = Seen(self.runs.coordinates(coarse.theta), *outputs)[part]
        both = (np.concatenate(arrays) for arrays in zip(pilot.arrays, more.arrays, strict=True))
        return Seen(*both), np.concatenate([index, len(self.runs) + np.flatnonzero(part)])

    def coarse_held(self, row: Row, k: int) -> tuple[Seen, np.ndarray]:
        """Return what it may use of the coarse samples of fold k beyond the pilot, and their indices."""
        return self._of(row, self.coarse[k]), len(self.runs) + self.coarse[k].index

    def propagate(self, raw: list[np.ndarray]) -> list[Propagated]:
        """Return predictions (m_k · s,) per fold, or a function of them, integrated over the known input."""
        return [
            Propagated(b.average(v), b.repeats, segments=self.segments(b.index))
            for b, v in zip(self.blocks, raw, strict=True)
        ]

    def propagate_to_all(self, raw: list[np.ndarray]) -> list[Propagated]:
        """Return predictions (m_k · s,) per fold as `propagate`, carried over to samples without a prediction."""
        found = self.propagate(raw)
        return [
            block if of.regression is None
            else replace(
                block, values=of.regression.to_all(block.values), segments=self.segments(of.every), at=len(of.index)
            )
            for of, block in zip(self.blocks, found, strict=True)
        ]  # fmt: skip

    def segments(self, index: np.ndarray) -> Segments | None:
        """Return the segments of some propagation samples; None where these are independent."""
        return None if self.dependence.more is None else self.dependence.more[index]

    def _of(self, row: Row, block: Block) -> Seen:
        outputs = np.column_stack([block.outputs[c] for c in self.shared])
        return Seen(block.log_theta, block.outputs[row.column_0d], outputs)


def make_design(
    runs: Runs, rows: list[Row], k: int, seed: int, scaling: str | None = None, most: int = 10,
    families: tuple[str, ...] = FAMILIES,
) -> Design:  # fmt: skip
    """Assign folds, share out propagation samples, emulate 0D outputs without each fold.

    Where every propagation sample has a 0D run, its outputs and those of the pilot are used as they are: an emulator of
    few runs hardly reaches the tails, so quantiles would be too narrow. An integrated input needs the emulator.

    `scaling`: input whose law is known to be uniform within its limits and independent of the others; where the
    propagation samples do not contradict that (`integrable`), control variates are integrated over it exactly at 8
    Gauss nodes. Of more than MOST predictions per control variate, a random part is made, and a regression carries them
    over to the other samples (`regression`). most, families: how many 0D outputs control variates may see, and their
    prefixes (see `informative`).
    """
    for row in rows:
        pair(runs, row)  # raises for a row that names a missing column
    n, m = len(runs), len(runs.theta_more)
    fold, dependence = assign_runs(runs, k, seed)
    k = int(fold.max()) + 1
    integrated = scaling is not None and integrable(runs, scaling)
    # At the nodes of an integrated input there are no 0D runs.
    more = None if integrated else runs.q_more
    wanted = list(dict.fromkeys(row.column_0d for row in rows if row.shared)) or [row.column_0d for row in rows]
    shared = informative(runs.q, wanted, max(most, len(wanted)), families)
    # One emulator per output: those of a single row change no other's.
    names = list(dict.fromkeys([*shared, *(row.column_0d for row in rows)]))
    order = generator(seed, "estimation", "blocks").permutation(m)
    predicted = MOST // (len(NODES) if integrated else 1)
    log_theta, held_out, blocks = runs.coordinates(runs.theta), {name: np.empty(n) for name in names}, []
    coarse, coarse_fold = [], folds.assign(len(runs.coarse.theta), k, seed, "coarse") if runs.coarse else None
    for j in range(k):
        train, held = fold != j, fold == j
        emulator = Emulator(log_theta[train], runs.q.loc[train, names]) if more is None else None
        for name, values in _outputs(emulator, log_theta[held], runs.q, names, held).items():
            held_out[name][held] = values
        every = np.flatnonzero(order % k == j)
        index = every[order[every] < predicted]
        spread, repeats = _spread(runs, index, scaling if integrated else None)
        regression = Regression.of(runs, every, index, scaling if integrated else None) if m > predicted else None
        blocks.append(Block(index, spread, _outputs(emulator, spread, more, names, index), repeats, regression))
        if runs.coarse is not None:
            index = np.flatnonzero(coarse_fold == j)
            log_coarse = runs.coordinates(runs.coarse.theta[index])
            coarse.append(Block(index, log_coarse, _outputs(emulator, log_coarse, runs.coarse.q, names, index), 1))
    error = {
        name: float(np.mean((held_out[name] - runs.q[name]) ** 2) / (np.var(runs.q[name]) or 1.0)) for name in names
    }
    return Design(runs, fold, blocks, held_out, shared, error, integrated, tuple(coarse), dependence=dependence)


def integrable(runs: Runs, scaling: str) -> bool:
    """Return whether the propagation samples agree with a uniform, independent `scaling`, both tests at 0.1 %.

    Kolmogorov-Smirnov against the limits; Spearman's rank correlation with every other input, Bonferroni-corrected.
    """
    if scaling not in runs.inputs or runs.limits is None or len(runs.theta_more) < 100:
        return False
    j = runs.inputs.index(scaling)
    low, high = runs.bounds(scaling)
    s, others = runs.theta_more[:, j], np.delete(runs.theta_more, j, axis=1)
    if s.min() < low or s.max() > high or (runs.logged[j] and low <= 0):
        return False
    uniform = stats.kstest(s, stats.uniform(low, high - low).cdf).pvalue
    moving = [other for other in others.T if np.ptp(other) > 0]
    ranks = stats.rankdata(s)
    # Spearman's correlation is Pearson's of ranks.
    p = (stats.pearsonr(ranks, stats.rankdata(other)).pvalue for other in moving)
    independent = min(p, default=1.0) * max(len(moving), 1)
    return bool(uniform > 1e-3 and independent > 1e-3)


def _outputs(
    emulator: Emulator | None, log_theta: np.ndarray, own: pd.DataFrame | None, names: list[str], rows: np.ndarray
) -> dict[str, np.ndarray]:
    """Return 0D outputs by name at some rows (indices or a mask): emulated, or without an emulator their own."""
    if emulator is not None:
        return emulator.predict(log_theta)
    if own is None:
        raise ValueError("neither an emulator of the 0D outputs nor 0D runs")
    return {name: own[name].to_numpy(float)[rows] for name in names}


def _spread(runs: Runs, index: np.ndarray, scaling: str | None) -> tuple[np.ndarray, int]:
    theta = runs.theta_more[index]
    if scaling is None:
        return runs.coordinates(theta), 1
    j = runs.inputs.index(scaling)
    low, high = runs.bounds(scaling)
    repeated = np.repeat(theta, len(NODES), axis=0)
    repeated[:, j] = np.tile(low + (NODES + 1) / 2 * (high - low), len(theta))
    return runs.coordinates(repeated), len(NODES)
