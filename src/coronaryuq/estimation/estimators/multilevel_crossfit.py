"""Fine 3D, coarse 3D and 0D as three levels of one cross-fitted estimate.

With f a prediction of the 3D quantity y that sees the coarse run at the same θ, and g the same prediction where an
emulator of the coarse run stands in, so that g is a function of θ alone,

    y = (y − f) + (f − g) + g

and each part is averaged over as many samples as its cost allows: y − f over the n pilot runs, f − g over the pilot and
m further coarse runs, g over the propagation samples. Within fold k, f and g have seen neither the pilot runs, nor the
coarse runs, nor the propagation samples of that fold, so the estimate is unbiased whatever they are; the parts are
weighted as if they were uncorrelated, which they are as far as f and g are conditional means. Multilevel Monte Carlo
(Giles 2015), its levels linked by regression (Kennedy and O'Hagan 2000).

f sees the coarse run only where that leaves less variance, by leave-one-out residuals within each training set;
otherwise f and g are the same, and the estimate is that of the selector without a coarse level.

A coarse run that failed is replaced by the emulator's prediction, in the pilot and beyond it alike: f is still one
function of the sample, so failures bias nothing, whatever they depend on.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from coronaryuq.estimation.estimators.crossfit import CrossFit, Estimate, Options, Propagated, combine
from coronaryuq.estimation.estimators.design import Design
from coronaryuq.estimation.estimators.formulas import correlation
from coronaryuq.estimation.estimators.influence import CENTRE, Influence, changes
from coronaryuq.estimation.estimators.per_row import tally
from coronaryuq.estimation.results import Parts
from coronaryuq.estimation.runs.table import CoarseRuns, Row, pair
from coronaryuq.estimation.surrogates import selector
from coronaryuq.estimation.surrogates.control_variates import Fitted, Seen

LEAST = 0.5
"""Smallest fraction of the coarse runs that must have succeeded: below it the level is mostly emulation."""
Choose = Callable[[Seen, np.ndarray], Fitted]


def multilevel(
    design: Design, row: Row, level: float, choose: Choose = selector.choose
) -> tuple[Estimate, Parts] | None:
    """Estimate one row and the variances of its parts; None without a coarse level that mostly succeeded.

    `choose` fits f, and the emulator of the coarse run, within each training set.
    """
    coarse = design.runs.coarse
    if coarse is None or row.column_3d not in coarse.outputs or not all(len(b.index) for b in design.coarse):
        return None
    y, _ = pair(design.runs, row)
    outputs = coarse.outputs[row.column_3d].to_numpy(float)
    if np.isfinite(outputs).mean() < LEAST:
        return None
    fits = [_Fit(design, coarse, row, k, y, outputs, choose) for k in range(len(design.blocks))]
    return _combined(design, y, fits, level)


class _Fit:
    """f and g of one fold, and their predictions at the fold's own samples; coarse (n + m,): outputs of that level."""

    def __init__(
        self, design: Design, level: CoarseRuns, row: Row, k: int, y: np.ndarray, coarse: np.ndarray, choose: Choose
    ):
        seen, index = design.coarse_training(level, row, k)
        ran = np.isfinite(coarse[index])
        self.emulator = choose(seen[ran], coarse[index][ran])
        trained, self.train = design.training(row, k)
        self.sees_coarse, plain = True, choose(trained, y[self.train])
        linked = choose(self._with(trained, coarse[self.train]), y[self.train])
        # Chosen within the training set: residual variance of y over the pilot, and of f over all coarse runs.
        real = coarse[index][ran]
        views = [replace(seen[ran], coarse=c) for c in (real, real - self.emulator.leave_one_out)]
        step = np.var(linked.predict(views[0]) - linked.predict(views[1]))
        self.sees_coarse = linked.missed + step * len(self.train) / len(index) < plain.missed
        self.fitted = linked if self.sees_coarse else plain
        held, self.held = design.held(row, k)
        beyond, at = design.coarse_held(row, k)
        more, n = design.propagated(row, k), len(y)
        self.f_held, self.g_held, moved = self._both(held, coarse[self.held], n)
        f_beyond, g_beyond, moved_beyond = self._both(beyond, coarse[at], n)
        self.between = f_beyond - g_beyond
        self.variance = self.fitted.variance(self._with(held, coarse[self.held]))
        self.variance_beyond = self.fitted.variance(self._with(beyond, coarse[at])).mean()
        self.moved, self.moved_g = moved
        self.centre = (moved_beyond[0] - moved_beyond[1]).mean(axis=0)
        block = design.blocks[k]
        more = self._with(more, np.full(len(more), np.nan))
        self.g_raw = self.fitted.predict(more)
        self.g_more = block.average(self.g_raw)
        weights = block.weights(min(CENTRE, len(block.index)))
        self.centre_g = weights @ changes(self.fitted, more[: len(weights)], self.train, n) / weights.sum()

    def _with(self, seen: Seen, coarse: np.ndarray) -> Seen:
        """Add the coarse run (m,), or its emulation where it is not finite."""
        if not self.sees_coarse:
            return seen
        ran = np.isfinite(coarse)
        return replace(seen, coarse=coarse if ran.all() else np.where(ran, coarse, self.emulator.predict(seen)))

    def _both(self, seen: Seen, coarse: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        """f and g at samples (m,), and how every pilot run moves them (m, n)."""
        views = [self._with(seen, coarse), self._with(seen, np.full(len(seen), np.nan))]
        f, g = (self.fitted.predict(view) for view in views)
        return f, g, [changes(self.fitted, view, self.train, n) for view in views]


def _combined(design: Design, y: np.ndarray, fits: list[_Fit], level: float) -> tuple[Estimate, Parts]:
    n = len(y)
    f, g, variance, moved, moved_g = np.empty(n), np.empty(n), np.empty(n), np.empty((n, n)), np.empty((n, n))
    for fit in fits:
        variance[fit.held] = fit.variance
        f[fit.held], g[fit.held], moved[fit.held], moved_g[fit.held] = fit.f_held, fit.g_held, fit.moved, fit.moved_g
    between = np.concatenate([fit.between for fit in fits])
    # f − g is averaged over the pilot and the coarse runs beyond it, g over the pilot and the propagation samples.
    on_coarse = len(between) / (n + len(between))
    share = np.bincount(design.fold) / n
    everywhere = design.propagate_to_all([fit.g_raw for fit in fits])
    from_blocks = float(sum(s**2 * block.variance for s, block in zip(share, everywhere, strict=True)))
    spread = np.var(g, ddof=1) / n
    on_cheap = float(spread / (spread + from_blocks)) if spread > 0 else 0.0
    blocks = [
        Propagated(on_cheap * block.values, block.integrated, also=(on_coarse * fit.between,), at=block.at)
        for fit, block in zip(fits, everywhere, strict=True)
    ]
    influence = Influence(
        design.fold,
        on_coarse * (moved - moved_g) + on_cheap * moved_g,
        [(on_coarse * fit.centre + on_cheap * fit.centre_g)[None] for fit in fits],
        [np.ones(1)] * len(fits),
        variance,
        [np.array([fit.variance_beyond]) for fit in fits],
    )
    cross_fit = CrossFit(y, on_coarse * (f - g) + on_cheap * g, blocks, design.fold, design.dependence)
    options = Options(level, beta=1.0, between=influence.between())
    estimate = combine("multilevel: " + tally([_name(fit) for fit in fits]), cross_fit, n + len(between), options)
    parts = Parts(
        float(np.var(y - f, ddof=1)),
        float(np.var(np.concatenate([f - g, between]), ddof=1)),
        float(np.mean([np.var(fit.g_more, ddof=1) for fit in fits])),
    )
    return replace(estimate, rho_held_out=correlation(y, f)), parts


def _name(fit: _Fit) -> str:
    """Return the method's name, with the coarse run in it where the method used it."""
    method = fit.fitted.method
    return f"{method} and coarse" if fit.sees_coarse and "coarse" not in method else method
