"""First-order Sobol indices, each with an interval.

With h(θ_j) an estimate of the effect E[Y | θ_j] − E[Y], the variance of the effect is

    E[2 (Y − E[Y]) h − h²] + E[(effect − h)²]

h is a polynomial of log θ_j through the predictions, or their mean at the nodes of an input that is integrated. The
first expectation is a cross-fitted mean. The second is what the predictions miss of the effect. Small effects suffer
most, because a fit takes them for none: without it their indices are too small. With polynomials φ_p that are
orthonormal under the law of θ_j, it is the sum of the squares of d_p = E[(Y − prediction) φ_p]. The square of an
estimate of d_p exceeds d_p² by the variance of that estimate, which is subtracted.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from coronaryuq.estimation.estimators.crossfit import (
    CrossFit,
    Estimate,
    Options,
    Propagated,
    combine,
    propagation_variance,
)
from coronaryuq.estimation.estimators.design import NODES, WEIGHTS, Design
from coronaryuq.estimation.estimators.per_row import Predictions
from coronaryuq.estimation.results import Value

# Degree of the polynomial that represents the effect of one input, and of what the predictions may miss of it: each
# degree of this adds the variance of a coefficient, and polynomials of a high degree give single runs a large weight.
DEGREE, MISSED_DEGREE = 7, 4


def sobol(design: Design, y: np.ndarray, predictions: Predictions, level: float = 0.95) -> dict[str, Value]:
    """Return the first-order index var(E[Y | θ_j]) / var Y of every input that moves. As `tails.probability`.

    The variance is that of the ratio's linearisation, with the second-order term of the squares; the interval allows
    for its change with the index. Inputs depend on each other where the total resistance is preserved: an index then
    counts what an input shares with others.
    """
    theta = design.runs.theta_more[np.concatenate([b.index for b in design.blocks])]
    centre = predictions.centre(design, y)
    found = {}
    for j, name in enumerate(design.runs.inputs):
        if np.ptp(theta[:, j]) == 0:
            continue
        effect = _at_nodes(design, predictions, j) if _is_integrated(design, j) else _along(design, predictions, j)
        found[name] = _Index(design, y, predictions, effect, centre, level).value()
    return found


@dataclass(frozen=True)
class _Effect:
    """h as coefficients (D,) of polynomials of mean zero, orthonormal under the law of the input.

    held: polynomials (n, D) at the pilot runs. raw: per fold (m_k · s, D) at the places of `Predictions.raw`. noise:
    what the sampling error of h adds to its mean square.
    """

    coefficients: np.ndarray
    held: np.ndarray
    raw: list[np.ndarray]
    noise: float


def _along(design: Design, predictions: Predictions, j: int) -> _Effect:
    average = np.concatenate([b.average(v) for b, v in zip(design.blocks, predictions.raw, strict=True)])
    x = [b.log_theta[:: b.repeats, j] for b in design.blocks]
    at = np.concatenate(x)
    low, high = at.min(), at.max()
    degree = min(DEGREE, len(np.unique(at)) - 1)

    def powers(x: np.ndarray) -> np.ndarray:
        return legendre.legvander(2 * (np.clip(x, low, high) - low) / (high - low) - 1, degree)

    _, r = np.linalg.qr(powers(at))
    to_orthonormal = np.linalg.inv(r)[:, 1:] * np.sqrt(len(at))
    polynomials = powers(at) @ to_orthonormal
    coefficients = polynomials.T @ (average - average.mean()) / len(at)
    noise = float(np.mean((average - average.mean() - polynomials @ coefficients) ** 2)) * degree / len(at)
    raw = [np.repeat(powers(own) @ to_orthonormal, b.repeats, axis=0) for own, b in zip(x, design.blocks, strict=True)]
    return _Effect(coefficients, powers(design.log_theta[:, j]) @ to_orthonormal, raw, noise)


def _at_nodes(design: Design, predictions: Predictions, j: int) -> _Effect:
    def polynomials(x: np.ndarray) -> np.ndarray:
        degrees = np.arange(1, len(NODES))
        return legendre.legvander(x, len(NODES) - 1)[:, 1:] * np.sqrt(2 * degrees + 1)

    at = np.concatenate([v.reshape(-1, len(NODES)) for v in predictions.raw]).mean(axis=0)
    low, high = design.runs.bounds(design.runs.inputs[j])
    held = polynomials(np.clip(2 * (design.runs.theta[:, j] - low) / (high - low) - 1, -1, 1))
    raw = [np.tile(polynomials(NODES), (len(b.index), 1)) for b in design.blocks]
    return _Effect(polynomials(NODES).T @ (WEIGHTS / 2 * at), held, raw, 0.0)


Function = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Of the quantity (or its prediction) and of an effect at the same samples."""


@dataclass(frozen=True)
class _Index:
    """What the index of one input is estimated from; centre: the mean of y."""

    design: Design
    y: np.ndarray
    predictions: Predictions
    effect: _Effect
    centre: float
    level: float

    def value(self) -> Value:
        c = self.centre
        missed, variances = self._missed()
        h = self.effect.coefficients
        total = self._mean(h, lambda v, _: (v - c) ** 2, lambda v, _: 2 * (v - c)).mean
        if total <= 0:
            return Value(0.0, 1.0, 0.0, 1.0, self.level)
        explained = self._mean(h, lambda v, h: 2 * (v - c) * h - h**2, lambda v, h: 2 * h).mean - self.effect.noise
        index = (explained + float(np.sum(missed**2 - variances))) / total
        near = min(max(index, 0.0), 1.0)
        ratio = self._mean(
            h + missed,
            lambda v, h: (2 * (v - c) * h - h**2 - near * (v - c) ** 2) / total,
            lambda v, h: 2 * (h - near * (v - c)) / total,
        )
        # An estimate d + e of d has Var((d + e)²) = 4 d² s² + 2 s⁴; the linearisation has 4 (d + e)² s², on average
        # 4 d² s² + 4 s⁴.
        second = float(2 * np.sum(variances**2)) / total**2
        std = max(ratio.std**2 - second, second) ** 0.5
        quantile = ratio.interval.half_width / ratio.std if ratio.std > 0 else 0.0
        # The variance 4 s² V (1 − V) grows with a small index V. As in Wilson's interval, the ends are where the index
        # would have to be for its estimate to lie that many standard deviations away.
        per_coefficient = float(np.mean(variances[:MISSED_DEGREE])) + self._propagation_variance()
        curved = quantile**2 * 2 * per_coefficient / total * (1 - 2 * near)
        half = (quantile**2 * std**2 + curved**2) ** 0.5
        low, high = max(0.0, index + curved - half), min(1.0, index + curved + half)
        return Value(near, std, min(near, low), max(near, high), self.level)

    def _missed(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the coefficients d_p of what the predictions miss of the effect, with zeros, and their variances."""
        found = np.zeros((2, len(self.effect.coefficients)))
        nothing = [Propagated(np.zeros(1), segments=self.design.segments(b.index[:1])) for b in self.design.blocks]
        y, held, fold = self.y - self.centre, self.predictions.held - self.centre, self.design.fold
        for p in range(min(MISSED_DEGREE, found.shape[1])):
            polynomial = self.effect.held[:, p]
            between = self.predictions.between(polynomial, [raw[:, p] for raw in self.effect.raw])
            fit = CrossFit(y * polynomial, held * polynomial, nothing, fold, self.design.dependence)
            estimate = combine("", fit, len(y), Options(beta=1.0, between=between))
            found[:, p] = estimate.mean, estimate.std**2
        return found[0], found[1]

    def _propagation_variance(self) -> float:
        """Return the variance that propagation adds to the mean of y, and about that to each coefficient."""
        if self.design.target:
            return 0.0
        share = np.bincount(self.design.fold) / len(self.y)
        return propagation_variance(self.design.propagate(self.predictions.raw), share)

    def _mean(self, coefficients: np.ndarray, function: Function, slope: Function) -> Estimate:
        """Return the cross-fitted mean of a function of y and of the effect with these coefficients."""
        design, held = self.design, self.effect.held @ coefficients
        raw = [(v, at @ coefficients) for v, at in zip(self.predictions.raw, self.effect.raw, strict=True)]
        between = self.predictions.between(slope(self.predictions.held, held), [slope(v, h) for v, h in raw])
        blocks = design.propagate([function(v, h) for v, h in raw])
        # One beta for numerator and denominator: where they share a beta, they share most of their error.
        fit = CrossFit(
            function(self.y, held), function(self.predictions.held, held), blocks, design.fold, design.dependence
        )
        return combine("", fit, len(self.y), Options(self.level, beta=1.0, between=between))


def _is_integrated(design: Design, j: int) -> bool:
    if design.blocks[0].repeats == 1:
        return False
    first = design.blocks[0].log_theta[: design.blocks[0].repeats]
    return bool(np.ptp(first[:, j]) > 0)
