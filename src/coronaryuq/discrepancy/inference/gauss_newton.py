"""Gauss-Newton: maximum a posteriori, and marginal likelihood by Laplace, all in whitened numbers.

Data y (N,) with standard deviations sd; a model f(z) with z standard normal a priori. Whitened, the residual is
e = (y - f) / sd and the sensitivity is G = (df/dz) / sd, so that for a linear model, with M = I + G'G and e0 the
residual at z = 0, the marginal precision of the data is P = I - G M^-1 G' and

    log Z = -1/2 (e0' P e0) - 1/2 log det M + const,

where e0' P e0 is the minimum of |e|^2 + |z|^2 (Rasmussen & Williams 2006, appendix A.3; MacKay 2003, chapter 27).
The constant, -1/2 N log(2 pi) - sum log sd, is common to all models of the same data and is left out.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from coronaryuq.discrepancy.inference.flexible import Flexible, Posterior

STEP = 0.1
"""Finite-difference step in prior standard deviations."""


@dataclass
class Linear:
    """A model linearised at z (p,): whitened residual (N,) and sensitivities (N, p) of some data."""

    z: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray

    @property
    def at_zero(self) -> np.ndarray:
        """Residual (N,) of the linearised model at z = 0."""
        return self.residual + self.jacobian @ self.z

    def extended(self, features: np.ndarray) -> "Linear":
        """Add linear terms, whose weights are standard normal a priori."""
        z = np.append(self.z, np.zeros(features.shape[1]))
        return Linear(z, self.residual, np.hstack([self.jacobian, features]))


@dataclass
class Fit(Linear):
    """Maximum a posteriori of one model, linearised there.

    Attributes
    ----------
    renewed
        z at which all sensitivities were last recomputed; None if some come from another model.
    flexible
        Flexible discrepancy of the rows; None: the model has no error of its own.
    """

    renewed: np.ndarray | None = None
    flexible: Flexible | None = field(default=None, repr=False)

    @property
    def objective(self) -> float:
        return float(self.residual @ self.residual + self.z @ self.z)

    @property
    def precision(self) -> np.ndarray:
        """M = I + G'G, the posterior precision of z in the Laplace approximation."""
        return np.eye(len(self.z)) + self.jacobian.T @ self.jacobian

    @property
    def covariance(self) -> np.ndarray:
        return np.linalg.inv(self.precision)

    @cached_property
    def posterior(self) -> Posterior:
        """Posterior of the linearised model by the amplitude of its flexible discrepancy.

        The evidence is that of the point reached, not of the linear model's optimum.
        """
        return self.promised.lowered(self.unreached)

    @property
    def unreached(self) -> float:
        """Log evidence that the linear model promises, and the fit did not reach."""
        widened = 0.0 if self.flexible is None else self.flexible.widened
        return float(self.promised.log_evidence[0] + widened - self.evidence_without_error)

    @cached_property
    def promised(self) -> Posterior:
        """Posterior if the model were linear: that of its optimum, which the fit may not have reached."""
        if self.flexible is None:
            raise ValueError("the fit has no flexible discrepancy")
        return self.flexible.posterior(self.at_zero, self.jacobian)

    @cached_property
    def evidence(self) -> float:
        """Log marginal likelihood (Laplace) of a right model, up to a constant common to all models."""
        if self.flexible is not None:
            return self.posterior.right
        return self.evidence_without_error

    @property
    def evidence_without_error(self) -> float:
        """Log marginal likelihood (Laplace) of a model that has no error of its own."""
        return -0.5 * self.objective - 0.5 * float(np.linalg.slogdet(self.precision)[1])

    @property
    def projection(self) -> Callable[[np.ndarray], np.ndarray]:
        """The map v → P v of vectors (N,) or (N, k): their part that recalibration within the prior cannot explain."""
        factor = cho_factor(self.precision)
        return lambda vectors: vectors - self.jacobian @ cho_solve(factor, self.jacobian.T @ vectors)

    @property
    def score(self) -> np.ndarray:
        """P e0, with covariance P under the model: at the maximum it equals the whitened residual."""
        return self.projection(self.at_zero)


Label = TypeVar("Label")
"""Label that `evaluate` needs to identify a model, e.g. its hypothesis."""


@dataclass
class Search(Generic[Label]):
    """State of one maximisation: point, sensitivities, and which of them to recompute.

    fresh: columns of z whose sensitivities are recomputed; renewed: z at which this was last done (None: to be done at
    the start); stale: whether it is due now; exact: columns whose sensitivities are constant, and these (N, k);
    central: use central differences, with twice the runs and without the error due to curvature. flexible: see `Fit`.
    """

    label: Label
    z: np.ndarray
    fresh: list[int]
    jacobian: np.ndarray | None = None
    residual: np.ndarray = field(default_factory=lambda: np.zeros(0))
    renewed: np.ndarray | None = None
    stale: bool = True
    failed: bool = False
    done: bool = False
    exact: tuple[list[int], np.ndarray] | None = None
    central: bool = False
    flexible: Flexible | None = None

    @property
    def sides(self) -> tuple[float, ...]:
        return (1.0, -1.0) if self.central else (1.0,)

    @property
    def fit(self) -> Fit:
        whole = len({*self.fresh, *self.linear}) == len(self.z)
        return Fit(self.z, self.residual, self.slopes, self.renewed if whole else None, self.flexible)

    @property
    def slopes(self) -> np.ndarray:
        """The sensitivities (N, p); zero until they are first computed."""
        return np.zeros((self.residual.size, len(self.z))) if self.jacobian is None else self.jacobian

    @property
    def linear(self) -> list[int]:
        """Columns in which the residual is linear, whatever the others are."""
        return [] if self.exact is None else self.exact[0]

    @cached_property
    def _linear_precision(self) -> tuple:
        columns, values = self.exact or ([], np.zeros((self.residual.size, 0)))
        return cho_factor(np.eye(len(columns)) + values.T @ values)

    def settled(self, z: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a point and its residual with the linear parameters at their optimum given the others."""
        if self.exact is None or not self.linear or not np.isfinite(residual).all():
            return z, residual
        columns, values = self.exact
        # A row of a larger array may be strided, and its products are then rounded differently than those of a single
        # row.
        residual = np.ascontiguousarray(residual)
        step = cho_solve(self._linear_precision, values.T @ residual - z[columns])
        z = z.copy()
        z[columns] += step
        return z, residual - values @ step

    @property
    def others(self) -> np.ndarray:
        return np.setdiff1d(np.arange(len(self.z)), np.array(self.linear, dtype=int))

    @property
    def moved(self) -> np.ndarray:
        """Distance from the point where sensitivities were recomputed; they do not depend on the linear parameters."""
        return (self.z - (self.z if self.renewed is None else self.renewed))[self.others]


Evaluate = Callable[[list[tuple[np.ndarray, Label]]], np.ndarray]
"""Rows (z, label) → whitened residuals (n, N), NaN where a run failed."""


LENGTHS = (1.0, 0.4, 0.1)
"""Fractions of the Gauss-Newton step that are tried in parallel."""
GOOD_STEP = 0.7
"""Fraction of the predicted gain above which the sensitivities are reused in the next step."""
FARTHEST = 3.0
"""Step of any parameter, in prior standard deviations, beyond which the linear model is not trusted."""
MOVED = 0.3
"""Distance, in prior standard deviations, up to which sensitivities are used without being recomputed."""
TOLERANCE = 0.02
"""Gain of the objective below which a fit ends: 0.01 nats of log evidence."""
SHARE = 1e-3
"""Gain as a fraction of the objective below which a fit also ends: far from the data many steps gain little."""


def maximise(
    evaluate: Evaluate[Label],
    searches: list[Search[Label]],
    iterations: int,
    tolerance: float = TOLERANCE,
    share: float = SHARE,
) -> list[Search[Label]]:
    """Maximise by Gauss-Newton with a step search, all searches in lockstep so that their runs share batches.

    Linear parameters are at their optimum at every point that is tried (variable projection; Golub & Pereyra 1973).
    Sensitivities in `fresh` are recomputed if a step gains less than predicted, or ends `FARTHEST` from the point where
    they were last computed; the others start as given; all are updated by the steps taken.

    Parameters
    ----------
    evaluate
        Rows (z, label) → whitened residuals (n, N), NaN where a run failed.
    searches
        Starting points, or searches that ended after too few iterations and go on; changed in place.
    iterations
        Maximum number of steps.
    tolerance, share
        A search ends when its objective falls by less than `tolerance`, or by less than the fraction `share`, with
        sensitivities that were recomputed nearby.

    Returns
    -------
    list of Search
        The searches, `failed` where the model did not run at the start.
    """
    if not searches:
        return []
    for search, residual in zip(searches, evaluate([(s.z, s.label) for s in searches]), strict=True):
        if not search.residual.size:  # not a search that goes on
            search.stale = search.renewed is None
        search.z, search.residual = search.settled(search.z, residual)
        search.failed = not np.isfinite(residual).all()
        search.done = search.failed
    for _ in range(iterations):
        active = [search for search in searches if not search.done]
        if not active:
            break
        _differentiate(evaluate, [search for search in active if search.stale])
        steps = [_step(search) for search in active]
        trials = [[search.z + length * step for length in LENGTHS] for search, step in zip(active, steps, strict=True)]
        values = evaluate([(z, search.label) for search, tried in zip(active, trials, strict=True) for z in tried])
        for search, tried, own in zip(active, trials, np.split(values, len(active)), strict=True):
            _advance(search, tried, own, tolerance, share)
    return searches


def _differentiate(evaluate: Evaluate[Label], stale: list[Search[Label]]) -> None:
    rows: list[tuple[np.ndarray, Label]] = []
    for search in stale:
        for column in search.fresh:
            for side in search.sides:
                moved = search.z.copy()
                moved[column] += side * STEP
                rows.append((moved, search.label))
    residuals = iter(evaluate(rows) if rows else ())
    for search in stale:
        search.jacobian = jacobian = search.slopes
        for column in search.fresh:
            slopes = [-side * (next(residuals) - search.residual) / STEP for side in search.sides]
            known = [slope for slope in slopes if np.isfinite(slope).all()]
            if known:
                jacobian[:, column] = sum(known) / len(known)
        if search.exact is not None:
            columns, values = search.exact
            jacobian[:, columns] = values
        search.renewed, search.stale = search.z, False


def _step(search: Search) -> np.ndarray:
    """Return the Gauss-Newton step, shortened beyond `FARTHEST`; the linear parameters follow the rest in full."""
    hessian = np.eye(len(search.z)) + search.slopes.T @ search.slopes
    gradient = search.slopes.T @ search.residual - search.z
    step = np.linalg.solve(hessian, gradient)
    linear, others = np.array(search.linear, dtype=int), search.others
    largest = np.abs(step[others]).max(initial=0.0)
    if largest > FARTHEST:
        step[others] *= FARTHEST / largest
        left = gradient[linear] - hessian[np.ix_(linear, others)] @ step[others]
        step[linear] = np.linalg.solve(hessian[np.ix_(linear, linear)], left)
    return step


def _update(search: Search, step: np.ndarray, change: np.ndarray) -> None:
    """Update the sensitivities by a step's result (Broyden).

    Steps shorter than the finite differences are not used, because they would show the tolerance of the runs.
    Sensitivities to linear parameters are not updated.
    """
    moved = np.zeros(len(step))
    moved[search.others] = step[search.others]
    if np.linalg.norm(moved) >= STEP:
        missing = change - search.slopes @ step
        search.jacobian = search.slopes + np.outer(missing, moved / (moved @ moved))


def _promised(search: Search, z: np.ndarray) -> float:
    """Return the decrease of the objective on the way to z if the model is linear."""
    step = z - search.z
    residual = search.residual - search.slopes @ step
    return search.fit.objective - float(residual @ residual + z @ z)


def _advance(search: Search, trials: list[np.ndarray], values: np.ndarray, tolerance: float, share: float) -> None:
    present = search.fit.objective
    tried = [search.settled(z, residual) for z, residual in zip(trials, values, strict=True)]
    objectives = [r @ r + z @ z if np.isfinite(r).all() else np.inf for z, r in tried]
    best = int(np.argmin(objectives))
    gained = present - objectives[best]
    search.stale = gained < GOOD_STEP * _promised(search, trials[0])
    if gained > 0:
        z, residual = tried[best]
        _update(search, z - search.z, search.residual - residual)
        search.z, search.residual = z, residual
        search.stale |= float(np.abs(search.moved).max(initial=0.0)) > (1.0 - 1e-9) * FARTHEST
    if gained < max(tolerance, share * present):
        search.done, search.stale = float(np.linalg.norm(search.moved)) < MOVED, True
