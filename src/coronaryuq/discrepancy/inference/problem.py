"""One discrepancy problem: the data, which of them may be fitted, and fits of models with and without effects."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.gauss_newton import STEP, Fit, Search, maximise
from coronaryuq.discrepancy.inference.time_step_error import FINER, TimeSteps, finer
from coronaryuq.discrepancy.settings import Settings

OTHER_STARTS = (-1.0, 1.0, -2.0, 2.0, 0.0)
"""Further starting points of an effect's sizes, in prior standard deviations."""
RESTARTS = (0.0, 2.0, -1.0)
"""Sizes of all effects, in prior standard deviations, from which a fit that left the prior is made again."""
SMALLER = -2.0
"""Starting point where a candidate's own does not run, in prior standard deviations."""
DISTORTED = 3.0
"""Prior standard deviations that recalibration moves a nuisance parameter by where something else is missing."""
FAR_BEHIND = 40.0
"""Log evidence behind the best after two iterations at which a candidate is not fitted further."""

MISSED = 0.5
"""Norm, in noise standard deviations, of what the time steps put wrong at a fit and are not allowed for, from which
they are put right there: it moves no size by more than so many standard deviations of its posterior."""
CORRECTIONS = 6
"""Times at most that a fit is made again with what its own time steps change."""


@dataclass
class Problem:
    """Data y (N,), standard deviations sd (N,) with the model's floor and its time steps' share, rows to be fitted.

    Predictions are put right by what shorter time steps change of them on average.
    """

    forward: Forward
    settings: Settings
    train: np.ndarray
    time_steps: TimeSteps | None = None
    shorter: Forward | None = None
    """The same model with shorter time steps."""

    def __post_init__(self):
        series = self.forward.measured
        self.y = np.concatenate([s.value for s in series])
        floor = [np.full(s.value.size, self.settings.model_floor * np.abs(s.value).max()) for s in series]
        self.sd = np.hypot(np.concatenate([s.sd for s in series]), np.concatenate(floor))
        self.change = np.zeros(len(self.y))
        if self.time_steps is not None:
            self.sd, self.change = np.hypot(self.sd, self.time_steps.sd), self.time_steps.change
        self.owner = np.repeat(np.arange(len(series)), [s.value.size for s in series])
        self.condition = np.array([s.condition for s in series])[self.owner]
        self.count = len(self.forward.nuisances)

    def whitened(self, rows: list[tuple[np.ndarray, Hypothesis]]) -> np.ndarray:
        """(y - f) / sd for rows (z, hypothesis): (n, N)."""
        return (self.y - self.change - self.forward.predict_rows(rows)) / self.sd

    def fitted(self, rows: list[tuple[np.ndarray, Hypothesis]], grafts: Sequence[PlacedEffect] = ()) -> np.ndarray:
        """Whitened residuals of the fitted rows of the data alone, (n, M); other conditions are run only where an
        effect on the measuring side may depend on them.

        grafts: see `Forward.predict_rows`.
        """
        conditions = set(self.condition[self.train])
        predicted = self.forward.predict_rows(rows, conditions, grafts)
        return ((self.y - self.change - predicted) / self.sd)[:, self.train]

    def shaped(self) -> tuple[list[int], np.ndarray]:
        """Nuisance parameters that are weights of shapes, and the whitened sensitivities (N, k) to them of all rows."""
        columns = self.forward.shaping
        shapes = self.forward.shapes if columns else np.zeros((0, len(self.y)))
        return columns, (shapes / self.sd).T

    def linear_part(self) -> tuple[list[int], np.ndarray]:
        """Nuisance parameters in which predictions are linear, and sensitivities (M, k) of the fitted rows to them."""
        columns, values = self.shaped()
        return columns, values[self.train]

    def calibrate(self, hypothesis: Hypothesis, start: np.ndarray | None = None) -> Fit:
        """Fit nuisance parameters and sizes together, all sensitivities recomputed at every step (fitted rows only)."""
        (fit,) = self.calibrate_each([(hypothesis, start)])
        if fit is None:
            raise FloatingPointError("the model could not be run")
        return fit

    def calibrate_each(self, wanted: list[tuple[Hypothesis, np.ndarray | None]]) -> list[Fit | None]:
        """Fits in full of several sets of effects from their starts (None: the prior's mean), side by side.

        None where the model does not run at the start.
        """
        searches = []
        for hypothesis, start in wanted:
            if start is None:
                start = np.zeros(self.count + len(hypothesis.parameters))
            searches.append(self._in_full(hypothesis, start))
        maximise(self.fitted, searches, self.settings.iterations)
        return [None if search.failed else search.fit for search in searches]

    def to_the_end(self, hypothesis: Hypothesis, fit: Fit) -> Fit:
        """An earlier fit gone on with until it gains next to nothing, sensitivities by differences to both sides.

        Other fits end within a thousandth of their objective, and where differences to one side promise nothing more:
        little for the evidence of one effect against another's, but where residuals are larger than noise it moves a
        size by a good part of its posterior's standard deviation, and that too.
        """
        search = self._in_full(hypothesis, fit.z, jacobian=fit.jacobian.copy(), central=True)
        maximise(self.fitted, [search], self.settings.iterations, share=0.0)
        return fit if search.failed else search.fit

    def _in_full(self, label: object, start: np.ndarray, **known) -> Search:
        """A search that recomputes all sensitivities but those that are always the same; known: what it starts with."""
        exact = self.linear_part()
        fresh = [column for column in range(len(start)) if column not in exact[0]]
        return Search(label, np.array(start, dtype=float), fresh, exact=exact, **known)

    def corrected(self, hypothesis: Hypothesis, fit: Fit) -> tuple["Problem", Fit]:
        """The problem with what the time steps put wrong at a fit put right there, and the fit made again with that."""
        return self.corrected_each([(hypothesis, fit)])[0]

    def corrected_each(self, fits: list[tuple[Hypothesis, Fit]]) -> list[tuple["Problem", Fit]]:
        """For each fit the problem with what the time steps put wrong there put right, and that fit made again with
        it; both as they are where it is little. The fits are made side by side.

        What they change is known for the model as it is, and how it varies with the nuisance parameters; an effect that
        makes valves open or vessels ring in another way makes it another. It is taken at the fit again and again until
        it no longer moves that (deferred correction; Pereyra 1968), and the allowances for its variation are kept.
        """
        found = [(self, fit) for _, fit in fits]
        going = list(range(len(fits) if self.time_steps is not None else 0))
        for _ in range(CORRECTIONS):
            if not going:
                break
            changes = self._changed([(found[i][1].z, fits[i][0]) for i in going])
            moved = {
                i: replace(self, time_steps=replace(self.time_steps, change=change))
                for i, change in zip(going, changes, strict=True)
                if np.isfinite(change).all() and found[i][0].missed(change) >= MISSED
            }
            again = self._fitted_again([(other, fits[i][0], found[i][1]) for i, other in moved.items()])
            better = {i: (moved[i], fit) for i, fit in zip(moved, again, strict=True) if fit is not None}
            going = list(better)
            for i in going:
                found[i] = better[i]
        return found

    def _fitted_again(self, wanted: list[tuple["Problem", Hypothesis, Fit]]) -> list[Fit | None]:
        """Fits of problems that differ from this one in what is put right, from earlier ones: sensitivities hold."""
        searches = []
        for other, hypothesis, fit in wanted:
            label = hypothesis, other.change - self.change
            searches.append(self._in_full(label, fit.z, jacobian=fit.jacobian.copy(), renewed=fit.renewed))

        def fitted(rows):
            without = self.fitted([(z, hypothesis) for z, (hypothesis, _) in rows])
            further = np.array([change for _, (_, change) in rows]) / self.sd
            return without - further[:, self.train]

        maximise(fitted, searches, self.settings.iterations)
        return [None if search.failed else search.fit for search in searches]

    def _changed(self, rows: list[tuple[np.ndarray, Hypothesis]]) -> np.ndarray:
        """What shorter time steps change of the predictions (n, N) of rows (z, hypothesis), CGS."""
        # What is met here shall not serve other runs, whose last digits would then hang on it.
        own = replace(self.forward, simulation=self.forward.simulation.branched())
        if self.shorter is None:
            self.shorter = finer(own, FINER)
        return self.shorter.predict_rows(rows) - own.predict_rows(rows)

    def missed(self, change: np.ndarray) -> float:
        """Norm, in noise standard deviations, of what the time steps' allowances leave of another change (N,)."""
        missed, shapes = (change - self.change) / self.sd, self.forward.shapes / self.sd
        weights = np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes @ missed)
        return float(np.sqrt(max(missed @ (missed - shapes.T @ weights), 0.0)))

    def from_the_mean(self, hypothesis: Hypothesis) -> Fit | None:
        """The best of the fits that start from the prior's mean with one size or another of all effects, each to its
        end: halfway the best may be another one. None where the model runs at none."""
        sizes = len(hypothesis.parameters)
        starts = [np.concatenate([np.zeros(self.count), np.full(sizes, size)]) for size in RESTARTS]
        found = [fit for fit in self.calibrate_each([(hypothesis, start) for start in starts]) if fit is not None]
        return max(found, key=lambda one: one.evidence, default=None)

    def distorted(self, fit: Fit) -> bool:
        """Whether recalibration has left the prior, so that what is missing is better looked for from elsewhere."""
        moved = [z for z, nuisance in zip(fit.z, self.forward.nuisances, strict=False) if nuisance.shape is None]
        return bool(np.abs(moved).max(initial=0.0) > DISTORTED)

    def vantage(self, fit: Fit, hypothesis: Hypothesis) -> Fit:
        """Where candidates are looked at from: the fit, or, if it is distorted, the prior's mean with the fit's sizes.

        With the right effect the nuisance parameters are within their prior, and about its mean that effect looks as
        it is; about a distorted fit a neighbour that shares the distortion may look better.
        """
        if not self.distorted(fit):
            return fit
        z = hypothesis.at_prior_mean(fit.z)
        columns, values = self.shaped()
        others = np.setdiff1d(np.arange(len(z)), columns)
        rows = np.vstack([z, z + STEP * np.eye(len(z))[others]])
        found = self.fitted([(row, hypothesis) for row in rows])
        if not np.isfinite(found).all():
            return fit
        jacobian = np.zeros((len(found[0]), len(z)))
        jacobian[:, others], jacobian[:, columns] = -((found[1:] - found[0]) / STEP).T, values[self.train]
        return Fit(z, found[0], jacobian)

    def fit_candidates(
        self, base: Fit, hypothesis: Hypothesis, candidates: list[PlacedEffect], guesses: list[np.ndarray]
    ) -> list[Fit | None]:
        """Fit one more effect each, as `fit_roughly`, those not far behind the best from other points too.

        guesses: a starting point of the sizes for each. All take two iterations from there; those not far behind the
        best go on to the end, also from `starts - 1` other points. Returns the best fit of each, None where no run
        succeeded.
        """
        found: list[Fit | None] = [None] * len(candidates)

        def search(numbers, starts, iterations):
            fits = self.fit_roughly(base, hypothesis, [candidates[i] for i in numbers], starts, iterations, candidates)
            for number, fit in zip(numbers, fits, strict=True):
                if fit is not None and (found[number] is None or fit.evidence > found[number].evidence):
                    found[number] = fit

        search(range(len(candidates)), guesses, 2)
        # A size may be too much for the solver where a smaller one runs.
        failed = [i for i, fit in enumerate(found) if fit is None]
        search(failed, [np.full(len(guesses[i]), SMALLER) for i in failed], 2)
        leading = max((fit.evidence for fit in found if fit is not None), default=0.0)
        close = [i for i, fit in enumerate(found) if fit is not None and fit.evidence > leading - FAR_BEHIND]
        others = OTHER_STARTS[: self.settings.starts - 1]
        elsewhere = [np.full(len(guesses[i]), size) for size in others for i in close]
        starts = [*(found[i] for i in close), *elsewhere]
        search([*close, *(close * len(others))], starts, self.settings.iterations)
        return found

    def fit_roughly(
        self,
        base: Fit,
        hypothesis: Hypothesis,
        candidates: list[PlacedEffect],
        starts: list[np.ndarray | Fit],
        iterations: int | None = None,
        beside: Sequence[PlacedEffect] = (),
    ) -> list[Fit | None]:
        """Fit one more effect each; sensitivities to what is already there stay those of `base`.

        starts: sizes of each, beside the point of `base`, or an earlier fit; iterations: at most, the settings' unless
        given; beside: candidates whose networks these share. None where the model does not run at the start.
        """
        searches = []
        for candidate, start in zip(candidates, starts, strict=True):
            if isinstance(start, Fit):
                z, jacobian, sizes = start.z, start.jacobian.copy(), len(start.z) - len(base.z)
            else:
                z, sizes = np.concatenate([base.z, start]), len(start)
                jacobian = np.hstack([base.jacobian, np.zeros((len(base.residual), sizes))])
            fresh = list(range(len(base.z), len(base.z) + sizes))
            searches.append(Search(hypothesis.with_(candidate), z, fresh, jacobian, exact=self.linear_part()))
        grafts = [placed for placed in dict.fromkeys([*hypothesis, *(beside or candidates)]) if placed.effect.grafted]
        maximise(lambda rows: self.fitted(rows, grafts), searches, iterations or self.settings.iterations)
        return [None if search.failed else search.fit for search in searches]

    def sensitivity(self, z: np.ndarray, residual: np.ndarray, hypothesis: Hypothesis) -> np.ndarray:
        """Whitened sensitivities (N, p) of all rows, held-out ones included, about z (p,) with its whitened residual.

        Nought where the model runs to neither side.
        """
        columns, values = self.shaped()
        others = np.setdiff1d(np.arange(len(z)), columns)
        steps = STEP * np.eye(len(z))[others]
        moved = -(self.whitened([(row, hypothesis) for row in z + steps]) - residual).T / STEP
        failed = np.flatnonzero(~np.isfinite(moved).all(axis=0))
        if failed.size:
            back = self.whitened([(row, hypothesis) for row in z - steps[failed]])
            moved[:, failed] = np.nan_to_num((back - residual).T / STEP)
        found = np.zeros((len(residual), len(z)))
        found[:, others], found[:, columns] = moved, values
        return found
