"""One device in several recordings: which error of its chain, of one size in all of them, do the data together show?

Each recording is searched by itself first. Then every listed error of the chain of a device that all of them have is
fitted in each recording, beside the effects found there: all of them but the errors of that device, or one fewer,
because an effect of the body may have stood in for the device's error. About these fits the posterior of the error's
sizes is normal, so that the evidence of one size common to all recordings has a closed form: the product of the
posteriors over the prior to the power of one less than their number, integrated over the sizes.

As in the search of one recording, a model is right, within its own error, or something else is missing, in any of the
recordings; where the latter is likelier, no error is named, and sizes have the width that the unknown error gives them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from scipy.special import logsumexp

from coronaryuq.core.common_value import common_value
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import posterior_of_all
from coronaryuq.discrepancy.inference.flexible import RIGHT, UNKNOWN, Posterior
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.answer import OUTSIDE
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.library import SEARCHED
from coronaryuq.zerod.effects.measuring_chain import Chain

NONE, SEPARATE, OTHER = "none", "each recording its own", "something else"
"""Answers besides the errors of the chain: none on this device; those that each search found for itself; with any of
these, something else that is missing in a recording."""
AMPLITUDE = np.logaddexp(RIGHT, OUTSIDE + UNKNOWN)
"""Log prior weight of the amplitudes of the flexible discrepancy, whether or not something else is missing."""


@dataclass(frozen=True)
class Fitted:
    """One error of a chain in one recording.

    log_evidence: of all data, whether or not something else is missing; right: log probability that nothing else is;
    mean, covariance: of the sizes (k,), (k, k).
    """

    log_evidence: float
    right: float
    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class SharedError:
    """An error of one device with the same sizes in all recordings.

    Attributes
    ----------
    effect
        The error.
    log_evidence
        Of all data of all recordings.
    mean, covariance
        Of the common sizes (k,), (k, k), in standard deviations of their priors.
    each
        Recording → the error by that recording alone.
    agreement
        p-value of equal sizes in all recordings.
    """

    effect: Effect
    log_evidence: float
    mean: np.ndarray
    covariance: np.ndarray
    each: Mapping[str, Fitted]
    agreement: float


@dataclass(frozen=True)
class DeviceAnswer:
    """What is known of one device.

    Attributes
    ----------
    quantity, places
        What it reads, and where in each recording.
    probabilities
        Of `NONE`, `SEPARATE`, `OTHER` and the names of the errors; they add up to 1.
    errors
        The errors that could be fitted in every recording.
    """

    quantity: str
    places: Mapping[str, str]
    probabilities: Mapping[str, float]
    errors: Sequence[SharedError]


def shared_devices(problems: Mapping[str, Problem]) -> list[tuple[str, dict[str, str]]]:
    """Return each quantity and its device's place in every recording.

    A device is taken to be the same where all recordings have only one place of that quantity, whatever its name, or
    where they have a place of the same name.

    Raises
    ------
    InputError
        Fewer than two recordings, or none that they share.
    """
    if len(problems) < 2:
        raise InputError("shared device", "recordings", list(problems), "give two or more that one device made")
    found = []
    for quantity in ("pressure", "flow"):
        places = {name: _places(problem, quantity) for name, problem in problems.items()}
        if all(len(own) == 1 for own in places.values()):
            found.append((quantity, {name: own[0] for name, own in places.items()}))
        else:
            first, *others = places.values()
            common = [place for place in first if all(place in own for own in others)]
            found += [(quantity, dict.fromkeys(problems, place)) for place in common]
    if not found:
        raise InputError("shared device", "recordings", list(problems), "their waveforms have no place in common")
    return found


def shared_device(discoveries: Mapping[str, Discovery], quantity: str, places: Mapping[str, str]) -> DeviceAnswer:
    """Weigh the errors of one device by all recordings.

    Parameters
    ----------
    discoveries
        Recording → the search of it alone.
    quantity
        What the device reads.
    places
        Recording → where.

    Returns
    -------
    DeviceAnswer
        Probabilities of the errors, and their common sizes.
    """
    alone = [_Recording(found, quantity, places[name]) for name, found in discoveries.items()]
    possible = [effect for effect in SEARCHED if all(one.reads(effect) for one in alone)]
    models = {NONE: [one.without for one in alone]}
    if any(one.errors for one in alone):
        models[SEPARATE] = [one.found for one in alone]
    weights = {name: sum(one.log_evidence for one in fits) for name, fits in models.items()}
    errors = []
    for effect in possible:
        each = {name: one.best(effect) for name, one in zip(discoveries, alone, strict=True)}
        fitted = {name: one for name, one in each.items() if one is not None}
        if len(fitted) == len(each):
            errors.append(combined(effect, fitted))
            models[effect.name] = list(fitted.values())
            weights[effect.name] = max(one.log_prior(effect) for one in alone) + errors[-1].log_evidence
    right = {name: sum(one.right for one in fits) for name, fits in models.items()}
    with np.errstate(divide="ignore"):
        wrong = [weights[name] + np.log(-np.expm1(share)) for name, share in right.items()]
    weights = {name: weight + right[name] for name, weight in weights.items()} | {OTHER: float(logsumexp(wrong))}
    total = logsumexp(list(weights.values()))
    probabilities = {name: float(np.exp(weight - total)) for name, weight in weights.items()}
    return DeviceAnswer(quantity, places, probabilities, errors)


def combined(effect: Effect, each: Mapping[str, Fitted]) -> SharedError:
    """Return the error with one size in all recordings; the prior of the sizes is standard normal.

    Parameters
    ----------
    effect
        The error.
    each
        Recording → the error in that recording alone.
    """
    common = common_value([one.mean for one in each.values()], [one.covariance for one in each.values()])
    evidence = sum(one.log_evidence for one in each.values()) + common.log_overlap
    return SharedError(effect, evidence, common.mean, common.covariance, each, common.agreement)


class _Recording:
    """One recording, and fits of a device's errors beside the effects of the body that its search found.

    errors: of the device, found by the search; found, without: what it found, and the best without such an error.
    """

    def __init__(self, discovery: Discovery, quantity: str, place: str):
        self.problem, self.reading = discovery.problem, (quantity, place)
        accepted = [entry for entry in discovery.rounds if entry.accepted is not None]
        self.priors = {entry.named.placed: entry.class_log_prior for entry in accepted}
        self.errors = [one for one in discovery.hypothesis if self._is_error(one)]
        kept = Hypothesis(tuple(one for one in discovery.hypothesis if one not in self.errors))
        self.bases = list(dict.fromkeys([kept, *(kept.without(one) for one in kept)]))
        own = posterior_of_all(self.problem, discovery.fit, discovery.hypothesis)
        self.found = self._fitted(own, discovery.hypothesis, [])
        self.without = max([*self._fits(None), *([] if self.errors else [self.found])], key=attrgetter("log_evidence"))

    def reads(self, effect: Effect) -> bool:
        """Return whether an effect is an error of the chain of this device alone."""
        return self.reading[1] in self._places(effect) and self._is_error(PlacedEffect(effect, self.reading[1]))

    def log_prior(self, effect: Effect) -> float:
        """Return the log prior of an error of this device: that of one effect at one of its places."""
        possible = [one for one in SEARCHED if self._places(one)]
        return float(np.log(RULE.prior_named / len(possible) / len(self._places(effect))))

    def best(self, effect: Effect) -> Fitted | None:
        """Return an error beside the effects of the body that suit it best; None if the model does not run."""
        return max(self._fits(PlacedEffect(effect, self.reading[1])), key=attrgetter("log_evidence"), default=None)

    def _fits(self, error: PlacedEffect | None) -> list[Fitted]:
        models = [base if error is None else base.with_(error) for base in self.bases]
        found = []
        for base, model, fit in zip(self.bases, models, self.problem.multistart_each(models), strict=True):
            if fit is None:
                continue
            sizes = [] if error is None else list(range(len(fit.z)))[model.columns(fit.z, error)]
            found.append(self._fitted(posterior_of_all(self.problem, fit, model), base, sizes))
        return found

    def _fitted(self, posterior: Posterior, body: Hypothesis, sizes: list[int]) -> Fitted:
        """Return a model's evidence with the prior of its effects of the body, and the posterior of some sizes."""
        evidence = float(logsumexp(posterior.log_evidence + AMPLITUDE))
        log_prior = float(sum(self.priors[one] for one in body))
        mean, covariance = posterior.moments(AMPLITUDE)
        within = covariance[np.ix_(sizes, sizes)]
        return Fitted(evidence + log_prior, posterior.right - evidence, mean[sizes], within)

    def _places(self, effect: Effect) -> list[str]:
        return effect.places(self.problem.forward.anatomy, self.problem.forward.measured)

    def _is_error(self, placed: PlacedEffect) -> bool:
        if not isinstance(placed.effect, Chain):
            return False
        waveforms = (series for series in self.problem.forward.measured if series.statistic == "waveform")
        own = {(s.quantity, s.location) for s in waveforms if placed.effect.covers(placed.place, s)}
        return own == {self.reading}


def _places(problem: Problem, quantity: str) -> list[str]:
    measured = problem.forward.measured
    return list(dict.fromkeys(s.location for s in measured if s.statistic == "waveform" and s.quantity == quantity))
