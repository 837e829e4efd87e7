"""Evidence of data: of a model that is right within its own error, and of the model with something else missing.

Two things are not known in it, and are averaged over: the noise of the waveforms, of which the scatter leaves several
plausible, and where something else shows, with one amplitude as a fraction of each series' size. It may be

- in all data, independently at each place;
- in one quantity alone, as a flow that is diverted hardly changes pressures;
- at one place alone, as an error of a probe;
- there under one condition alone, as a probe that slipped;
- at one place with every sample independent of its neighbours, as spikes, steps and fast oscillations that no smooth
  function follows, and that would look like noise of all probes otherwise;
- in one quantity under one condition alone, as a recording that went wrong;
- under one condition alone, in all its data, as a state of the patient that the conditions do not describe;
- in one quantity, the same at all places, as an error of the device that reads them;
- the same under one condition alone.

The nine, eight without waveforms, are equally likely. In single values alone it exceeds their noise: less could not be
distinguished from that.

Waveforms have independent errors given the parameters of the model, and something else independent parts: one per
measured place and quantity, one per condition of these, or one per quantity. So every quantity contributes a matrix of
inner products under each noise, every part changes it by one for each amplitude, and every combination is a sum.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import log_softmax

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


# scipy's logsumexp takes longer than the few amplitudes whose sum it is called for.
_log_sum = np.logaddexp.reduce
LEAST = 3.0
"""Typical size of something else in single values alone, in their standard deviations; less would look like noise."""
Where = tuple[str, str, str]
"""Quantity, place and condition of the data in which something else shows; empty: every one."""


class Data:
    """Some rows of a problem's data under each noise and amplitude, shared by all its models.

    Parameters
    ----------
    problem
        With `noises`.
    chosen
        Rows, M of them: (N,), bool.
    """

    def __init__(self, problem: "Problem", chosen: np.ndarray):
        series, forward = problem.forward.measured, problem.forward
        # What several series share, as a pullback and its check the drift of the wire, remains a part of the model.
        within = np.array([len(set(problem.owner[shape != 0.0])) < 2 for shape in forward.noise_shapes], dtype=bool)
        stated = PossibleNoise(0.0, np.zeros(len(problem.y)), forward.noise_shapes[within])
        self.names = list(dict.fromkeys(one.quantity for one in series))
        noises = {name: problem.noises.get(name, (stated,)) for name in self.names}
        axes = np.ix_(*(log_softmax([one.log_prior for one in noises[name]]) for name in self.names))
        self.log_priors = np.asarray(sum(axes)) - problem.widened[chosen].sum()
        """Of every combination of the quantities' noises, with what wider standard deviations cost."""
        self.others = np.flatnonzero([nuisance.noise for nuisance in forward.nuisances])[within]
        """Columns of a model's sensitivities that are weights of the problem's own noise."""
        owner, sd = problem.owner[chosen], problem.sd[chosen]
        rows = {number: np.flatnonzero(owner == number) for number in np.unique(owner).tolist()}
        waves = {name: [own for number, own in rows.items() if series[number].quantity == name] for name in self.names}
        self.noises = {
            name: [_Whitening.under(noise, chosen, sd, waves[name]) for noise in noises[name]] for name in self.names
        }
        alone, shared = (gp_discrepancy.features(problem, common)[chosen] for common in (False, True))
        forms = all_data, by_quantity, by_place, by_series, rough, by_recording, by_condition, common, common_there = [
            defaultdict[Where, list[Part]](list) for _ in range(9)
        ]
        blocks = gp_discrepancy.blocks(problem)[chosen]
        for number in np.unique(blocks):
            own = np.flatnonzero(blocks == number)
            one = series[owner[own[0]]]
            part = Part(own, alone[own], one.quantity, self.noises[one.quantity])
            all_data["", "", ""].append(part)
            by_quantity[one.quantity, "", ""].append(part)
            by_place[one.quantity, one.location, ""].append(part)
        read = defaultdict[Where, list[np.ndarray]](list)
        for number, own in rows.items():
            one = series[number]
            part = Part(own, alone[own], one.quantity, self.noises[one.quantity])
            by_series[one.quantity, one.location, one.condition].append(part)
            by_recording[one.quantity, "", one.condition].append(part)
            by_condition["", "", one.condition].append(part)
            if one.value.size > 1:
                by_sample = np.diag(np.abs(one.value).max() / sd[own])
                rough[one.quantity, one.location, ""].append(replace(part, features=by_sample))
            for condition in ("", one.condition):
                read[one.quantity, "", condition].append(own)
        for where, each in read.items():
            own = np.concatenate(each)
            form = common_there if where[2] else common
            form[where].append(Part(own, shared[own], where[0], self.noises[where[0]]))
        several = {number for number in rows if series[number].value.size > 1}
        for form in forms[1:]:
            for where, parts in form.items():
                if several.isdisjoint(owner[np.concatenate([part.rows for part in parts])].tolist()):
                    form[where] = [part.exceeding() for part in parts]
        self.forms = [form for form in forms if form]
        """Parts of the data in which something else may be, by where it then shows."""

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
        return Evidence(self, np.column_stack([np.delete(jacobian, self.others, axis=1), at_zero]), lacking)


@dataclass(frozen=True, eq=False)
class _Whitening:
    """One quantity under one noise.

    waves: rows (n,) of each of its series, and what whitens them (n, n); log_determinant: of the covariance.
    """

    waves: list[tuple[np.ndarray, np.ndarray]]
    log_determinant: float

    @classmethod
    def under(cls, noise: PossibleNoise, chosen: np.ndarray, sd: np.ndarray, series: list[np.ndarray]) -> "_Whitening":
        variance, shapes = 1.0 + noise.variance[chosen] / sd**2, noise.shapes[:, chosen] / sd
        factors = [np.linalg.cholesky(np.diag(variance[own]) + shapes[:, own].T @ shapes[:, own]) for own in series]
        waves = [
            (own, solve_triangular(f, np.eye(len(own)), lower=True)) for own, f in zip(series, factors, strict=True)
        ]
        return cls(waves, 2.0 * sum(float(np.log(np.diag(factor)).sum()) for factor in factors))

    def whitened(self, vectors: np.ndarray) -> np.ndarray:
        """Return the vectors (M, m), whitened; zero in the rows of other quantities."""
        found = np.zeros_like(vectors)
        for rows, matrix in self.waves:
            found[rows] = matrix @ vectors[rows]
        return found


@dataclass(frozen=True, eq=False)
class Part:
    """An independent part of something else.

    rows: in which it is (n,); features: of unit amplitude there (n, k); name, noises: of the quantity that is measured.
    """

    rows: np.ndarray
    features: np.ndarray
    name: str
    noises: "list[_Whitening]"

    def exceeding(self) -> "Part":
        """Return the part with a typical size of `LEAST` standard deviations or more in every row."""
        typical = AMPLITUDES[np.isfinite(UNKNOWN)].min() * np.linalg.norm(self.features, axis=1)
        return replace(self, features=self.features * np.maximum(1.0, LEAST / np.maximum(typical, 1e-300))[:, None])

    @cached_property
    def seen(self) -> "list[_Seen]":
        """The part under each noise."""
        features = self.features[:, np.any(self.features != 0.0, axis=0)]
        return [_Seen.under(noise, self.rows, features) for noise in self.noises]


@dataclass(frozen=True, eq=False)
class _Seen:
    """A part of something else under one noise.

    directions: of it (n, k); explained: fraction of the variance along each that is its, by amplitude (T, k);
    log_determinants: of the covariance, over that without it (T,).
    """

    directions: np.ndarray
    explained: np.ndarray
    log_determinants: np.ndarray

    @classmethod
    def under(cls, noise: _Whitening, rows: np.ndarray, features: np.ndarray) -> "_Seen":
        everywhere = np.zeros((max(int(own.max()) for own, _ in noise.waves) + 1, features.shape[1]))
        everywhere[rows] = features
        whitened = noise.whitened(everywhere)[rows]
        squares, vectors = np.linalg.eigh(whitened.T @ whitened)
        kept = squares > 1e-9 * max(float(squares.max(initial=0.0)), 1e-300)
        spread = np.multiply.outer(AMPLITUDES**2, squares[kept])
        directions = whitened @ vectors[:, kept] / np.sqrt(squares[kept])
        return cls(directions, spread / (1.0 + spread), np.log1p(spread).sum(axis=1))


class Evidence:
    """Log evidence of data for one model, averaged over the noises, up to the constant of `gauss_newton`.

    Parameters
    ----------
    data
        The data.
    vectors
        Sensitivities and, last, residual, whitened by the problem's own noise: (M, m).
    lacking
        See `Data.evidence`.
    """

    def __init__(self, data: Data, vectors: np.ndarray, lacking: float):
        self._data, self._lacking = data, lacking
        self._whitened = {name: [one.whitened(vectors) for one in noises] for name, noises in data.noises.items()}
        self._known: dict[tuple[Part, int], np.ndarray] = {}

    @cached_property
    def right(self) -> float:
        """Of the model as right, within its own error."""
        return float(_log_sum(self._right, axis=None))

    @cached_property
    def _right(self) -> np.ndarray:
        """The same under every combination of the quantities' noises, with its prior."""
        return self._by_noise(self._data.forms[0]["", "", ""], RIGHT)

    @property
    def noises(self) -> dict[str, int]:
        """Number of the most probable noise of each quantity, if the model is right."""
        axes = range(self._right.ndim)
        by_quantity = [_log_sum(self._right, axis=tuple(k for k in axes if k != own)) for own in axes]
        return {name: int(np.argmax(own)) for name, own in zip(self._data.names, by_quantity, strict=True)}

    @property
    def unknown(self) -> float:
        """Of the model together with something else."""
        return float(_log_sum(list(self.shown.values())))

    @cached_property
    def shown(self) -> dict[Where, float]:
        """Of the model together with something else that shows in these data alone, times its prior."""
        forms, found = self._data.forms, dict[Where, float]()
        for form in forms:
            for where, parts in form.items():
                own = float(_log_sum(self._by_noise(parts, UNKNOWN), axis=None)) - np.log(len(forms) * len(form))
                found[where] = float(np.logaddexp(found.get(where, -np.inf), own))
        return found

    def _by_noise(self, parts: Sequence[Part], prior: np.ndarray) -> np.ndarray:
        """Return the evidence with an amplitude in some parts, none in the others, of every combination of noises.

        prior: log prior of amplitudes (T,).
        """
        possible, names = np.flatnonzero(np.isfinite(prior)), list(dict.fromkeys(part.name for part in parts))
        axes, found = [self._data.names.index(name) for name in names], np.empty_like(self._data.log_priors)
        for numbers in np.ndindex(*(found.shape[axis] for axis in axes)):
            here = tuple(numbers[axes.index(k)] if k in axes else slice(None) for k in range(found.ndim))
            noise = dict(zip(names, numbers, strict=True))
            seen = [part.seen[noise[part.name]] for part in parts]
            along = np.vstack([self._along(part, noise[part.name]) for part in parts])
            explained = np.hstack([one.explained[possible] for one in seen])
            log_prior = prior[possible] - 0.5 * sum(one.log_determinants[possible] for one in seen)
            found[here] = _log_sum(self._base.disturbed(here, along, explained) + log_prior, axis=-1)
        return found + self._data.log_priors - self._lacking

    def _along(self, part: Part, number: int) -> np.ndarray:
        """Return the components of the vectors along the directions of a part under a noise: (k, m)."""
        if (key := (part, number)) not in self._known:
            self._known[key] = part.seen[number].directions.T @ self._whitened[part.name][number][part.rows]
        return self._known[key]

    @cached_property
    def _base(self) -> "_Undisturbed":
        """The model with no amplitude anywhere, under every combination of noises."""
        products, determinants = np.zeros(()), np.zeros(())
        for axis, (name, noises) in enumerate(self._data.noises.items()):
            others = [1] * axis + [len(noises)] + [1] * (len(self._data.names) - axis - 1)
            own = np.array([whitened.T @ whitened for whitened in self._whitened[name]])
            products = products + own.reshape(*others, *own.shape[1:])
            determinants = determinants + np.reshape([one.log_determinant for one in noises], others)
        return _Undisturbed(products, determinants)


class _Undisturbed:
    """Inner products M (..., m, m) of sensitivities and, last, residual, with the prior's precision, and C's log det.

    The parameters, of standard normal prior, are integrated out: the last pivot of M is what they leave of the
    residual. An amplitude along directions with components B (k, m) turns M into M - B'EB, E = diag(explained).
    """

    def __init__(self, products: np.ndarray, log_determinants: np.ndarray):
        prior = np.eye(products.shape[-1])
        prior[-1, -1] = 0.0
        self.products, self.log_determinants = products + prior, log_determinants
        self.factor = np.linalg.cholesky(self.products)
        self.inverse = np.linalg.inv(self.factor)

    def disturbed(self, here: tuple, along: np.ndarray, explained: np.ndarray) -> np.ndarray:
        """Return the log evidence (..., T) under some noises, with shares (T, k) explained along directions (k, m)."""
        pivots = np.diagonal(self.factor[here], axis1=-2, axis2=-1)[..., None, :]
        shares, more, kept = np.sqrt(explained), np.zeros(()), np.ones(())
        if len(along) > len(along.T):
            changed = self.products[here][..., None, :, :] - (along.T * explained[:, None, :]) @ along
            pivots = np.diagonal(np.linalg.cholesky(changed), axis1=-2, axis2=-1)
        else:
            # By the matrix determinant lemma, for M and for its part without the residual; the last pivot of the inner
            # matrix, bordered by the residual's part, is the share of its square that is left.
            parts = self.inverse[here] @ along.T
            inner = np.swapaxes(parts, -1, -2)
            inner = np.concatenate([inner[..., :-1] @ parts[..., :-1, :], parts[..., -1:, :]], axis=-2)
            bordered = np.tile(np.eye(len(along) + 1), (*inner.shape[:-2], len(explained), 1, 1))
            both = np.column_stack([shares, np.ones(len(explained))])
            bordered[..., :-1] -= both[:, :, None] * inner[..., None, :, :] * shares[:, None, :]
            left = np.diagonal(np.linalg.cholesky(bordered), axis1=-2, axis2=-1)
            more, kept = np.log(left[..., :-1]).sum(axis=-1), left[..., -1] ** 2
        logs = np.log(pivots[..., :-1]).sum(axis=-1) + more
        return -0.5 * (2.0 * logs + self.log_determinants[here][..., None] + kept * pivots[..., -1] ** 2)
