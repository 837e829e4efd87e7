"""Control variates: functions of θ and of 0D outputs that predict a 3D quantity, fitted on a pilot."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from coronaryuq.estimation.surrogates import gaussian_process


@dataclass(frozen=True)
class Seen:
    """Predictors at m samples: log θ (m, d), a row's 0D output (m,), more of them (m, p).

    coarse (m,): the quantity itself on a coarse 3D level, or None.
    """

    log_theta: np.ndarray
    row_output: np.ndarray
    outputs: np.ndarray
    coarse: np.ndarray | None = None

    def __getitem__(self, index) -> "Seen":
        coarse = None if self.coarse is None else self.coarse[index]
        return Seen(self.log_theta[index], self.row_output[index], self.outputs[index], coarse)

    def __len__(self) -> int:
        return len(self.log_theta)

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.log_theta, self.row_output, self.outputs

    @property
    def coarse_run(self) -> np.ndarray:
        """The coarse level (m,), for a method that needs it."""
        if self.coarse is None:
            raise ValueError("no coarse level among the predictors")
        return self.coarse

    @property
    def everything(self) -> np.ndarray:
        coarse = [] if self.coarse is None else [self.coarse]
        return np.column_stack([self.log_theta, self.outputs, *coarse])


@dataclass(frozen=True)
class Fitted:
    """A control variate fitted on n training runs.

    predict(seen) (m,): the control variate. leave_one_out (n,): residual of each training run when it is left out, by
    which methods are compared within a training set. influence(seen) (m, n): change of each prediction by each training
    run. variance(seen) (m,): expected squared error. covariance(seen) (m, m): of the errors of the predictions; its
    diagonal is that variance less the variance of noise.
    """

    method: str
    predict: Callable[[Seen], np.ndarray]
    leave_one_out: np.ndarray
    influence: Callable[[Seen], np.ndarray]
    variance: Callable[[Seen], np.ndarray]
    covariance: Callable[[Seen], np.ndarray]

    @property
    def missed(self) -> float:
        """Mean square of the leave-one-out residuals."""
        return float(np.mean(self.leave_one_out**2))


Method = Callable[[Seen, np.ndarray], Fitted]

# Runs for one power of the mean squares in the weights of two rivals.
RUNS_PER_POWER = 22.5


def constant(seen: Seen, y: np.ndarray) -> Fitted:
    """No control variate: plain Monte Carlo."""
    missed = (y - y.mean()) * len(y) / (len(y) - 1)
    return Fitted(
        "constant", lambda new: np.full(len(new), y.mean()), missed,
        lambda new: np.tile(missed / len(y), (len(new), 1)),
        lambda new: np.full(len(new), np.mean(missed**2)),
        lambda new: np.full((len(new), len(new)), np.mean(missed**2) / len(y)),
    )  # fmt: skip


def linear(name: str, columns: Callable[[Seen], np.ndarray]) -> Method:
    """Least squares on columns (m, p) of what is seen. With the row's 0D output alone this is MFMC."""

    def fit(seen: Seen, y: np.ndarray) -> Fitted:
        design, back = _standardised(columns(seen))
        u, s, vt = np.linalg.svd(design, full_matrices=False)
        kept = s > 1e-7 * s[0]
        u, inverse = u[:, kept], (vt[kept].T / s[kept])
        coefficients = inverse @ (u.T @ y)
        hat = np.minimum((u**2).sum(axis=1), 1 - 1e-9)
        missed = (y - u @ (u.T @ y)) / (1 - hat)

        def covariance(new: Seen) -> np.ndarray:
            root = back(columns(new)) @ inverse
            return np.mean(missed**2) * root @ root.T

        return Fitted(
            name, lambda new: back(columns(new)) @ coefficients, missed,
            lambda new: back(columns(new)) @ inverse @ u.T * missed,
            lambda new: np.mean(missed**2) * (1 + ((back(columns(new)) @ inverse) ** 2).sum(axis=1)), covariance,
        )  # fmt: skip

    return fit


def gp_on(name: str, columns: Callable[[Seen], np.ndarray], directions: int = 0, evaluations: int = 60) -> Method:
    """Gaussian process on columns (m, p) of what is seen."""

    def fit(seen: Seen, y: np.ndarray) -> Fitted:
        model = gaussian_process.fit(columns(seen), y, directions, evaluations)
        return Fitted(
            name, lambda new: model.predict(columns(new)), model.leave_one_out,
            lambda new: model.influence(columns(new)), lambda new: model.variance(columns(new)),
            lambda new: model.covariance(columns(new)),
        )  # fmt: skip

    return fit


def gp_of_logarithm(name: str, columns: Callable[[Seen], np.ndarray], evaluations: int = 60) -> Method:
    """Gaussian process of log y > 0: FFR, shear and flows are closer to products of the inputs' powers than to sums.

    The prediction is the median of y, its variance that of a log-normal. Logarithms beyond the runs' by more than their
    range are clipped there: an exponential turns a bad extrapolation into an absurd one.
    """

    def fit(seen: Seen, y: np.ndarray) -> Fitted:
        z = np.log(y)
        model = gaussian_process.fit(columns(seen), z, evaluations=evaluations)
        low, high = z.min() - np.ptp(z), z.max() + np.ptp(z)

        def logarithm(new: Seen) -> np.ndarray:
            return np.clip(model.predict(columns(new)), low, high)

        def influence(new: Seen) -> np.ndarray:
            here = logarithm(new)[:, None]
            return np.exp(here) - np.exp(np.clip(here - model.influence(columns(new)), low, high))

        def variance(new: Seen) -> np.ndarray:
            return np.exp(2 * logarithm(new)) * np.expm1(np.minimum(model.variance(columns(new)), (high - low) ** 2))

        def covariance(new: Seen) -> np.ndarray:
            here = np.exp(logarithm(new))
            return here[:, None] * here * np.expm1(np.minimum(model.covariance(columns(new)), (high - low) ** 2))

        missed = y - np.exp(np.clip(z - model.leave_one_out, low, high))
        return Fitted(name, lambda new: np.exp(logarithm(new)), missed, influence, variance, covariance)

    return fit


def with_rival(taken: Fitted, rival: Fitted, most: float) -> Fitted:
    """Return `taken` with a variance that grows where a control variate that is nearly as good differs from it.

    Both fit the runs and differ where there are none, which neither's own posterior variance shows: the variance grows
    by that of a mixture of both. Weights are powers of their mean square leave-one-out residuals; the power rises with
    the number of runs, as in a likelihood, but slowly, because it matters most where there is no run. most: larger
    differences count as this one; the range of the runs' y, because an exponential may take any value in a corner
    without runs.
    """
    less, more = sorted((taken.missed, rival.missed))
    odds = (less / more) ** (len(taken.leave_one_out) / RUNS_PER_POWER) if more > 0 else 0.0
    share = odds / (1 + odds) ** 2

    def apart(new: Seen) -> np.ndarray:
        return np.clip(taken.predict(new) - rival.predict(new), -most, most)

    return replace(
        taken,
        variance=lambda new: taken.variance(new) + share * apart(new) ** 2,
        covariance=lambda new: taken.covariance(new) + share * np.outer(apart(new), apart(new)),
    )


def quadratic(columns: np.ndarray) -> np.ndarray:
    """Columns (m, p) with their squares and products, (m, p + p (p + 1) / 2)."""
    first, second = np.triu_indices(columns.shape[1])
    return np.column_stack([columns, columns[:, first] * columns[:, second]])


def _standardised(columns: np.ndarray):
    shift, scale = columns.mean(axis=0), columns.std(axis=0)
    scale = np.where(scale > 1e-12 * (np.abs(shift) + 1e-300), scale, np.inf)

    def back(new: np.ndarray) -> np.ndarray:
        return np.column_stack([np.ones(len(new)), (new - shift) / scale])

    return back(columns), back


METHODS: dict[str, Method] = {
    "constant": constant,
    "linear 0D": linear("linear 0D", lambda s: s.row_output[:, None]),
    "linear 0D outputs": linear("linear 0D outputs", lambda s: s.outputs),
    "linear coarse": linear("linear coarse", lambda s: s.coarse_run[:, None]),
    "linear coarse and 0D": linear("linear coarse and 0D", lambda s: np.column_stack([s.coarse_run, s.row_output])),
    "linear theta": linear("linear theta", lambda s: s.log_theta),
    "quadratic 0D outputs": linear("quadratic 0D outputs", lambda s: quadratic(s.outputs[:, :5])),
    "GP(θ)": gp_on("GP(θ)", lambda s: s.log_theta),
    "GP(θ, 0D)": gp_on("GP(θ, 0D)", lambda s: s.everything),
    "GP of log y": gp_of_logarithm("GP of log y", lambda s: s.everything),
    "GP with active direction": gp_on(
        "GP with active direction", lambda s: s.everything, directions=1, evaluations=120
    ),
}
