"""Discovery: the answer of a search and the results on which it is based."""

from dataclasses import dataclass, field

import numpy as np

from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import Folds, Gaps
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import Located
from coronaryuq.discrepancy.inference.noise import Noise
from coronaryuq.discrepancy.inference.outliers import Outlier
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection.answer import MISWIRED, NAMES, NOTHING, OTHER, Answer
from coronaryuq.discrepancy.selection.candidates import Candidate, Round, Rounds
from coronaryuq.discrepancy.selection.unknown_source import UnknownSource
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
        Where the plain model disagrees with the data, and whether the global test of the fitted ones alarms.
    remaining
        Where the best hypothesis disagrees.
    rounds
        Forward steps, as backward steps and the confirmation left them.
    gaps, held_out_p, folds
        Held-out misfits, p-value of the held-out data under the best hypothesis, (train, test) rows of each fold.
    answer
        Probabilities of the answers.
    measured
        The measurements before their noise was estimated.
    uneven
        Quantity and condition whose noise is larger than under other conditions, and how many times.
    noise
        The estimated noise that this answer used, by quantity; empty: the stated one.
    candidates
        All candidates as scored about the recalibrated model.
    candidates_tested
        Candidates scored beside effects, over all rounds.
    outliers
        Samples that stand out from their neighbours, and were left out.
    nodes, source
        Where something else is missing in an open loop: what an unknown source of flow at each node adds, and that
        which adds most; see `unknown_source`.
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
    answer: Answer
    held_out_p: float
    folds: Folds
    measured: list[Measured]
    candidates: list[Candidate] = field(default_factory=list)
    candidates_tested: int = 0
    uneven: dict[str, float] = field(default_factory=dict)
    noise: dict[str, Noise] = field(default_factory=dict)
    outliers: list[Outlier] = field(default_factory=list)
    nodes: list[tuple[str, float]] = field(default_factory=list)
    source: UnknownSource | None = None

    @property
    def outside_library(self) -> bool:
        """Whether something else is missing: then no effect is named."""
        return self.answer.given == OTHER

    @property
    def consistent(self) -> bool:
        """Whether the answer is that nothing is missing."""
        return self.answer.given == NOTHING

    @property
    def named(self) -> list[Round]:
        """Rounds that named an effect, the one that adds most first; empty for another answer."""
        kept = [] if self.answer.given != NAMES else [entry for entry in self.rounds if entry.accepted is not None]
        return sorted(kept, key=lambda entry: -entry.evidence_gain)

    @property
    def log_evidence(self) -> float:
        """Log evidence of all data for all answers together, up to a constant that depends on the data alone."""
        return self.answer.log_evidence - float(np.log(self.problem.sd).sum())

    def probability(self, entry: Round, candidate: Candidate) -> float:
        """Return the probability of the effects found, with a candidate as that of its round, or of a wiring error.

        Zero if the round accepted none, or if all of its kind are impossible: they are then not among the answers.
        """
        alike = sum(c.share for c in entry.shortlist if c.effect.nameable == candidate.effect.nameable)
        if entry.accepted is None or not alike:
            return 0.0
        total = self.answer.probabilities[NAMES] if candidate.effect.nameable else self.answer.forms.get(MISWIRED, 0.0)
        return total * candidate.share / alike

    def class_probability(self, entry: Round) -> float:
        """Return the probability of the effects found, with any member of a round's class."""
        return float(sum(self.probability(entry, member) for member in entry.effects))

    def beyond_prior(self, placed: PlacedEffect) -> list[Parameter]:
        """Return the sizes of an effect outside the central 99 % of their prior: another effect may be the true one."""
        return [parameter for parameter, z, _ in self.sizes(placed) if abs(z) > RULE.prior_bound]

    def sizes(self, placed: PlacedEffect) -> list[tuple[Parameter, float, float]]:
        """Return each size of an effect as parameter, z and posterior standard deviation of z.

        z is the posterior mean, or the best fit of an implausible effect.
        """
        columns = self.hypothesis.columns(self.fit.z, placed)
        mean, covariance = self.fit.posterior.moments()
        mean = self.fit.z if placed in self.answer.implausible else mean
        spread = np.sqrt(np.diag(covariance))
        return list(zip(placed.effect.parameters, mean[columns], spread[columns], strict=True))
