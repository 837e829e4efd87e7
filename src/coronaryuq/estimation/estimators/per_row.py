"""The estimators of one row: MC, MFMC, MFMC-AE, BLUE and crossfit-GP."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from coronaryuq.estimation.estimators import blue
from coronaryuq.estimation.estimators.blue import Group
from coronaryuq.estimation.estimators.crossfit import CrossFit, Estimate, Options, Propagated, combine
from coronaryuq.estimation.estimators.design import Design
from coronaryuq.estimation.estimators.formulas import control_coefficient, correlation
from coronaryuq.estimation.estimators.influence import CENTRE, Between, Influence, changes
from coronaryuq.estimation.runs.table import Row, pair
from coronaryuq.estimation.surrogates import mfmc_ae, selector
from coronaryuq.estimation.surrogates.control_variates import METHODS, Fitted, Seen

Curves = dict[int, tuple[np.ndarray, np.ndarray]]
"""Fold (`mfmc_ae.IN_SAMPLE` for the fit to all runs) → places on the 0D latent axis (c,) and 0D outputs there (c,)."""


def monte_carlo(design: Design, row: Row, level: float, weights: np.ndarray | None = None) -> Estimate:
    """Plain Monte Carlo over the pilot."""
    y, _ = pair(design.runs, row)
    nothing = [Propagated(np.zeros(1)) for _ in design.blocks]
    fit = CrossFit(y, np.zeros(len(y)), nothing, design.fold, design.dependence)
    return combine("MC", fit, len(y), Options(level, beta=0.0, weights=weights))


def mfmc(design: Design, row: Row, level: float, weights: np.ndarray | None = None) -> Estimate:
    """MFMC with α cross-fitted; 0D outputs at propagation samples are real where there are any, else emulated."""
    y, q = pair(design.runs, row)
    held, blocks, emulated = np.empty(len(y)), [], []
    more = design.runs.q_more
    for k, block in enumerate(design.blocks):
        trained, train = design.training(row, k)
        fitted = METHODS["linear 0D"](trained, y[train])
        seen, index = design.held(row, k)
        if more is not None:
            real = more[row.column_0d].to_numpy(float)[block.every]
            held[index] = fitted.predict(replace(seen, row_output=q[index]))
            values = fitted.predict(Seen(np.empty((len(real), 0)), real, np.empty((len(real), 0))))
            blocks.append(Propagated(values, segments=design.segments(block.every)))
        else:
            held[index] = fitted.predict(seen)
            emulated.append(fitted.predict(design.propagated(row, k)))
    blocks = blocks or design.propagate_to_all(emulated)
    n_0d = len(y) + (0 if more is None else len(more))
    fit = CrossFit(y, held, blocks, design.fold, design.dependence)
    return replace(combine("MFMC", fit, n_0d, Options(level, weights=weights)), rho_in_sample=correlation(y, q))


@dataclass(frozen=True)
class Predictions:
    """Cross-fitted predictions of one 3D quantity.

    held (n,): at each pilot run, by the fold that did not see it. raw: per fold, at its propagation samples and the
    nodes of an integrated input (m_k · s,).
    influence: of pilot runs on them. variance: per fold, the variance of y given the prediction (m · s,) at the first m
    of its propagation samples. fitted: the selector's choice, fold by fold.
    """

    held: np.ndarray
    raw: list[np.ndarray]
    influence: Influence
    variance: Sequence[Callable[[int], np.ndarray]]
    fitted: tuple[Fitted, ...]

    @property
    def methods(self) -> tuple[str, ...]:
        return tuple(fitted.method for fitted in self.fitted)

    def between(self, slope: np.ndarray, slopes: Sequence[np.ndarray]) -> Between:
        """Return what folds have in common for a function of y.

        slope, slopes: its derivative at `held` (n,), and per fold at the first samples of `raw` or at all of them.
        """
        return self.influence.between(slope, [s[: len(w)] for s, w in zip(slopes, self.influence.weights, strict=True)])

    def centre(self, design: Design, y: np.ndarray) -> float:
        """Return the mean of y (n,)."""
        fit = CrossFit(y, self.held, design.propagate_to_all(self.raw), design.fold, design.dependence)
        return combine("", fit, len(y), Options(target=design.target)).mean


def predict(design: Design, row: Row, simple: bool = False) -> Predictions:
    """Fit the selector's choice within each training set and predict its held-out runs and propagation samples.

    Parameters
    ----------
    design
        Folds, propagation blocks and emulated 0D outputs.
    row
        The 3D quantity and its 0D output.
    simple
        Leave the Gaussian processes out.

    Returns
    -------
    Predictions
        Cross-fitted predictions of the 3D quantity.
    """
    y, _ = pair(design.runs, row)
    n = len(y)
    held, raw, given, taken = np.empty(n), [], [], []
    moved, variance, centres, variances, weights = np.zeros((n, n)), np.empty(n), [], [], []
    for k, block in enumerate(design.blocks):
        trained, train = design.training(row, k)
        fitted = selector.choose(trained, y[train], simple=simple)
        (seen, index), more = design.held(row, k), design.propagated(row, k)
        held[index], variance[index] = fitted.predict(seen), fitted.variance(seen)
        raw.append(fitted.predict(more))
        taken.append(fitted)
        weights.append(block.weights(min(CENTRE, len(block.index))))
        moved[index] = changes(fitted, seen, train, n)
        some = more[: len(weights[-1])]
        centres.append(changes(fitted, some, train, n))
        variances.append(fitted.variance(some))
        given.append(partial(_variance, fitted, more, block.repeats))
    influence = Influence(design.fold, moved, centres, weights, variance, variances)
    return Predictions(held, raw, influence, given, tuple(taken))


def _variance(fitted: Fitted, more: Seen, repeats: int, samples: int) -> np.ndarray:
    return fitted.variance(more[: samples * repeats])


def several_models(design: Design, row: Row, seed: int, level: float) -> Estimate | None:
    """Multilevel BLUE over the coarse level and 0D outputs, the row's own first; None if no coarse level was run.

    One cheap model for every ten pilot runs, and these two at least: weights of more are not known. None if a coarse
    run failed, too: group means without it would belong to another distribution.
    """
    runs, coarse = design.runs, design.runs.coarse
    if coarse is None or row.column_3d not in coarse.outputs:
        return None
    y, _ = pair(runs, row)
    n, outputs = len(y), coarse.outputs[row.column_3d].to_numpy(float)
    if not np.isfinite(outputs).all():
        return None
    others = [name for name in design.shared if name != row.column_0d and runs.q[name].nunique() > 1]
    columns = [row.column_0d, *others[: max(0, n // 10 - 2)]]
    cheap = tuple(range(2, 2 + len(columns)))
    groups = [Group((0, 1, *cheap), np.column_stack([y, outputs[:n], runs.q[columns]]))]
    groups.append(Group((1, *cheap), np.column_stack([outputs[n:], coarse.q[columns]])))
    if runs.q_more is not None:
        groups.append(Group(cheap, runs.q_more[columns].to_numpy(float)))
    folds = len(design.blocks)
    return blue.estimate([g for g in groups if len(g.outputs) >= 2 * folds], folds, seed, level, design.dependence)


def crossfit_gp(
    design: Design, row: Row, predictions: Predictions, level: float, weights: np.ndarray | None = None
) -> Estimate:
    """Mean by the control variate that the selector chose within each training set."""
    y, _ = pair(design.runs, row)
    name = "crossfit-GP: " + tally(predictions.methods)
    between = predictions.influence.between(shares=weights)
    fit = CrossFit(y, predictions.held, design.propagate_to_all(predictions.raw), design.fold, design.dependence)
    options = Options(level, weights=weights, between=between, target=design.target)
    return combine(name, fit, len(y) + design.more_0d, options)


def tally(methods: Sequence[str]) -> str:
    """In how many folds each method was chosen, the most frequent one first."""
    return ", ".join(f"{method} {times}/{len(methods)}" for method, times in Counter(methods).most_common())


def autoencoder(
    design: Design, row: Row, networks: mfmc_ae.Networks, curves: Curves, level: float,
    weights: np.ndarray | None = None,
) -> Estimate:  # fmt: skip
    """Return the cross-fitted estimate of MFMC-AE.

    Parameters
    ----------
    design
        Folds, propagation blocks and emulated 0D outputs.
    row
        The 3D quantity and its 0D output.
    networks
        One trained pair of autoencoders per fold.
    curves
        Fold → (places (c,) on the 0D latent axis, 0D outputs there (c,)).
    level
        Of the calibrated interval.
    weights
        Weights (n,) of the pilot runs, mean one; equal if None.

    Returns
    -------
    Estimate
        The mean, with its standard error and interval.
    """
    y, _ = pair(design.runs, row)
    held, raw = follow(design, row, networks, curves)
    n_0d = len(y) + sum(len(places) for k, (places, _) in curves.items() if k != mfmc_ae.IN_SAMPLE)
    fit = CrossFit(y, held, design.propagate_to_all(raw), design.fold, design.dependence)
    return combine("MFMC-AE", fit, n_0d, Options(level, weights=weights, target=design.target))


def follow(design: Design, row: Row, networks: mfmc_ae.Networks, curves: Curves) -> tuple[np.ndarray, list[np.ndarray]]:
    """MFMC-AE's control variate α q: held out, at each pilot run (n,), and per fold at its propagation samples."""
    y, _ = pair(design.runs, row)
    held, functions = followed(design.runs.theta, y, design.fold, networks, row, curves)
    return held, [
        g(design.runs.from_coordinates(block.log_theta)) for g, block in zip(functions, design.blocks, strict=True)
    ]


def followed(
    theta: np.ndarray, y: np.ndarray, fold: np.ndarray, networks: mfmc_ae.Networks, row: Row, curves: Curves
) -> tuple[np.ndarray, list[Callable[[np.ndarray], np.ndarray]]]:
    """Return α q held out at each pilot run (n,), and per fold as a function of θ (m, d)."""
    folds = range(int(fold.max()) + 1)
    functions = [aligned(theta, y, np.flatnonzero(fold != k), networks, row, k, curves) for k in folds]
    held = np.empty(len(y))
    for k in folds:
        held[fold == k] = functions[k](theta[fold == k])
    # α of a fold from the held-out pairs of the others: its own training runs would over-fit it as they do the network.
    alpha = np.array([control_coefficient(y[fold != k], held[fold != k]) for k in folds])
    return alpha[fold] * held, [_times(alpha[k], functions[k]) for k in folds]


def _times(factor: float, function: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    return lambda theta: factor * function(theta)


def aligned(
    theta: np.ndarray, y: np.ndarray, train: np.ndarray, networks: mfmc_ae.Networks, row: Row, k: int, curves: Curves
) -> Callable[[np.ndarray], np.ndarray]:
    """Return the resampled 0D output of fold k as a function of θ (m, d), with a common sign and scale.

    Each network has its own: the output is standardised and made to rise with y (n,) over the network's runs `train`.
    """
    at_training = _along(networks, row, k, curves, theta[train])
    scale = np.sign(correlation(y[train], at_training) or 1.0) / (at_training.std() or 1.0)
    shift = at_training.mean()
    return lambda new: scale * (_along(networks, row, k, curves, new) - shift)


def autoencoder_in_sample(design: Design, row: Row, networks: mfmc_ae.Networks, curves: Curves) -> float:
    """|ρ| of the network that saw all runs, on those same runs: the paper's "modified" correlation, sign of y."""
    y, _ = pair(design.runs, row)
    return correlation(y, _along(networks, row, mfmc_ae.IN_SAMPLE, curves, design.runs.theta))


def _along(networks: mfmc_ae.Networks, row: Row, k: int, curves: Curves, theta: np.ndarray) -> np.ndarray:
    places, outputs = curves[k]
    return mfmc_ae.along_curve(places, outputs, mfmc_ae.latent(networks, row.name, k, theta))
