"""Shapley effects and total indices of inputs that may depend on each other, each with an interval.

Shapley effects share out var Y. That of an input is what it adds to var(E[Y | θ_u]) when it joins the inputs u known so
far, averaged over all orders in which inputs may become known. Effects are never negative and add up to one whether
inputs depend on each other or not (Owen and Prieur 2017). The total index is E[var(Y | all other inputs)] / var Y; an
input that the others determine has none.

Both are those of the predictions. These are expanded in Hermite polynomials of the inputs' normal scores z under a
Gaussian copula: all polynomials of first and second degree, and those of a single input beyond. Then

    var(E[Y | z_u]) = b' Q b + 2 tr(A Q A Q) + Σ_p p! a_p' Q^(p) a_p,    Q = cov(E[z | z_u]),

for coefficients b of the first, A of the second and a_p of higher degrees, with the entries' powers Q^(p), because
Hermite polynomials of jointly normal variables have covariances that are powers of theirs. Nothing is sampled
conditionally. Nested sets u of one order have Q = L_u L_u' with the first columns of one Cholesky factor L.

Values and intervals are those of repeated draws: of the prediction's error from the control variates' posterior
covariance, so that what they miss counts, and of the propagation samples, resampled by segments (`dependence`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from math import factorial

import numpy as np
from numpy.polynomial import hermite_e, legendre
from scipy.special import ndtri
from scipy.stats import rankdata

from coronaryuq.core.jit import njit
from coronaryuq.core.seeds import generator
from coronaryuq.core.units import percent
from coronaryuq.estimation.estimators.design import NODES, WEIGHTS, Design
from coronaryuq.estimation.estimators.per_row import Predictions
from coronaryuq.estimation.results import Value
from coronaryuq.estimation.runs.table import Row

DEGREE = 4
"""Highest degree of the polynomials of a single input."""
SAMPLES = 10_000
"""Propagation samples through which the expansion is fitted at most."""
DRAWS, ORDERS = 100, 64
"""Draws of predictions and samples; orders of inputs, half of them the reverse of the other half."""
SEGMENTS = 200
"""Groups in which independent propagation samples are resampled."""
SAMPLES_PER_TERM = 3
"""Propagation samples per coefficient without which products of two inputs are left out."""
EXPLAINED = 0.95
"""Share of the predictions' variance that the expansion must explain."""
JITTER = 1e-9
CHOICES = 12
"""Distinct values up to which an input is a choice: its samples are spread over the scores that its values share."""


@dataclass(frozen=True)
class Effects:
    """Shapley effect and total index of each input or group of inputs."""

    shapley: dict[str, Value]
    total: dict[str, Value]


def effects(
    design: Design, row: Row, predictions: Predictions, level: float = 0.95,
    groups: Mapping[str, Sequence[str]] | None = None,
) -> Effects:  # fmt: skip
    """Return Shapley effects and total indices of the inputs that move.

    Parameters
    ----------
    design
        Folds and propagation blocks.
    row
        The quantity, to which the predictions belong.
    predictions
        Cross-fitted predictions of it.
    level
        Of the intervals.
    groups
        Name → inputs that count as one; inputs in no group stand for themselves.

    References
    ----------
    Owen and Prieur, "On Shapley value for measuring importance of dependent inputs", SIAM/ASA J. UQ 5, 2017.
    """
    index = np.concatenate([b.index for b in design.blocks])
    values = np.concatenate(_at_samples(design, predictions))
    theta = design.runs.theta_more[index]
    moving = np.flatnonzero(np.ptp(theta, axis=0) > 0)
    members = _members([design.runs.inputs[j] for j in moving], groups or {})
    scores = np.column_stack([_scores(theta[:, j], design.runs.inputs[j]) for j in moving])
    rng = generator(0, "estimation", "shapley", row.column_3d)
    some = np.linspace(0, len(index) - 1, min(SAMPLES, len(index))).round().astype(int)
    expansion = _Expansion.fit(scores[some], values[some])
    errors = _errors(design, row, predictions, scores, moving, expansion)
    more = design.dependence.more
    labels = np.arange(len(some)) % SEGMENTS if more is None else more.long[index[some]]
    resample = expansion.resampling(labels)
    orders = _orders(len(members), rng)
    found = []
    for draw in range(DRAWS):
        coefficients, correlation = resample(rng)
        error = errors[draw % len(errors)]
        coefficients = coefficients + error @ rng.normal(size=error.shape[1])
        found.append(_shares(expansion.terms(coefficients), correlation, list(members.values()), orders))
    warning = None
    if expansion.explained < EXPLAINED:
        warning = f"polynomials of the inputs explain {percent(expansion.explained)} of the variance of the predictions"
    shapley, total = np.array(found).transpose(1, 2, 0)
    return Effects(*(
        {name: _value(drawn, level, warning) for name, drawn in zip(members, of, strict=True)}
        for of in (shapley, total)
    ))  # fmt: skip


def _scores(values: np.ndarray, name: str) -> np.ndarray:
    """Return the normal scores (n,) of an input; equal values of a choice are ranked at random."""
    ranks = rankdata(values)
    if len(np.unique(values)) <= CHOICES:
        ties = generator(0, "estimation", "shapley", "ties", name).uniform(size=len(values))
        ranks[np.lexsort((ties, values))] = np.arange(1, len(values) + 1)
    return ndtri((ranks - 0.5) / len(values))


def _value(drawn: np.ndarray, level: float, warning: str | None) -> Value:
    value, std = float(drawn.mean()), float(drawn.std(ddof=1))
    half = float(ndtri((1 + level) / 2)) * std
    return Value(value, std, max(0.0, value - half), min(1.0, value + half), level, warning)


def _members(inputs: list[str], groups: Mapping[str, Sequence[str]]) -> dict[str, np.ndarray]:
    """Return the positions of the inputs of each group, and of each input in no group."""
    grouped = {name for of in groups.values() for name in of}
    members = {group: [inputs.index(name) for name in of if name in inputs] for group, of in groups.items()}
    members |= {name: [j] for j, name in enumerate(inputs) if name not in grouped}
    return {name: np.array(of) for name, of in members.items() if of}


@dataclass(frozen=True)
class _Terms:
    """Coefficients: first (d,); second (d, d), symmetric; higher (p, d) from the third degree on."""

    first: np.ndarray
    second: np.ndarray
    higher: np.ndarray

    def explained(self, q: np.ndarray) -> float:
        """Return var(E[Y | z_u]) for Q = cov(E[z | z_u]), q (d, d)."""
        product = self.second @ q
        found, power = self.first @ q @ self.first + 2 * np.sum(product * product.T), q * q
        for factors in self._of_powers:
            power = power * q  # a general power is most of the cost
            found = found + np.sum(factors * power)
        return float(found)

    def nested(self, columns: np.ndarray, ends: np.ndarray) -> np.ndarray:
        """Return var(E[Y | z_u]) (b, players) for the nested sets u of each order.

        columns (b, d, d): per order, those of a Cholesky factor, one a row. ends (b, players): the last column of each
        set.
        """
        return _nested(columns, ends, self.first, self.second, self._of_powers)

    @cached_property
    def _of_powers(self) -> np.ndarray:
        """Return p! a_p a_p' (p, d, d), the factors of the powers of Q from the third on."""
        factorials = np.array([factorial(p) for p in range(3, 3 + len(self.higher))], dtype=float)
        return factorials[:, None, None] * self.higher[:, :, None] * self.higher[:, None, :]


@njit(cache=True, fastmath={"reassoc"})
def _nested(columns, ends, first, second, of_powers):
    orders, d = columns.shape[:2]
    players, degrees = ends.shape[1], len(of_powers)
    explained = np.empty((orders, players))
    q, within, power = np.empty((d, d)), np.empty((d, d)), np.empty(d)
    for order in range(orders):
        q[:], linear, quadratic, player = 0.0, 0.0, 0.0, 0
        for k in range(d):
            column = columns[order, k]
            slope = 0.0
            for i in range(d):
                slope += first[i] * column[i]
                inner = 0.0
                for j in range(d):
                    inner += second[i, j] * column[j]
                within[k, i] = inner
                for j in range(i, d):
                    q[i, j] += column[i] * column[j]
            linear += slope * slope
            # The square of the norm of L_u' A L_u grows by its last row and column.
            for j in range(k + 1):
                inner = 0.0
                for i in range(d):
                    inner += columns[order, j, i] * within[k, i]
                quadratic += (1.0 if j == k else 2.0) * inner * inner
            if k < ends[order, player]:
                continue
            higher = 0.0
            for i in range(d):
                for j in range(i, d):
                    power[j] = q[i, j] * q[i, j]
                for p in range(degrees):
                    of_row = 0.0
                    for j in range(i, d):
                        power[j] *= q[i, j]
                        of_row += of_powers[p, i, j] * power[j]
                    # Q is symmetric: twice what is right of the diagonal.
                    higher += 2.0 * of_row - of_powers[p, i, i] * power[i]
            explained[order, player] = linear + 2.0 * quadratic + higher
            player += 1
    return explained


@dataclass(frozen=True)
class _Expansion:
    """Hermite expansion through values at scores (m, d): coefficients (f,), pseudo-inverse of the moments (f, f)."""

    scores: np.ndarray
    products: bool
    features: np.ndarray
    coefficients: np.ndarray
    inverse: np.ndarray
    residuals: np.ndarray
    explained: float

    @classmethod
    def fit(cls, scores: np.ndarray, values: np.ndarray) -> "_Expansion":
        d = scores.shape[1]
        products = len(scores) >= SAMPLES_PER_TERM * (1 + DEGREE * d + d * (d - 1) // 2)
        features = _features(scores, products)
        inverse = np.linalg.pinv(features.T @ features / len(features), rcond=1e-10, hermitian=True)
        coefficients = inverse @ (features.T @ values / len(values))
        residuals = values - features @ coefficients
        spread = values.var()
        explained = 1 - float(residuals.var() / spread) if spread > 0 else 1.0
        return cls(scores, products, features, coefficients, inverse, residuals, explained)

    def terms(self, coefficients: np.ndarray) -> _Terms:
        d = self.scores.shape[1]
        of_one = coefficients[1 : 1 + DEGREE * d].reshape(DEGREE, d)
        second = np.diag(of_one[1])
        if self.products:
            rows, columns = np.triu_indices(d, 1)
            second[rows, columns] = second[columns, rows] = coefficients[1 + DEGREE * d :] / 2
        return _Terms(of_one[0], second, of_one[2:])

    def resampling(self, labels: np.ndarray) -> Callable[[np.random.Generator], tuple[np.ndarray, np.ndarray]]:
        """Return a function that draws coefficients (f,) and a correlation (d, d) of samples resampled by label."""
        _, labels = np.unique(labels, return_inverse=True)
        order = np.argsort(labels, kind="stable")
        starts = np.flatnonzero(np.diff(labels[order], prepend=-1))
        m, d = self.scores.shape
        moved = np.add.reduceat((self.features * self.residuals[:, None])[order], starts) @ self.inverse / m
        squares = (self.scores[:, :, None] * self.scores[:, None, :]).reshape(m, d * d)
        squares = np.add.reduceat(squares[order], starts)

        def draw(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
            times = rng.multinomial(len(starts), np.full(len(starts), 1 / len(starts)))
            covariance = (times @ squares).reshape(d, d)
            scale = np.sqrt(np.diag(covariance))
            return self.coefficients + times @ moved, covariance / np.outer(scale, scale)

        return draw


def _features(scores: np.ndarray, products: bool) -> np.ndarray:
    """Constant, Hermite polynomials of single inputs by degree, products of two inputs: (m, f)."""
    hermite = np.moveaxis(hermite_e.hermevander(scores, DEGREE)[:, :, 1:], 2, 1).reshape(len(scores), -1)
    first, second = np.triu_indices(scores.shape[1], 1)
    both = scores[:, first] * scores[:, second] if products else np.empty((len(scores), 0))
    return np.column_stack([np.ones(len(scores)), hermite, both])


def _at_samples(design: Design, predictions: Predictions) -> list[np.ndarray]:
    """Return predictions (m_k,) at the propagation samples, interpolated from nodes to the sample's own value."""
    j = _integrated(design)
    if j is None:
        return predictions.raw
    low, high = design.runs.bounds(design.runs.inputs[j])
    norms = 2 * np.arange(len(NODES)) + 1
    to_coefficients = legendre.legvander(NODES, len(NODES) - 1) * norms * WEIGHTS[:, None] / 2
    found = []
    for block, values in zip(design.blocks, predictions.raw, strict=True):
        at = 2 * (design.runs.theta_more[block.index, j] - low) / (high - low) - 1
        coefficients = values.reshape(-1, len(NODES)) @ to_coefficients
        found.append(np.sum(coefficients * legendre.legvander(at, len(NODES) - 1), axis=1))
    return found


def _integrated(design: Design) -> int | None:
    block = design.blocks[0]
    if block.repeats == 1:
        return None
    return int(np.argmax(np.ptp(block.log_theta[: block.repeats], axis=0)))


def _errors(
    design: Design, row: Row, predictions: Predictions, scores: np.ndarray, moving: np.ndarray, expansion: _Expansion
) -> list[np.ndarray]:
    """Return per fold a root (f, s) of the covariance of the coefficients, as the control variate's posterior has it.

    scores (m, d): of the samples of all blocks, one block after the other.
    Samples of an integrated input are taken at one node each, in turn by the nodes' weights.
    """
    j, found = _integrated(design), []
    least = 2 * len(expansion.coefficients)
    of_blocks = np.split(scores, np.cumsum([len(b.index) for b in design.blocks])[:-1])
    for k, fitted in enumerate(predictions.fitted):
        block = design.blocks[k]
        places = np.linspace(0, len(block.index) - 1, min(least, len(block.index))).round().astype(int)
        z = of_blocks[k][places]
        if j is not None:
            edges = np.cumsum(WEIGHTS / 2)
            node = np.minimum(np.searchsorted(edges, (np.arange(len(places)) * 0.618034) % 1), len(NODES) - 1)
            z[:, np.flatnonzero(moving == j)[0]] = ndtri((NODES[node] + 1) / 2)
            places = places * block.repeats + node
        covariance = fitted.covariance(design.propagated(row, k)[places])
        values, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(values, 0))
        kept = values > 1e-8 * max(values[-1], 1e-300)
        found.append(np.linalg.pinv(_features(z, expansion.products), rcond=1e-3) @ root[:, kept])
    return found


def _orders(players: int, rng: np.random.Generator) -> np.ndarray:
    """Return orders (b, players): all of them where these are few."""
    if factorial(players) <= ORDERS:
        return np.array(list(permutations(range(players))))
    half = np.array([rng.permutation(players) for _ in range(ORDERS // 2)])
    return np.vstack([half, half[:, ::-1]])


def _shares(terms: _Terms, correlation: np.ndarray, members: list[np.ndarray], orders: np.ndarray) -> np.ndarray:
    """Return Shapley effects and total indices (2, players)."""
    correlation = (correlation + JITTER * np.eye(len(correlation))) / (1 + JITTER)
    whole = terms.explained(correlation)
    if whole <= 0:
        return np.zeros((2, len(members)))
    inputs = np.array([np.concatenate([members[p] for p in order]) for order in orders])
    permuted = correlation[inputs[:, :, None], inputs[:, None, :]]
    factor = np.take_along_axis(np.linalg.cholesky(permuted), np.argsort(inputs, axis=1)[:, :, None], axis=1)
    columns = np.ascontiguousarray(factor.swapaxes(1, 2))
    ends = np.cumsum([[len(members[p]) for p in order] for order in orders], axis=1) - 1
    explained = terms.nested(columns, ends)
    gains = np.diff(explained, axis=1, prepend=0.0)
    shapley = np.zeros(len(members))
    np.add.at(shapley, orders, gains / len(orders))
    total = []
    for of in members:
        rest = np.setdiff1d(np.arange(len(correlation)), of)
        known = correlation[:, rest] @ np.linalg.solve(correlation[np.ix_(rest, rest)], correlation[rest])
        total.append(whole - terms.explained(known))
    return np.array([shapley / whole, np.array(total) / whole])
