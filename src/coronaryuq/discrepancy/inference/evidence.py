"""Evidence of data: of a model that is right within its own error, and of the model with something else missing.

Two things are not known in it, and are averaged over: the noise of the waveforms, of which the scatter leaves several
plausible, and where something else shows. It may be of one amplitude, as a fraction of each series' size, in all data,
or in one quantity alone, as a flow that is diverted hardly changes pressures, or at one place alone, as an error of a
probe; the three are equally likely. The last two are of waveforms and pullbacks: in single values alone, something else
cannot be distinguished from a larger error.

Blocks of data, one per measured place and quantity, have independent errors given the parameters of the model. So every
block contributes a matrix of inner products under each noise and amplitude, and every combination is a sum of these.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_softmax, logsumexp

from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES, RIGHT, UNKNOWN

if TYPE_CHECKING:
    from coronaryuq.discrepancy.inference.problem import Problem


@dataclass(frozen=True, eq=False)
class PossibleNoise:
    """Noise of the waveforms of one quantity, beside the one that a problem has.

    Attributes
    ----------
    log_prior
        Up to a constant that all noises of the quantity share.
    variance
        Of its independent part less that of the problem's own noise: (N,), CGS.
    shapes
        Of its correlated part, each within one waveform, with standard normal weights: (k, N), CGS.
    """

    log_prior: float
    variance: np.ndarray
    shapes: np.ndarray


class Data:
    """Some rows of a problem's data under each noise and amplitude, shared by all its models.

    Parameters
    ----------
    problem
        With `noises`.
    features
        Of the flexible discrepancy, see `gp_discrepancy.features`: (N, k).
    chosen
        Rows, M of them: (N,), bool.
    """

    def __init__(self, problem: "Problem", features: np.ndarray, chosen: np.ndarray):
        series, forward = problem.forward.measured, problem.forward
        blocks = np.where(chosen, gp_discrepancy.blocks(problem), -1)
        place = np.cumsum(chosen) - 1
        stated = PossibleNoise(0.0, np.zeros(len(problem.y)), forward.noise_shapes)
        self.names = list(dict.fromkeys(one.quantity for one in series))
        noises = {name: problem.noises.get(name, (stated,)) for name in self.names}
        axes = np.ix_(*(log_softmax([one.log_prior for one in noises[name]]) for name in self.names))
        self.log_priors = np.asarray(sum(axes))
        """Of every combination of the quantities' noises."""
        self.others = [k for k, nuisance in enumerate(forward.nuisances) if nuisance.noise]
        """Columns of a model's sensitivities that are weights of the problem's own noise."""
        self.blocks = []
        where: list[dict[tuple[str, str], list[int]]] = [{}, {}, {}]
        for order, number in enumerate(np.unique(blocks[chosen])):
            rows = np.flatnonzero(blocks == number)
            own = [series[owner] for owner in np.unique(problem.owner[rows])]
            name, location = own[0].quantity, own[0].location
            seen = [_Seen.under(noise, rows, problem.sd[rows], features[rows]) for noise in noises[name]]
            self.blocks.append((name, place[rows], seen))
            several = any(one.value.size > 1 for one in own)
            for form, shows in zip(where, [("", "")] + [(name, ""), (name, location)] * several, strict=False):
                form.setdefault(shows, []).append(order)
        self.where = [form for form in where if form]
        """Blocks in which something else may be, by quantity and place: all, those of one quantity, or one."""

    def evidence(self, at_zero: np.ndarray, jacobian: np.ndarray, lacking: float = 0.0) -> "Evidence":
        """Weigh a linear model.

        Parameters
        ----------
        at_zero, jacobian
            Residual (M,) at z = 0 and sensitivities (M, p), whitened by the problem's own noise.
        lacking
            Nats by which the evidence is lower than that of the linear model.

        Returns
        -------
        Evidence
            Of the model, right or with something else.
        """
        vectors = np.column_stack([np.delete(jacobian, self.others, axis=1), at_zero])
        products = [np.array([one.products(vectors[rows]) for one in seen]) for _, rows, seen in self.blocks]
        determinants = [np.array([one.log_determinants for one in seen]) for *_, seen in self.blocks]
        return Evidence(self, products, determinants, lacking)


@dataclass(frozen=True, eq=False)
class _Seen:
    """One block under one noise.

    whitening: of its vectors (n, n); directions: of the discrepancy in it (n, k); explained: fraction of the variance
    along each that is the discrepancy's, by amplitude (T, k); log_determinants: of its covariance (T,).
    """

    whitening: np.ndarray
    directions: np.ndarray
    explained: np.ndarray
    log_determinants: np.ndarray

    @classmethod
    def under(cls, noise: PossibleNoise, rows: np.ndarray, sd: np.ndarray, features: np.ndarray) -> "_Seen":
        shapes = noise.shapes[:, rows] / sd
        factor = np.linalg.cholesky(np.diag(1.0 + noise.variance[rows] / sd**2) + shapes.T @ shapes)
        whitening = solve_triangular(factor, np.eye(len(rows)), lower=True)
        whitened = whitening @ features
        squares, directions = np.linalg.eigh(whitened @ whitened.T)
        kept = squares > 1e-9 * max(float(squares[-1]), 1e-300)
        spread = np.multiply.outer(AMPLITUDES**2, squares[kept])
        determinants = 2.0 * np.log(np.diag(factor)).sum() + np.log1p(spread).sum(axis=1)
        return cls(whitening, directions[:, kept], spread / (1.0 + spread), determinants)

    def products(self, vectors: np.ndarray) -> np.ndarray:
        """Return the inner products of vectors (n, m) with respect to the covariance of each amplitude: (T, m, m)."""
        whitened = self.whitening @ vectors
        parts = self.directions.T @ whitened
        return whitened.T @ whitened - np.array([(parts.T * share) @ parts for share in self.explained])


class Evidence:
    """Log evidence of data for one model, averaged over the noises, up to the constant of `gauss_newton`.

    Parameters
    ----------
    data
        The data.
    products, determinants
        Of each block: inner products (noises, T, m, m) of sensitivities and, last, residual, and log determinants
        (noises, T) of the covariance.
    lacking
        See `Data.evidence`.
    """

    def __init__(self, data: Data, products: list[np.ndarray], determinants: list[np.ndarray], lacking: float):
        self._data, self._products, self._determinants, self._lacking = data, products, determinants, lacking

    @cached_property
    def right(self) -> float:
        """Of the model as right, within its own error."""
        return float(logsumexp(self._right))

    @cached_property
    def _right(self) -> np.ndarray:
        """The same under every combination of the quantities' noises, with its prior."""
        return self._by_noise(range(len(self._products)), RIGHT)

    @property
    def noises(self) -> dict[str, int]:
        """Number of the most probable noise of each quantity, if the model is right."""
        axes = range(self._right.ndim)
        by_quantity = [logsumexp(self._right, axis=tuple(k for k in axes if k != own)) for own in axes]
        return {name: int(np.argmax(own)) for name, own in zip(self._data.names, by_quantity, strict=True)}

    @property
    def unknown(self) -> float:
        """Of the model together with something else."""
        return float(logsumexp(list(self.shown.values())))

    @cached_property
    def shown(self) -> dict[tuple[str, str], float]:
        """Of the model together with something else that shows in this quantity at this place, times its prior."""
        forms = self._data.where
        return {
            where: float(logsumexp(self._by_noise(numbers, UNKNOWN))) - np.log(len(forms) * len(form))
            for form in forms
            for where, numbers in form.items()
        }

    def _by_noise(self, numbers: Sequence[int], prior: np.ndarray) -> np.ndarray:
        """Return the evidence with an amplitude in some blocks, none in the others, of every combination of noises.

        prior: log prior of amplitudes (T,).
        """
        possible = np.flatnonzero(np.isfinite(prior))
        changes = [
            self._summed(numbers, [parts[number][:, possible] - parts[number][:, :1] for number in numbers])
            for parts in (self._products, self._determinants)
        ]
        evidence = _log_evidence(*(none + change for none, change in zip(self._undisturbed, changes, strict=True)))
        return np.asarray(logsumexp(evidence + prior[possible], axis=-1) + self._data.log_priors - self._lacking)

    @cached_property
    def _undisturbed(self) -> list[np.ndarray]:
        """Sums of products and of determinants over all blocks without an amplitude."""
        parts = (self._products, self._determinants)
        return [self._summed(range(len(own)), [block[:, :1] for block in own]) for own in parts]

    def _summed(self, numbers: Sequence[int], parts: list[np.ndarray]) -> np.ndarray:
        """Return the sum of parts (noises, T, ...) of blocks under every combination of the quantities' noises."""
        names = self._data.names
        total: np.ndarray | float = 0.0
        for number, own in zip(numbers, parts, strict=True):
            axes = [len(own) if one == self._data.blocks[number][0] else 1 for one in names]
            total = total + own.reshape(*axes, *own.shape[1:])
        return np.asarray(total)


def _log_evidence(products: np.ndarray, determinants: np.ndarray) -> np.ndarray:
    """Return the log evidence, parameters of standard normal prior integrated out.

    The last pivot of a Cholesky factorisation is what the parameters leave of the residual.
    """
    prior = np.eye(products.shape[-1])
    prior[-1, -1] = 0.0
    pivots = np.diagonal(np.linalg.cholesky(products + prior), axis1=-2, axis2=-1)
    return -0.5 * (2.0 * np.log(pivots[..., :-1]).sum(axis=-1) + determinants + pivots[..., -1] ** 2)
