"""Abstention: when the best hypothesis is not what is missing, the answer is "outside the library"."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.data.conditions import held_out_names
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import Gap, predicts_better
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.flow_conservation import redistribution
from coronaryuq.discrepancy.selection.size_constancy import Constancy, constancy


@dataclass(frozen=True)
class Gaps:
    """Held-out misfit of recalibration alone, of the hypothesis, of a flexible discrepancy, and of both together."""

    before: Gap
    after: Gap
    flexible: Gap
    both: Gap

    def gain(self, gap: Gap) -> float:
        """Return the nats that a model adds to the held-out density of recalibration alone."""
        return gap.total_lpd - self.before.total_lpd


@dataclass(frozen=True)
class Verdict:
    """Reasons against the effects of a hypothesis.

    wiring_errors: those that are wiring errors of the model. redistributed: they are flow gains that are explained as
    well by blood on another path, a single cause. refuted: held-out data reduce their evidence below that required of a
    name, or recalibration alone predicts the data better while a misfit remains. implausible: a size beyond
    `DecisionRule.implausible`; or, if a misfit remains and held-out data are not predicted, a measurement error beyond
    the central 99 % of its prior. outperformed: they are doubtful, and gain less than a flexible discrepancy.
    constancies: sizes by condition, of each effect; varying: those that differ between conditions. predictive_p:
    p-value of the held-out data; unpredicted: it is below the threshold. gain_beside_flexible: nats per held-out row
    that they add to a flexible discrepancy, None if nothing is doubtful.
    """

    wiring_errors: list[PlacedEffect]
    redistributed: bool
    refuted: bool
    implausible: bool
    outperformed: bool
    constancies: list[Constancy]
    varying: list[Constancy]
    predictive_p: float
    unpredicted: bool
    gain_beside_flexible: float | None

    @property
    def refused(self) -> bool:
        """Whether nothing is named, whatever the effects would add to a flexible discrepancy."""
        return bool(self.wiring_errors) or self.redistributed or self.refuted or self.implausible or self.outperformed

    @property
    def abstains(self) -> bool:
        """Whether the answer is "outside the library"."""
        gain = self.gain_beside_flexible
        return self.refused or bool(gain is not None and gain <= RULE.gain_beside_flexible)


def judge(
    problem: Problem,
    base: Fit,
    fit: Fit,
    hypothesis: Hypothesis,
    log_priors: Sequence[float],
    effects: int,
    unexplained: bool,
    gaps: Gaps,
    predictive_p: float,
) -> Verdict:
    """Judge a hypothesis by all data.

    base, fit: without and with its effects; log_priors: of the class of each effect; effects: number of effects of the
    library that are possible here; unexplained: whether a misfit remains; predictive_p: p-value of the held-out data
    with them.
    """
    least = problem.settings.min_log_odds
    redistributed = bool(redistribution(problem, fit, hypothesis, log_priors, effects) > 0.0)
    # The increase of the log evidence of the fitted data and of the log predictive density of the others by effects is
    # their log evidence from all data.
    odds = fit.evidence + sum(log_priors) - base.evidence + gaps.after.total_lpd - gaps.before.total_lpd
    has_held_out = held_out_names(problem.forward.conditions)
    constancies = constancy(problem, fit, hypothesis)
    varying = [entry for entry in constancies if entry.log_odds > least]
    worse = unexplained and predicts_better(gaps.before, gaps.after)
    # Without a held-out condition, evidence would count the data twice.
    refuted = bool(hypothesis and (worse or (has_held_out and odds < least)))
    unpredicted = bool(hypothesis and predictive_p < RULE.unpredicted)
    gain = gain_beside_flexible(unexplained, bool(varying) or unpredicted, gaps)
    implausible = bool(beyond(fit, hypothesis, RULE.implausible))
    if unexplained and unpredicted:
        errors = beyond(fit, hypothesis, RULE.prior_bound)
        implausible |= any(placed.effect.is_measurement_error for placed in errors)
    outperformed = gain is not None and gaps.gain(gaps.after) < RULE.share_of_flexible * gaps.gain(gaps.flexible)
    return Verdict(
        wiring_errors=[placed for placed in hypothesis if not placed.effect.nameable],
        redistributed=redistributed,
        refuted=refuted,
        implausible=implausible,
        outperformed=bool(outperformed),
        constancies=constancies,
        varying=varying,
        predictive_p=predictive_p,
        unpredicted=unpredicted,
        gain_beside_flexible=gain,
    )


def beyond(fit: Fit, hypothesis: Hypothesis, bound: float) -> list[PlacedEffect]:
    """Return the effects with a size more than `bound` standard deviations of its prior from its mean."""
    return [placed for placed in hypothesis if np.any(np.abs(hypothesis.sizes(fit.z, placed)) > bound)]


def gain_beside_flexible(unexplained: bool, doubtful: bool, gaps: Gaps) -> float | None:
    """Return the nats per held-out row that the effects add to a flexible discrepancy.

    None if this is not needed: all effects have one size under all conditions and predict the held-out data, and they
    leave no misfit, or a flexible discrepancy alone does not predict held-out data better.
    """
    if not doubtful and not (unexplained and predicts_better(gaps.flexible, gaps.after)):
        return None
    return gaps.both.lpd - gaps.flexible.lpd
