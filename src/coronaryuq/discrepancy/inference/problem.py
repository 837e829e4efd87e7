"""A discrepancy problem: data, rows to fit, and fits of hypotheses, with the time-step error corrected."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.forward.instruments import instruments
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.error_runs import ErrorRuns
from coronaryuq.discrepancy.inference.evidence import Data, PossibleNoise
from coronaryuq.discrepancy.inference.flexible import Flexible
from coronaryuq.discrepancy.inference.gauss_newton import STEP, Fit, Label, Linear, Search, maximise
from coronaryuq.discrepancy.inference.known_errors import unresolved
from coronaryuq.discrepancy.inference.pullback_errors import independent_sd
from coronaryuq.discrepancy.inference.time_step_error import FINER, OSCILLATES, Sized, TimeSteps
from coronaryuq.discrepancy.settings import Settings

OTHER_STARTS = (-1.0, 1.0, -2.0, 2.0, 0.0)
"""Further starting points of an effect's sizes, in prior standard deviations."""
RESTARTS = (0.0, 2.0, -1.0)
"""Sizes of all effects, in prior standard deviations, from which `multistart_each` starts."""
DRAWN_STARTS = 7
"""Number of random starts: if each finds the best optimum with probability one half, all miss it in 1 of 128 fits."""
SMALLER = -2.0
"""Starting point if the model does not run at a candidate's own, in prior standard deviations."""
CORRECTIONS = 6
"""Maximum number of iterations of the time-step correction."""


@dataclass
class Problem:
    """Measurements of a case, and the model to explain them.

    Attributes
    ----------
    y, sd, change
        Data, standard deviations (with the model's floor and the time-step allowance), and the time-step correction
        that is added to predictions: (N,), CGS.
    train
        Rows to be fitted: (N,), bool.
    owner, condition
        Number of the measured series of each row, and its condition: (N,).
    widened
        Log of the ratio in which the errors of time steps widen the standard deviations, where they differ between
        hypotheses, and zero elsewhere: (N,).
    count
        Number of nuisance parameters.
    time_steps
        Known error of the time steps.
    runs
        Runs from which it follows, created when needed.
    shorter
        The model with shorter time steps, created when needed.
    noises
        Quantity → noises that its measurements may have; evidence of all data is averaged over them.
    """

    forward: Forward
    settings: Settings
    train: np.ndarray
    time_steps: TimeSteps | None = None
    runs: ErrorRuns | None = None
    shorter: Forward | None = None
    noises: dict[str, tuple[PossibleNoise, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        series = self.forward.measured
        self.y = np.concatenate([s.value for s in series])
        floor = [np.full(s.value.size, self.settings.model_floor * np.abs(s.value).max()) for s in series]
        self.sd = np.hypot(np.concatenate([independent_sd(s) for s in series]), np.concatenate(floor))
        self.change, self.widened = np.zeros(len(self.y)), np.zeros(len(self.y))
        if self.time_steps is not None:
            alone, self.sd = self.sd, np.hypot(self.sd, self.time_steps.sd)
            self.change, self.widened = self.time_steps.change, np.log(self.sd / alone) * self.unresolved
        self.owner = np.repeat(np.arange(len(series)), [s.value.size for s in series])
        self.condition = np.array([s.condition for s in series])[self.owner]
        self.count = len(self.forward.nuisances)
        self.linearised: dict[tuple[bytes, Hypothesis], Linear] = {}

    @cached_property
    def flexible(self) -> Flexible:
        """The flexible discrepancy of the fitted data."""
        return gp_discrepancy.flexible(self, self.train)

    @cached_property
    def flexible_of_all(self) -> Flexible:
        """The flexible discrepancy of all data, held-out ones included."""
        return gp_discrepancy.flexible(self, np.ones(len(self.y), dtype=bool))

    @cached_property
    def all_data(self) -> Data:
        """All data under each noise that they may have."""
        return Data(self, np.ones(len(self.y), dtype=bool))

    @cached_property
    def fitted_data(self) -> Data:
        """The fitted data under each noise that they may have."""
        return Data(self, self.train)

    @property
    def unresolved(self) -> bool:
        """Whether the time-step error at a fit cannot be computed with any steps, and is treated as random."""
        return self.time_steps is not None and self.time_steps.about is not None

    def with_noises(self, noises: dict[str, tuple[PossibleNoise, ...]]) -> "Problem":
        """Return the problem with other possible noises, and with all that does not depend on them."""
        other, kept = replace(self, noises=noises), ("recalibrated", "flexible", "flexible_of_all", "linearised")
        vars(other).update({name: value for name, value in vars(self).items() if name in kept})
        return other

    def error_runs(self) -> ErrorRuns:
        """Return the runs of the model from which its known errors follow, before it has shapes of these."""
        self.runs = self.runs or ErrorRuns(self.forward)
        return self.runs

    def whitened(self, rows: list[tuple[np.ndarray, Hypothesis]]) -> np.ndarray:
        """Return (y - f) / sd of all data for rows (z, hypothesis): (n, N)."""
        return (self.y - self.change - self.forward.predict_rows(rows)) / self.sd

    def fitted(self, rows: list[tuple[np.ndarray, Hypothesis]], grafts: Sequence[PlacedEffect] = ()) -> np.ndarray:
        """Return whitened residuals (n, M) of the fitted data alone, for rows (z, hypothesis).

        Other conditions are run only if a measurement error may depend on them. grafts: see `Forward.predict_rows`.
        """
        conditions = set(self.condition[self.train])
        predicted = self.forward.predict_rows(rows, conditions, grafts)
        return ((self.y - self.change - predicted) / self.sd)[:, self.train]

    def shape_weights(self) -> tuple[list[int], np.ndarray]:
        """Return the columns of z that are weights of shapes, and the whitened sensitivities (N, k) of all data."""
        shapes = self.forward.shapes
        if shapes is None or not self.forward.shape_columns:
            return [], np.zeros((len(self.y), 0))
        return self.forward.shape_columns, (shapes / self.sd).T

    def linear_part(self) -> tuple[list[int], np.ndarray]:
        """Return the columns of z in which predictions are linear, and the sensitivities (M, k) of the fitted data."""
        columns, values = self.shape_weights()
        return columns, values[self.train]

    def anchors(self, conditions: Sequence[str]) -> np.ndarray:
        """Return which rows (N,) set the coronary resistance of one of these conditions, where that is free."""
        free = [name for name in conditions if self.forward.conditions[name].anchored]
        means = np.array([s.anchors for s in self.forward.measured])[self.owner]
        return np.isin(self.condition, free) & means

    @cached_property
    def recalibrated(self) -> Fit:
        """Fit of the model without any effect; raises FloatingPointError if the model does not run."""
        return self.calibrate(PLAIN)

    def calibrate(self, hypothesis: Hypothesis, start: np.ndarray | None = None) -> Fit:
        """Fit nuisance parameters and sizes together, recomputing all sensitivities.

        By default from the prior mean and, where there may be several optima, from `DRAWN_STARTS` draws of the
        parameters that cause them. Raises FloatingPointError if the model runs at no start.
        """
        starts = self._starts(self.count + len(hypothesis.parameters)) if start is None else [start]
        fits = [fit for fit in self.calibrate_each([(hypothesis, one) for one in starts]) if fit is not None]
        if not fits:
            raise FloatingPointError("the model could not be run")
        return max(fits, key=lambda fit: fit.evidence)

    def _starts(self, size: int) -> list[np.ndarray]:
        several = [column for column, nuisance in enumerate(self.forward.nuisances) if nuisance.several]
        starts = np.zeros((1 + DRAWN_STARTS * bool(several), size))
        starts[1:, several] = generator(0, "discrepancy", "starts").standard_normal((len(starts) - 1, len(several)))
        return list(starts)

    def calibrate_each(self, wanted: list[tuple[Hypothesis, np.ndarray | None]]) -> list[Fit | None]:
        """Fit several hypotheses in parallel, each as `calibrate`; None if the model does not run at the start."""
        searches = []
        for hypothesis, start in wanted:
            if start is None:
                start = np.zeros(self.count + len(hypothesis.parameters))
            searches.append(self._in_full(hypothesis, start))
        maximise(self.fitted, searches, self.settings.iterations)
        return [None if search.failed else search.fit for search in searches]

    def converge(self, hypothesis: Hypothesis, fit: Fit) -> Fit:
        """Continue a fit to convergence, with central differences.

        Other fits end within a thousandth of their objective, or when one-sided differences predict no further gain.
        That is enough to compare evidence, but if residuals exceed the noise, errors of the sizes are then a
        considerable part of their posterior standard deviations.
        """
        search = self._in_full(hypothesis, fit.z, jacobian=fit.jacobian.copy(), central=True)
        maximise(self.fitted, [search], self.settings.iterations, share=0.0)
        return fit if search.failed else search.fit

    def _in_full(self, label: Label, start: np.ndarray, **known: Any) -> Search[Label]:
        """Return a search that recomputes all sensitivities except constant ones; known: initial sensitivities."""
        exact = self.linear_part()
        fresh = [column for column in range(len(start)) if column not in exact[0]]
        if "jacobian" in known:
            known["jacobian"][:, exact[0]] = exact[1]
        return Search(label, np.array(start, dtype=float), fresh, exact=exact, flexible=self.flexible, **known)

    def corrected(self, hypothesis: Hypothesis, fit: Fit) -> tuple["Problem", Fit]:
        """Correct the time-step error at a fit and refit; return the corrected problem and the fit.

        The time-step error is known for the plain model, and how it varies with the nuisance parameters; an effect that
        makes valves open or vessels ring differently changes it. It is evaluated repeatedly at the fit until the fit no
        longer changes (deferred correction; Pereyra 1968), and the allowances for its variation are kept. If it is
        small, problem and fit are left unchanged.
        """
        problem = self
        for _ in range(CORRECTIONS):
            other = problem._corrected_at(fit.z, hypothesis)
            if other is None:
                break
            search = other._in_full(hypothesis, fit.z, jacobian=fit.jacobian.copy(), renewed=fit.renewed)
            maximise(other.fitted, [search], self.settings.iterations)
            if search.failed:
                break
            problem, fit = other, search.fit
        return problem, fit

    def _corrected_at(self, z: np.ndarray, hypothesis: Hypothesis) -> "Problem | None":
        """Return the problem with the time-step error at a point; None if that is hardly another."""
        steps, shapes = self.time_steps, self.forward.shapes
        if steps is None or shapes is None:
            return None
        if steps.about is None:
            (change,) = self.time_step_change([(z, hypothesis)])
            small = not np.isfinite(change).all() or self.missed(change) < RULE.time_step_error
            return None if small else replace(self, time_steps=replace(steps, change=change))
        drawn = self._unresolved_at(steps, steps.about, z, hypothesis)
        moved = np.vstack([drawn.change - steps.change, drawn.shapes - steps.shapes])
        if np.linalg.norm(moved / self.sd) < RULE.time_step_error:
            return None
        shapes = np.vstack([drawn.shapes, shapes[len(steps.shapes) :]])
        return replace(self, forward=replace(self.forward, shapes=shapes), time_steps=drawn)

    def _unresolved_at(self, steps: TimeSteps, about: Sized, z: np.ndarray, hypothesis: Hypothesis) -> TimeSteps:
        """Return the error that no steps tell, with other effects on the network if these have changed it."""
        point, effects = hypothesis.without_measurement_errors(z)
        before, change = (np.append(effects.nuisances(point), about[1]), about[0]), self.time_step_change
        if not effects or np.linalg.norm(np.diff(change([before, (point, effects)]), axis=0) / self.sd) > OSCILLATES:
            about = effects, effects.all_sizes(point)
        # It is an error of the waveforms, which instruments read with them.
        chain, noise = instruments(hypothesis, hypothesis.physical_sizes(z)), np.sqrt(self.sd**2 - steps.sd**2)
        return unresolved(self.error_runs(), noise, about, chain) or steps

    def time_step_change(self, rows: list[tuple[np.ndarray, Hypothesis]]) -> np.ndarray:
        """Return the change (n, N) of predictions by shorter time steps for rows (z, hypothesis), CGS."""
        # Use a copy of the states stored so far: new ones must not change other runs' results.
        own = replace(self.forward, simulation=self.forward.simulation.fork())
        if self.shorter is None:
            self.shorter = own.refined(FINER)
        return self.shorter.predict_rows(rows) - own.predict_rows(rows)

    def missed(self, change: np.ndarray) -> float:
        """Return the norm, in noise sd, of another correction (N,) beyond the time-step allowances."""
        _, values = self.shape_weights()
        missed, shapes = (change - self.change) / self.sd, values.T
        weights = np.linalg.solve(np.eye(len(shapes)) + shapes @ shapes.T, shapes @ missed)
        return float(np.sqrt(max(missed @ (missed - shapes.T @ weights), 0.0)))

    def multistart_each(self, hypotheses: Sequence[Hypothesis]) -> list[Fit | None]:
        """Return for each hypothesis the best of several fits from the prior mean, with different sizes of all effects.

        All are fitted together. After two iterations the best of each is fitted to convergence, unless it stays far
        behind the best of all even by its linear model. None if the model runs at no start.
        """
        searches = []
        for hypothesis in hypotheses:
            for size in RESTARTS:
                sizes = np.full(len(hypothesis.parameters), size)
                searches.append(self._in_full(hypothesis, np.concatenate([np.zeros(self.count), sizes])))
        maximise(self.fitted, searches, 2)
        each = (searches[first : first + len(RESTARTS)] for first in range(0, len(searches), len(RESTARTS)))
        best = [max((s for s in own if not s.failed), key=lambda s: s.fit.evidence, default=None) for own in each]
        leading = max((search.fit.evidence for search in best if search), default=0.0)
        close = [s for s in best if s and not s.done and s.fit.promised.right > leading - RULE.far_behind]
        maximise(self.fitted, close, self.settings.iterations)
        return [None if search is None else search.fit for search in best]

    def distorted(self, fit: Fit) -> bool:
        """Return whether recalibration has left the prior, so that candidates are better scored at another point."""
        moved = [z for z, nuisance in zip(fit.z, self.forward.nuisances, strict=False) if nuisance.shape is None]
        return bool(np.abs(moved).max(initial=0.0) > RULE.distorted)

    def linearisation_point(self, fit: Fit, hypothesis: Hypothesis) -> Fit:
        """Return the fit or, if it is distorted, the prior mean with the fit's sizes, to score candidates there, too.

        With the right effect the nuisance parameters are within their prior, and about its mean that effect appears
        undistorted; about a distorted fit a neighbour that causes the same distortion may look better.
        """
        if not self.distorted(fit):
            return fit
        z = hypothesis.at_prior_mean(fit.z)
        (residual,) = self.whitened([(z, hypothesis)])
        if not np.isfinite(residual).all():
            return fit
        jacobian = self.sensitivity(z, residual, hypothesis)
        return Fit(z, residual[self.train], jacobian[self.train], flexible=self.flexible)

    def fit_candidates(
        self, base: Fit, hypothesis: Hypothesis, candidates: list[PlacedEffect], guesses: Sequence[np.ndarray | Fit]
    ) -> list[Fit | None]:
        """Fit one more effect each, as `fit_roughly`, and those not far behind the best also from other points.

        guesses: starting sizes of each, or points. All take two iterations from there, those not far behind the best
        also from `starts - 1` other points; of each of these, the best so far continues. Returns the best fit of each,
        None if no run succeeded.
        """
        best: list[Fit | None] = [None] * len(candidates)
        sizes = [len(placed.effect.parameters) for placed in candidates]

        def search(numbers: Sequence[int], starts: Sequence[np.ndarray | Fit], iterations: int) -> None:
            fits = self.fit_roughly(base, hypothesis, [candidates[i] for i in numbers], starts, iterations, candidates)
            for number, fit in zip(numbers, fits, strict=True):
                known = best[number]
                if fit is not None and (known is None or fit.evidence > known.evidence):
                    best[number] = fit

        search(range(len(candidates)), guesses, 2)
        # The solver may fail at a size although it runs at a smaller one.
        failed = [i for i, fit in enumerate(best) if fit is None]
        search(failed, [np.full(sizes[i], SMALLER) for i in failed], 2)
        leading = max((fit.evidence for fit in best if fit is not None), default=0.0)
        close = [i for i, fit in enumerate(best) if fit and fit.evidence > leading - RULE.far_behind]
        others = [(i, size) for size in OTHER_STARTS[: self.settings.starts - 1] for i in close]
        search([i for i, _ in others], [np.full(sizes[i], size) for i, size in others], 2)
        search(close, [fit for i in close if (fit := best[i])], self.settings.iterations)
        return best

    def fit_roughly(
        self,
        base: Fit,
        hypothesis: Hypothesis,
        candidates: list[PlacedEffect],
        starts: Sequence[np.ndarray | Fit],
        iterations: int | None = None,
        beside: Sequence[PlacedEffect] = (),
    ) -> list[Fit | None]:
        """Fit one more effect each, with all other sensitivities frozen at those of `base`.

        starts: sizes of each, to be added to the point of `base`, or an earlier fit; iterations: maximum, by default
        that of the settings; beside: candidates inserted into the same networks. None if the model does not run at the
        start.
        """
        searches, exact = [], self.linear_part()
        for candidate, start in zip(candidates, starts, strict=True):
            if isinstance(start, Fit):
                z, jacobian = start.z, start.jacobian.copy()
            else:
                z = np.concatenate([base.z, start])
                jacobian = np.hstack([base.jacobian, np.zeros((len(base.residual), len(start)))])
            label, fresh = hypothesis.with_(candidate), list(range(len(base.z), len(z)))
            searches.append(Search(label, z, fresh, jacobian, exact=exact, flexible=self.flexible))
        grafts = [placed for placed in dict.fromkeys([*hypothesis, *(beside or candidates)]) if placed.effect.grafted]
        maximise(lambda rows: self.fitted(rows, grafts), searches, iterations or self.settings.iterations)
        return [None if search.failed else search.fit for search in searches]

    def sensitivity(self, z: np.ndarray, residual: np.ndarray, hypothesis: Hypothesis) -> np.ndarray:
        """Return whitened sensitivities (N, p) of all data, held-out ones too, about z (p,) with its residual (N,).

        Zero if the model runs on neither side.
        """
        columns, values = self.shape_weights()
        others = np.setdiff1d(np.arange(len(z)), columns)
        steps = STEP * np.eye(len(z))[others]
        moved = -(self.whitened([(row, hypothesis) for row in z + steps]) - residual).T / STEP
        failed = np.flatnonzero(~np.isfinite(moved).all(axis=0))
        if failed.size:
            back = self.whitened([(row, hypothesis) for row in z - steps[failed]])
            moved[:, failed] = np.nan_to_num((back - residual).T / STEP)
        jacobian = np.zeros((len(residual), len(z)))
        jacobian[:, others], jacobian[:, columns] = moved, values
        return jacobian
