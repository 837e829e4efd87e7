"""Answer of a search: names, something else, or nothing, each with its probability, from one posterior.

Hypotheses, with their prior probabilities, and the evidence of all data (`flexible`):

- nothing is missing: the recalibrated model is right, within its own error;
- the effects found are what is missing: the model with them is right, within its own error;
- something else is missing: the recalibrated model and an unknown error of any size, or a response of a device that is
  not listed, to what it reads or to another signal, or an unknown source of flow at a node; or, because something else
  may resemble effects of the library, the model with some of these and such a response or source, or with all and an
  error of any size, or with a size that differs between conditions, or with a wiring error in place of an effect.

The most probable answer is given, with its probability: what a wrong one costs, only its reader knows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp, softmax

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import linearise
from coronaryuq.discrepancy.inference.evidence import Evidence, Where
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.size_constancy import Constancy, constancy
from coronaryuq.discrepancy.selection.unknown_source import possible_sources
from coronaryuq.discrepancy.selection.unlisted_response import (
    log_prior_of_errors,
    shares_of_responses,
    unlisted_responses,
)
from coronaryuq.zerod.effects.base import Effect

NOTHING, NAMES, OTHER = "nothing", "names", "something else"
ALONE, REMAINDER, VARYING = "alone", "remainder", "varying size"
MISWIRED, UNLISTED = "wiring error of the model", "unlisted response of a device"
SOURCE = "unknown source of flow"
"""Forms of something else."""
OUTSIDE = np.log(RULE.prior_outside / RULE.prior_named)
"""Log prior odds that something else resembles a model's effects rather than that the effects are right."""
VARIES = np.log(0.25)
"""Log of the share of that prior that belongs to sizes that vary between conditions."""


@dataclass(frozen=True)
class Answer:
    """Posterior over the answers.

    Attributes
    ----------
    probabilities
        Of `NOTHING`, `NAMES` and `OTHER`; they add up to 1.
    forms
        Probabilities of the forms of something else, which add up to that of `OTHER`.
    shown
        Quantity, place and condition (empty: every one) of the data in which something else shows → probability, if it
        is of the form `ALONE` or `REMAINDER`; they add up to 1.
    device
        What the device reads whose unlisted response is likeliest; empty if there is none.
    picked_up
        The signals to one of which it responds, as far as the data distinguish them; none if it may be its own.
    log_evidence
        Log evidence of all data for all answers together, weighted by their priors.
    support
        Log evidence of all data that the effects found add to something else of any size; 0 without effects.
    wiring_errors
        Wiring errors of the model that were found or, where that is the answer, are likeliest; they are not named.
    implausible
        Effects found with a size beyond `DecisionRule.implausible`, where the prior ends.
    constancies
        Sizes by condition, of each effect.
    """

    probabilities: dict[str, float]
    forms: dict[str, float]
    shown: dict[Where, float]
    device: str
    picked_up: list[str]
    log_evidence: float
    support: float
    wiring_errors: list[PlacedEffect]
    implausible: list[PlacedEffect]
    constancies: list[Constancy]

    @property
    def given(self) -> str:
        """The most probable answer."""
        return max(self.probabilities, key=lambda answer: self.probabilities[answer])

    @property
    def leading_form(self) -> str:
        """The most probable form of something else."""
        return max(self.forms, key=lambda form: self.forms[form])

    @property
    def varying(self) -> list[Constancy]:
        """Sizes that differ between conditions at odds above those required of a name."""
        return [entry for entry in self.constancies if entry.log_odds > RULE.class_odds]


def without_effects(plain: Evidence) -> tuple[float, float]:
    """Return the log weights of nothing, and of something else alone, by the evidence of the model without effects.

    About effects that were found, the odds of something else besides are the same.
    """
    return float(np.log(RULE.prior_none)) + plain.right, float(np.log(RULE.prior_outside)) + plain.unknown


def answer(
    problem: Problem,
    plain: Evidence,
    fit: Fit,
    hypothesis: Hypothesis,
    log_priors: Sequence[float],
    possible: Sequence[Effect],
    rivals: Mapping[PlacedEffect, float],
    changes: Mapping[str, np.ndarray] | None,
) -> Answer:
    """Weigh the answers by all data.

    Parameters
    ----------
    problem, fit, hypothesis
        The model with the effects found, and its fit.
    plain
        Evidence of all data for the model without any effect.
    log_priors
        Log prior of the class of each effect.
    possible
        Effects of the library that are possible here.
    rivals
        Wiring errors that the data cannot distinguish from an effect found → log odds against its class.
    changes
        `source_changes`; None if no test finds anything, so that responses and sources need not be weighed.

    Returns
    -------
    Answer
        Probabilities of all answers.

    """
    wiring = [placed for placed in hypothesis if not placed.effect.nameable]
    implausible = beyond(fit, hypothesis, RULE.implausible)
    constancies: list[Constancy] = []
    nothing, alone = without_effects(plain)
    named, unlisted, other, seen = -np.inf, ("", list[str]()), {ALONE: alone}, plain
    model, lacking = linearise(problem, fit.z, hypothesis), fit.unreached
    if changes is not None:
        sources = list(possible_sources(problem, changes, possible))
        responses = unlisted_responses(problem, model, hypothesis, log_priors, possible, sources)
        devices, nodes = ({of: responses[of] for of in responses if bool(of[0]) is read} for read in (True, False))
        for form, own in ((UNLISTED, devices), (SOURCE, nodes)):
            other[form] = float(logsumexp([-np.inf, *own.values()])) - lacking
        # Where they are not weighed, the flexible error stands for these, too.
        other[ALONE] += np.log1p(-shares_of_responses(possible) @ [bool(devices), bool(devices), bool(nodes)])
        unlisted = _likeliest(devices) if devices else unlisted
    if hypothesis:
        constancies = constancy(problem, model, hypothesis)
        prior = log_prior_of_errors(problem, hypothesis, log_priors, possible)
        found = problem.all_data.evidence(model.at_zero, model.jacobian, lacking)
        right = prior + found.right
        other[REMAINDER] = prior + OUTSIDE + found.unknown
        # An implausible effect may ruin a condition in which nothing else is wrong.
        seen = found if other[REMAINDER] > alone and not implausible else plain
        differs = float(logsumexp([entry.log_odds for entry in constancies]) - np.log(len(constancies)))
        other[VARYING] = right + OUTSIDE + VARIES + differs
        other[MISWIRED] = right + float(logsumexp([0.0 if wiring else -np.inf, *rivals.values()]))
        if implausible and not wiring:
            other[ALONE] = float(np.logaddexp(other[ALONE], right))
        elif not wiring:
            named = right
    weights = [nothing, named, *other.values()]
    shares, total = softmax(weights).tolist(), float(logsumexp(weights))
    forms = dict(zip(other, shares[2:], strict=True))
    probabilities = {NOTHING: shares[0], NAMES: shares[1], OTHER: min(sum(shares[2:]), 1.0)}
    leads = max(forms, key=lambda form: forms[form]) == MISWIRED and max(shares[:2]) < probabilities[OTHER]
    if leads and not wiring:
        wiring = [max(rivals, key=lambda placed: rivals[placed])]
    support = found.unknown - plain.unknown if hypothesis else 0.0
    shown = dict(zip(seen.shown, softmax(list(seen.shown.values())).tolist(), strict=True))
    return Answer(probabilities, forms, shown, *unlisted, total, support, wiring, implausible, constancies)


def _likeliest(responses: Mapping[tuple[str, str], float]) -> tuple[str, list[str]]:
    """Return the likeliest device, and the signals to which it may respond; none if its own is one of them."""
    likeliest, _ = max(responses, key=lambda pair: responses[pair])
    own = {signal: weight for (device, signal), weight in responses.items() if device == likeliest}
    alike = [signal for signal, weight in own.items() if weight > max(own.values()) - RULE.class_odds]
    return likeliest, [] if "" in alike else alike


def beyond(fit: Fit, hypothesis: Hypothesis, bound: float) -> list[PlacedEffect]:
    """Return the effects with a size more than `bound` standard deviations of its prior from its mean."""
    return [placed for placed in hypothesis if np.any(np.abs(hypothesis.sizes(fit.z, placed)) > bound)]
