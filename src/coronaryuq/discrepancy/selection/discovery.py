"""Discovery: the answer of a search and the results on which it is based."""

from dataclasses import dataclass, field

import numpy as np

from coronaryuq.discrepancy.data.conditions import held_out_names
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import Folds
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import Located
from coronaryuq.discrepancy.inference.noise import Noise
from coronaryuq.discrepancy.inference.outliers import Outlier
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.abstention import Gaps, Verdict, beyond
from coronaryuq.discrepancy.selection.candidates import Round, Rounds
from coronaryuq.zerod.effects.base import Parameter


@dataclass(frozen=True, eq=False, kw_only=True)
class Discovery:
    """The answer of a search.

    Attributes
    ----------
    base_problem, base
        The problem with the time-step error of the plain model corrected, and its fit without any effect.
    problem, hypothesis, fit
        The same about the best hypothesis, whether or not its effects are named.
    located, alarm
        Where the plain model disagrees with the data, and whether the global test alarms.
    remaining
        Where the best hypothesis disagrees.
    rounds
        Forward steps, with what backward steps and the held-out check made of them.
    gaps, verdict, folds
        Held-out misfits, what speaks against the hypothesis, (train, test) rows of each fold.
    measured
        The measurements as stated, before their noise was estimated.
    scatter
        Noise of the waveforms about the best hypothesis, by quantity, where it differs from the stated one.
    noise
        The estimated noise that this answer used, by quantity; empty: the stated one.
    candidates_tested
        Candidates scored beside effects, over all rounds.
    outliers
        Samples that stand out from their neighbours.
    """

    base_problem: Problem
    base: Fit
    problem: Problem
    hypothesis: Hypothesis
    fit: Fit
    located: Located
    alarm: bool
    remaining: Located
    rounds: Rounds
    gaps: Gaps
    verdict: Verdict
    folds: Folds
    measured: list[Measured]
    scatter: dict[str, Noise]
    candidates_tested: int = 0
    noise: dict[str, Noise] = field(default_factory=dict)
    outliers: list[Outlier] = field(default_factory=list)

    @property
    def outside_library(self) -> bool:
        """Whether something outside the library is missing: then no effect is named."""
        return self.alarm and self.verdict.abstains

    @property
    def named(self) -> list[Round]:
        """Rounds that named an effect, the one that adds most first; empty if the answer is "outside the library"."""
        kept = [] if self.outside_library else [entry for entry in self.rounds if entry.accepted is not None]
        return sorted(kept, key=lambda entry: -entry.evidence_gain)

    @property
    def log_weight(self) -> float:
        """Log evidence of the best hypothesis, including its prior and the held-out log predictive density.

        Without held-out conditions, that density would count the fitted data twice.
        """
        priors = {entry.named.placed: entry.class_log_prior for entry in self.rounds if entry.accepted is not None}
        held_out = self.gaps.after.total_lpd if held_out_names(self.problem.forward.conditions) else 0.0
        return self.fit.evidence + sum(priors[placed] for placed in self.hypothesis) + held_out

    @property
    def implausible(self) -> list[PlacedEffect]:
        """Effects of the best hypothesis with an implausible size."""
        return beyond(self.fit, self.hypothesis, RULE.implausible)

    def beyond_prior(self, placed: PlacedEffect) -> list[Parameter]:
        """Return the sizes of an effect outside the central 99 % of their prior: another effect may be the true one."""
        return [parameter for parameter, z, _ in self.sizes(placed) if abs(z) > RULE.prior_bound]

    def sizes(self, placed: PlacedEffect) -> list[tuple[Parameter, float, float]]:
        """Return each size of an effect as parameter, z and posterior standard deviation of z."""
        columns = self.hypothesis.columns(self.fit.z, placed)
        spread = np.sqrt(np.diag(self.fit.covariance))
        return list(zip(placed.effect.parameters, self.fit.z[columns], spread[columns], strict=True))
