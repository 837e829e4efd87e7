"""The estimators of one row: MC, MFMC, MFMC-AE and the best cross-fitted control variate, side by side."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from coronaryuq.estimation.estimators import multilevel
from coronaryuq.estimation.estimators.blue import Group
from coronaryuq.estimation.estimators.crossfit import Estimate, Propagated, combine
from coronaryuq.estimation.estimators.fold_covariance import CENTRE, Influence, changes
from coronaryuq.estimation.estimators.folds_and_blocks import Design
from coronaryuq.estimation.estimators.montecarlo import control_coefficient, correlation
from coronaryuq.estimation.runs.table import Row, pair
from coronaryuq.estimation.surrogates import mfmc_ae, selector
from coronaryuq.estimation.surrogates.control_variates import METHODS, Fitted, Seen


def monte_carlo(design: Design, row: Row, level: float, weights=None) -> Estimate:
    """Plain Monte Carlo over the pilot."""
    y, _ = pair(design.runs, row)
    empty = [Propagated(np.zeros(1)) for _ in design.blocks]
    return combine("MC", y, np.zeros(len(y)), empty, design.fold, len(y), level, beta=0.0, weights=weights)


def mfmc(design: Design, row: Row, level: float, weights=None) -> Estimate:
    """MFMC with α cross-fitted; 0D outputs at propagation samples are real where there are any, else emulated."""
    y, q = pair(design.runs, row)
    fits = [METHODS["linear 0D"](*_of(design.training(row, k), y)) for k in range(len(design.blocks))]
    held, blocks = np.empty(len(y)), []
    more = design.runs.q_more
    for k, fitted in enumerate(fits):
        seen, index = design.held(row, k)
        block = design.blocks[k]
        if more is not None:
            own = more[row.column_0d].to_numpy(float)[block.index]
            held[index] = fitted.predict(_only(seen, q[index]))
            blocks.append(Propagated(fitted.predict(_only(design.propagated(row, k)[: len(own)], own))))
        else:
            held[index] = fitted.predict(seen)
            middle = fitted.predict(design.propagated(row, k))
            blocks.append(Propagated(block.average(middle), block.repeats))
    n_0d = len(y) + (0 if more is None else len(more))
    return combine("MFMC", y, held, blocks, design.fold, n_0d, level, weights=weights)


@dataclass(frozen=True)
class Predictions:
    """Cross-fitted predictions of one 3D quantity.

    held (n,): at each pilot run, by the fold that did not see it. raw: per fold, at its propagation samples and the
    nodes of an integrated input (m_k · s,).
    influence: of pilot runs on them. doubt: per fold, variance of y given the prediction (m · s,) at the first m of its
    propagation samples. methods: what the selector took, fold by fold.
    """

    held: np.ndarray
    raw: list[np.ndarray]
    influence: Influence
    doubt: list[Callable[[int], np.ndarray]]
    methods: tuple[str, ...]


def predict(design: Design, row: Row, simple: bool = False) -> Predictions:
    """Fit the selector's choice within each training set and predict its held-out runs and propagation samples."""
    y, _ = pair(design.runs, row)
    n = len(y)
    held, raw, doubt, taken = np.empty(n), [], [], []
    moved, variance, centres, variances, weights = np.zeros((n, n)), np.empty(n), [], [], []
    for k, block in enumerate(design.blocks):
        trained, train = design.training(row, k)
        fitted = selector.choose(trained, y[train], simple=simple)
        (seen, index), more = design.held(row, k), design.propagated(row, k)
        held[index], variance[index] = fitted.predict(seen), fitted.variance(seen)
        raw.append(fitted.predict(more))
        taken.append(fitted.method)
        weights.append(block.weights(min(CENTRE, len(block.index))))
        moved[index] = changes(fitted, seen, train, n)
        some = more[: len(weights[-1])]
        centres.append(changes(fitted, some, train, n))
        variances.append(fitted.variance(some))
        doubt.append(partial(_doubt, fitted, more, block.repeats))
    influence = Influence(design.fold, moved, centres, weights, variance, variances)
    return Predictions(held, raw, influence, doubt, tuple(taken))


def _doubt(fitted: Fitted, more: Seen, repeats: int, samples: int) -> np.ndarray:
    return fitted.variance(more[: samples * repeats])


def several_models(design: Design, row: Row, seed: int, level: float) -> Estimate | None:
    """Multilevel BLUE over the coarse level and 0D outputs, the row's own first; None where no coarse level was run.

    One cheap model for every ten pilot runs, and these two at least: weights of more are not known. None where a coarse
    run failed too: group means without it would be of another law.
    """
    runs = design.runs
    if runs.coarse is None or row.column_3d not in runs.coarse:
        return None
    y, _ = pair(runs, row)
    n, coarse = len(y), runs.coarse[row.column_3d].to_numpy(float)
    if not np.isfinite(coarse).all():
        return None
    others = [name for name in design.shared if name != row.column_0d and runs.q[name].nunique() > 1]
    columns = [row.column_0d, *others[: max(0, n // 10 - 2)]]
    cheap = tuple(range(2, 2 + len(columns)))
    groups = [Group((0, 1, *cheap), np.column_stack([y, coarse[:n], runs.q[columns]]))]
    groups.append(Group((1, *cheap), np.column_stack([coarse[n:], runs.q_coarse[columns]])))
    if runs.q_more is not None:
        groups.append(Group(cheap, runs.q_more[columns].to_numpy(float)))
    folds = len(design.blocks)
    return multilevel.estimate([g for g in groups if len(g.outputs) >= 2 * folds], folds, seed, level)


def best(design: Design, row: Row, made: Predictions, level: float, weights=None) -> Estimate:
    """Mean by the control variate that the selector took within each training set."""
    y, _ = pair(design.runs, row)
    blocks = [Propagated(b.average(v), b.repeats) for b, v in zip(design.blocks, made.raw, strict=True)]
    counted = Counter(made.methods).most_common()
    name = "best: " + ", ".join(f"{method} {times}/{len(made.methods)}" for method, times in counted)
    between = made.influence.between(shares=weights)
    return combine(
        name, y, made.held, blocks, design.fold, len(y), level, weights=weights, between=between, target=design.target
    )


def autoencoder(
    design: Design, row: Row, networks: mfmc_ae.Networks, curves: dict, level: float, weights=None
) -> Estimate:
    """Cross-fitted MFMC-AE. `curves`: fold → (places (c,) on the 0D latent axis, 0D outputs there (c,))."""
    y, _ = pair(design.runs, row)
    held, raw = follow(design, row, networks, curves)
    blocks = [Propagated(b.average(v), b.repeats) for b, v in zip(design.blocks, raw, strict=True)]
    n_0d = len(y) + sum(len(places) for k, (places, _) in curves.items() if k != mfmc_ae.IN_SAMPLE)
    return combine("MFMC-AE", y, held, blocks, design.fold, n_0d, level, weights=weights, target=design.target)


def follow(design: Design, row: Row, networks: mfmc_ae.Networks, curves: dict) -> tuple[np.ndarray, list[np.ndarray]]:
    """MFMC-AE's control variate α q: held out, at each pilot run (n,), and per fold at its propagation samples."""
    y, _ = pair(design.runs, row)
    folds = len(design.blocks)
    held, raw = np.empty(len(y)), []
    for k in range(folds):
        index = np.flatnonzero(design.fold == k)
        follows = aligned(design.runs.theta, y, np.flatnonzero(design.fold != k), networks, row, k, curves)
        held[index] = follows(design.runs.theta[index])
        raw.append(follows(np.exp(design.blocks[k].log_theta)))
    # α of a fold from the held-out pairs of the others: from its own training runs it would be as over-fitted as they
    # are.
    alpha = np.array([control_coefficient(y[design.fold != k], held[design.fold != k]) for k in range(folds)])
    return alpha[design.fold] * held, [a * v for a, v in zip(alpha, raw, strict=True)]


def aligned(theta: np.ndarray, y: np.ndarray, train: np.ndarray, networks, row: Row, k: int, curves: dict):
    """The resampled 0D output of fold k as a function of θ (m, d), standardised and rising with y (n,) over the runs
    `train` that the fold's network saw: each network has its own sign and scale."""
    at_training = _along(networks, row, k, curves, theta[train])
    scale = np.sign(correlation(y[train], at_training) or 1.0) / (at_training.std() or 1.0)
    shift = at_training.mean()
    return lambda new: scale * (_along(networks, row, k, curves, new) - shift)


def autoencoder_in_sample(design: Design, row: Row, networks: mfmc_ae.Networks, curves: dict) -> float:
    """|ρ| of the network that saw all runs, on those same runs: the paper's "modified" correlation, sign of y."""
    y, _ = pair(design.runs, row)
    return correlation(y, _along(networks, row, mfmc_ae.IN_SAMPLE, curves, design.runs.theta))


def _along(networks, row: Row, k: int, curves: dict, theta: np.ndarray) -> np.ndarray:
    places, outputs = curves[k]
    return mfmc_ae.along_curve(places, outputs, mfmc_ae.latent(networks, row.name, k, theta))


def _of(training, y):
    seen, index = training
    return seen, y[index]


def _only(seen, row_output):
    return type(seen)(seen.log_theta, row_output, seen.outputs)
