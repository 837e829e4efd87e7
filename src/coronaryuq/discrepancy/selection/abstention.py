"""When the named effects are not what is missing: the answer is then "outside the library", and nothing is named."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.discrepancy.data.conditions import kept_out
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import Gap, better
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.flow_conservation import redistribution
from coronaryuq.discrepancy.selection.size_constancy import Constancy, constancy

WORTH = 0.2
"""Held-out log predictive density per row that named effects must add to a flexible discrepancy to be named beside it.

Set by looking at two animals' recorded coronary flow, to which compression adds more, and at effects outside the
library in the benchmark, which add less: neither is a test of it. docs/discrepancy-method.md has what other thresholds
answer."""

LEAST_SHARE = 0.9
"""Share of what a flexible discrepancy adds to recalibration's held-out density that named effects in doubt must add by
themselves: as much of the gap as named effects are wanted to close of what the true ones close."""

CENTRAL_99 = 2.5758293035489004
"""Standard deviations of a normal prior that hold its central 99 %."""

FAR_OUT = 4.0
"""Prior standard deviations beyond which no size is believed, set by looking: of those that the benchmark's searches
named none lies there."""

LEAST_FORETOLD = 0.001
"""p-value of held-out measurements below which the named effects do not foretell them: one in a thousand right names
is put in doubt by chance."""


@dataclass(frozen=True)
class Gaps:
    """Held-out gaps of recalibration alone, of the named effects, of a flexible discrepancy, and of both together."""

    before: Gap
    after: Gap
    flexible: Gap
    both: Gap


@dataclass(frozen=True)
class Verdict:
    """What speaks against named effects.

    mistaken: those that are a mistake in the model. redistributed: they are flow gains that blood which goes elsewhere
    explains as well, with one cause. refuted: measurements that no fit had seen take back so much that all together
    leave less than naming takes, or recalibration alone predicts them better while something remains. incredible: a
    size lies beyond `FAR_OUT`; or a sensor would have to be off by more than any is, and even so something remains, and
    held-out measurements are not foretold. overtaken: they are in doubt, and add less than `LEAST_SHARE` of what a
    flexible discrepancy adds. varying: those of different size under different conditions. foretold:
    p-value of the held-out measurements with the named effects; unforeseen: there are such, and it is below
    `LEAST_FORETOLD`. helped: as the function of that name gives it, compared with `WORTH`.
    """

    mistaken: list[PlacedEffect]
    redistributed: bool
    refuted: bool
    incredible: bool
    overtaken: bool
    constancies: list[Constancy]
    varying: list[Constancy]
    foretold: float
    unforeseen: bool
    helped: float | None

    @property
    def taken_back(self) -> bool:
        """Whether nothing is named however much it would help a flexible discrepancy."""
        return bool(self.mistaken) or self.redistributed or self.refuted or self.incredible or self.overtaken

    @property
    def abstains(self) -> bool:
        return self.taken_back or bool(self.helped is not None and self.helped <= WORTH)


def judge(
    problem: Problem,
    base: Fit,
    fit: Fit,
    named: list[tuple[PlacedEffect, float]],
    effects: int,
    still: bool,
    gaps: Gaps,
    foretold: float,
) -> Verdict:
    """named: effects in the order of the fit, each with the log prior of its class; effects: how many the library has
    here; still: whether they leave something to explain; foretold: p-value of the held-out measurements with them.
    """
    least, hypothesis = problem.settings.least_log_odds, Hypothesis(tuple(placed for placed, _ in named))
    priors = [prior for _, prior in named]
    redistributed = bool(redistribution(problem, fit, hypothesis, priors, effects) > 0.0)
    # What effects add to the log evidence of the fitted measurements, and to the log predictive density of the others,
    # is their log evidence from all of them.
    odds = fit.evidence + sum(priors) - base.evidence + gaps.after.total_lpd - gaps.before.total_lpd
    tested = kept_out(problem.forward.conditions)
    constancies = constancy(problem, fit, hypothesis)
    varying = [one for one in constancies if one.log_odds > least]
    lost = still and better(gaps.before, gaps.after)
    # Without a condition kept out, evidence would count them twice.
    refuted = bool(hypothesis and (lost or (tested and odds < least)))
    mistaken = [placed for placed in hypothesis if not placed.effect.nameable]
    unforeseen = bool(hypothesis and foretold < LEAST_FORETOLD)
    nats = helped(still, bool(varying) or unforeseen, gaps)
    incredible = far_out(fit, hypothesis, FAR_OUT)
    if still and unforeseen:
        incredible |= far_out(fit, hypothesis, CENTRAL_99, instruments=True)
    overtaken = bool(nats is not None and _added(gaps, gaps.after) < LEAST_SHARE * _added(gaps, gaps.flexible))
    return Verdict(
        mistaken, redistributed, refuted, incredible, overtaken, constancies, varying, foretold, unforeseen, nats
    )


def _added(gaps: Gaps, one: Gap) -> float:
    """Nats that it adds to the held-out density of recalibration alone."""
    return one.total_lpd - gaps.before.total_lpd


def far_out(fit: Fit, hypothesis: Hypothesis, most: float, instruments: bool = False) -> bool:
    """Whether a size, of an instrument's error alone if so said, lies more than `most` standard deviations of its prior
    from its mean."""
    return any(
        bool(np.any(np.abs(hypothesis.sizes(fit.z, placed)) > most))
        for placed in hypothesis
        if placed.effect.is_measurement_error or not instruments
    )


def helped(still: bool, doubtful: bool, gaps: Gaps) -> float | None:
    """Nats per held-out row that the named effects add to a flexible discrepancy.

    None where the question does not arise: all named effects have one size under all conditions and foretell the
    held-out measurements, and they leave nothing, or a flexible discrepancy alone does not predict held-out data better
    than they do, by 3 nats and half a standard error.
    """
    if not doubtful and not (still and better(gaps.flexible, gaps.after)):
        return None
    return gaps.both.lpd - gaps.flexible.lpd
