"""Search of one branch: laws fitted on all samples and in each fold, and the held-out FFR of each model."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.table_model.law_selection import SHRUNK, Choice, choose
from coronaryuq.discrepancy.table_model.laws import FLOOR_FFR, LAWS, ONE_EFFECT, Law, LawFit, fit_law, fit_laws, predict
from coronaryuq.discrepancy.table_model.tables import Branch

FOLDS = 5
LEAST_GAIN = 3.0
"""Log evidence relative to no effect above which there is a misfit to explain."""
LEFT, LEFT_FLEXIBLE, LEFT_SCATTER, LEFT_FLOORS = 0.1, 3.0, 2.0, 2.0
"""Held-out error of FFR that a law may leave: relative to the model's error; to that of a flexible discrepancy, or to
the scatter, whichever is smaller; and to `FLOOR_FFR`. If it leaves more than all three, something outside the library
is missing. Of a right law, error and scatter of 20 samples differ by a sixth."""
WORSE = 2.0
"""Standard errors, of the paired difference of squares over held-out samples, by which a law must be worse than
recalibration to be refuted: rescaling the model's own loss is a linear loss as well, and ties."""
CONSTANT = 1e-9
"""Relative spread below which an input counts as constant over all samples, such as a prescribed root pressure."""
MOST_FLEXIBLE = 120
"""Maximum number of samples to which the Gaussian process is fitted."""


@dataclass(frozen=True)
class BranchSearch:
    """Laws fitted to one branch, those selected on all samples and in each fold, and FFR of every sample, (n,).

    before: simulated; plain: recalibrated; after: with the law; flexible: Gaussian process; the last three held out.
    """

    branch: Branch
    ranked: list[LawFit]
    choice: Choice
    in_folds: list[tuple[str, ...]]
    measured: np.ndarray
    before: np.ndarray
    plain: np.ndarray
    after: np.ndarray
    flexible: np.ndarray

    def rmse(self, values: np.ndarray) -> float:
        """Root mean square error of an FFR (n,)."""
        return float(np.sqrt(np.mean((values - self.measured) ** 2)))

    @property
    def recalibrated(self) -> LawFit:
        """The law without any effect."""
        return next(f for f in self.ranked if not f.law.terms)

    @property
    def alarm(self) -> bool:
        """Whether a law is more probable than none, or recalibration scales the model's own loss beyond its prior."""
        return self.ranked[0].evidence - self.recalibrated.evidence > LEAST_GAIN or self.recalibrated.own > -SHRUNK

    @property
    def scatter(self) -> float:
        """Change of what the law leaves from one sample to that of the next flow, as the noise of one sample.

        A law of the wrong form leaves something that changes smoothly with flow.
        """
        left = (self.after - self.measured)[np.argsort(self.branch.flow3)]
        return float(np.sqrt(0.5 * np.mean(np.diff(left) ** 2)))

    @property
    def misfits(self) -> bool:
        """Whether what the law leaves is clearly not noise, beyond the accuracy of lumped losses."""
        noise = min(LEFT_FLEXIBLE * self.rmse(self.flexible), LEFT_SCATTER * self.scatter)
        return self.rmse(self.after) >= max(noise, LEFT_FLOORS * FLOOR_FFR)

    @property
    def overstated(self) -> bool:
        """Whether the measurements show much less loss than the model, which then has too much: nothing is missing."""
        return self.choice.fit.own < SHRUNK and self.measured.mean() > self.before.mean()

    @property
    def outside(self) -> bool:
        """Whether the law leaves too much error, predicts worse than recalibration by `WORSE`, or removes own loss."""
        if self.overstated or (self.misfits and self.rmse(self.after) >= LEFT * self.rmse(self.before)):
            return True
        worse = (self.after - self.measured) ** 2 - (self.plain - self.measured) ** 2
        error = worse.std(ddof=1) / np.sqrt(len(worse))
        return bool(self.alarm and self.choice.classes and worse.mean() > WORSE * error)

    @property
    def doubt(self) -> bool:
        """Whether a law is named although its form is visibly wrong."""
        return self.misfits and self.alarm and not self.outside


def search_branch(branch: Branch, fold: np.ndarray, others: Sequence[Branch] = ()) -> BranchSearch:
    """Select laws for one branch. fold: (n,), the fold that each sample is held out in; others: the other branches."""
    measured = branch.distal3 / branch.root3
    inputs = np.array([branch.root0, *(x for one in (branch, *others) for x in (one.flow0, one.distal0 / one.root0))]).T
    held_out = [_held_out(inputs[:, :count], measured, fold) for count in dict.fromkeys((3, inputs.shape[1]))]
    flexible = min(held_out, key=lambda ffr: float(np.linalg.norm(ffr - measured)))
    search = _search(branch, fold, flexible, LAWS)
    if search.doubt and len(search.choice.fit.law.effects) > 1:
        # If the form of the loss is wrong, a sensor error absorbs the difference.
        search = _search(branch, fold, flexible, ONE_EFFECT)
    return search


def _search(branch: Branch, fold: np.ndarray, flexible: np.ndarray, laws: tuple[Law, ...]) -> BranchSearch:
    ranked = fit_laws(branch, np.ones(len(fold), dtype=bool), laws)
    after, plain, in_folds = np.empty(len(fold)), np.empty(len(fold)), []
    for k in range(FOLDS):
        train, test = fold != k, fold == k
        best = choose(fit_laws(branch, train, laws, ranked)).fit
        in_folds.append(best.law.effects)
        after[test] = predict(branch, best.terms)[0][test]
        plain[test] = predict(branch, fit_law(branch, LAWS[0], train).terms)[0][test]
    measured, before = branch.distal3 / branch.root3, branch.distal0 / branch.root0
    return BranchSearch(branch, ranked, choose(ranked), in_folds, measured, before, plain, after, flexible)


def _held_out(inputs: np.ndarray, target: np.ndarray, fold: np.ndarray) -> np.ndarray:
    """Predict each sample's target (n,) from its inputs (n, k), by the samples of the other folds."""
    predicted = np.empty(len(fold))
    for k in range(FOLDS):
        predicted[fold == k] = _gaussian_process(inputs, target, fold != k, fold == k)
    return predicted


def _gaussian_process(inputs: np.ndarray, target: np.ndarray, train: np.ndarray, test: np.ndarray) -> np.ndarray:
    """Predict FFR from simulated outputs by a Gaussian process, a reference for the information in the pairs."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    inputs = inputs[:, inputs[train].std(axis=0) > CONSTANT * np.abs(inputs[train]).max(axis=0)]
    if inputs.shape[1] == 0:
        return np.full(int(test.sum()), target[train].mean())
    inputs = (inputs - inputs[train].mean(axis=0)) / inputs[train].std(axis=0)
    smooth = ConstantKernel(10.0, (1e-2, 1e8)) * RBF(np.full(inputs.shape[1], 5.0), (1e-1, 1e3))
    process = GaussianProcessRegressor(smooth + WhiteKernel(1e-3, (1e-10, 1.0)), normalize_y=True)
    some = np.flatnonzero(train)[:: -(-int(train.sum()) // MOST_FLEXIBLE)]
    with warnings.catch_warnings():
        # If the optimiser reaches a bound or stops early, the reference is only slightly worse.
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(inputs[some], target[some])
    return process.predict(inputs[test])
