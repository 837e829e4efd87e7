"""Candidates for the missing effect: every effect at every place, their weights, and indistinguishable classes."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.grafting import grafted
from coronaryuq.zerod.effects.library import SEARCHED
from coronaryuq.zerod.effects.quadratic import TAG
from coronaryuq.zerod.effects.stenosis import FOCAL

COMPLIANCE = "epicardial_compliance"
"""The effect that gives a vessel a compliance."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A candidate: one more effect at a place, with its results in a round.

    log_prior: its part of the prior of named effects. z_score: score test; p_varying: p-value of the test with one size
    per condition. signal: what the fitted data would show of its typical size, in noise standard deviations, after
    recalibration. estimate: log evidence with it, and guess: its size z, both from a few runs. response: change (N,) of
    whitened predictions by a small size about the point where it was last run. rough: fit of an exchange of channels
    from there. fit: together with the other effects, its own sizes last; multistart: best fit from the prior mean, if
    that was needed. share: probability given that one of those fitted in the round is what is missing.
    """

    placed: PlacedEffect
    log_prior: float
    z_score: float = 0.0
    p_varying: float = 1.0
    signal: float = 0.0
    estimate: float = -np.inf
    guess: float = 0.0
    response: np.ndarray | None = None
    rough: Fit | None = None
    fit: Fit | None = None
    multistart: Fit | None = None
    share: float = 0.0

    @property
    def effect(self) -> Effect:
        return self.placed.effect

    @property
    def place(self) -> str:
        return self.placed.place

    @property
    def one_sided(self) -> bool:
        """Whether all sizes are positive by nature."""
        return all(parameter.kind == "lognormal" for parameter in self.effect.parameters)

    @property
    def typical(self) -> float:
        """Typical size z of its prior: the median of sizes that are positive by nature, otherwise one deviation."""
        return 0.0 if self.one_sided else 1.0

    @property
    def p_value(self) -> float:
        """Magnitude of the score test alone."""
        return float(stats.norm.sf(self.z_score)) * (1.0 if self.one_sided else 2.0) if self.z_score > 0 else 1.0

    @property
    def possible(self) -> bool:
        """Whether the score test does not exclude it; of an exchange, no small change, that test says nothing."""
        return self.z_score > RULE.shortlist_score or self.effect.exchanges

    @property
    def promise(self) -> float:
        """Log weight by the estimate."""
        return self.estimate + self.log_prior

    @property
    def start(self) -> np.ndarray:
        """Starting sizes of a fit."""
        return self.at_size(self.guess)

    def at_size(self, z: float) -> np.ndarray:
        """Return the sizes with the first one at z; others, which are of its shape, at their prior's mean."""
        return z * np.eye(len(self.effect.parameters))[0]

    @property
    def fitted(self) -> Fit:
        """The fit; raises ValueError if there is none."""
        if self.fit is None:
            raise ValueError(f"{self.effect.name} at {self.place} was not fitted")
        return self.fit

    @property
    def log_weight(self) -> float:
        """Log evidence plus log prior; -inf without a fit."""
        return -np.inf if self.fit is None else self.fit.evidence + self.log_prior


@dataclass(frozen=True, eq=False)
class Round:
    """One forward step, updated by backward steps and the confirmation.

    shortlist: fitted candidates, best first; accepted: the one named, None if none was good enough or it was undone;
    members: the accepted one and those that data cannot distinguish from it; scored: all candidates; others: other
    effects in the shortlist's fits. evidence_gain, held_out_gain: increase of the log evidence, and of the held-out log
    predictive density, by the accepted effect given all the others (None: it is the only one). refuted: the candidate
    accepted until the confirmation.
    """

    shortlist: list[Candidate]
    accepted: Candidate | None
    members: Sequence[Candidate] = ()
    scored: Sequence[Candidate] = ()
    others: Hypothesis = PLAIN
    evidence_gain: float = np.inf
    held_out_gain: float | None = None
    refuted: Candidate | None = None

    @property
    def named(self) -> Candidate:
        """The accepted candidate; raises ValueError if there is none."""
        if self.accepted is None:
            raise ValueError("the round accepted no candidate")
        return self.accepted

    @property
    def effects(self) -> list[Candidate]:
        """The members of the class that are effects, not wiring errors of the model."""
        return [c for c in self.members if c.effect.nameable]

    @property
    def wiring_errors(self) -> dict[PlacedEffect, float]:
        """Wiring errors that data cannot distinguish from the accepted effect → log odds against its class."""
        if not self.named.effect.nameable:
            return {}
        own = class_log_weight(self.named, self.members)
        return {c.placed: c.log_weight - own for c in self.members if not c.effect.nameable}

    @property
    def class_log_prior(self) -> float:
        """Log prior of the accepted effect if it represented all of its class."""
        return class_log_weight(self.named, self.members) - self.named.fitted.evidence

    def decided(self, best: Candidate, tried: list[Candidate], others: Hypothesis) -> "Round":
        """Return the round with the best of all candidates that were tried beside some other effects."""
        tried = with_shares(tried)
        (accepted,) = updated([best], tried)
        members = indistinguishable(accepted, tried)
        return replace(self, shortlist=tried, accepted=accepted, members=members, others=others)


Rounds = tuple[Round, ...]


def round_of(rounds: Rounds, placed: PlacedEffect) -> Round:
    """Return the round that accepted an effect."""
    return next(entry for entry in rounds if entry.accepted is not None and entry.accepted.placed == placed)


def replaced(rounds: Rounds, old: Round, new: Round) -> Rounds:
    """Return the rounds with one of them replaced by a new state."""
    return tuple(new if entry is old else entry for entry in rounds)


def updated(candidates: Iterable[Candidate], changed: Iterable[Candidate]) -> list[Candidate]:
    """Return the candidates with the changed ones in place of their earlier states."""
    news = {candidate.placed: candidate for candidate in changed}
    return [news.get(candidate.placed, candidate) for candidate in candidates]


def all_candidates(problem: Problem, hypothesis: Hypothesis, library: tuple[Effect, ...] = SEARCHED) -> list[Candidate]:
    """Return every effect and every wiring error of the library at each possible place, without those assumed."""
    forward, used = problem.forward, {placed.key for placed in hypothesis}
    fitted = {forward.measured[i].condition for i in np.unique(problem.owner[problem.train])}
    observed = [series for series in forward.measured if series.condition in fitted]
    # A vessel inserted for the loss of another vessel is part of that vessel, not a separate place.
    stems = [f"{vessel}_{tag}" for vessel in forward.anatomy.vessels for tag in (TAG, FOCAL)]
    inserted = {grafted(forward.anatomy.network, stem) for stem in stems}
    # A vessel with a declared stenosis has no compliance of its own (`apply_condition`).
    stenosed = {vessel for condition in forward.conditions.values() for vessel in condition.stenosis}
    possible = []
    for effect in library:
        excluded = inserted | stenosed if effect.name == COMPLIANCE else inserted
        placed = [PlacedEffect(effect, p) for p in effect.places(forward.anatomy, observed) if p not in excluded]
        if placed:
            possible.append(placed)
    candidates = []
    for placed in possible:
        prior = np.log(RULE.prior_named / len(possible) / len(placed))
        candidates += [Candidate(one, prior) for one in placed if one.key not in used]
    return candidates


def shortlist(candidates: Iterable[Candidate], count: int, present: Fit | None = None) -> list[Candidate]:
    """Return the most promising `count`, the clearest, and the best place of every effect with a clear score test.

    The clearest, because a strong effect may look unpromising to first order.

    present: the fit with the effects found so far, if there are any. About it estimates are good enough to leave out
    those of the second kind that promise much less than the best: where the truth is none of the library, every effect
    has a clear score test.
    """
    ranked = sorted(candidates, key=lambda c: -c.promise)
    least = -np.inf
    if present is not None and ranked:
        gain = max(0.0, ranked[0].estimate - present.evidence)
        least = ranked[0].promise - RULE.contender_gap - RULE.contender_share * gain
    clearest = best_of_effects(sorted(ranked, key=lambda c: -c.z_score), RULE.likeliest_effects)
    chosen = [c for c in dict.fromkeys((*ranked[:count], *clearest)) if c.possible]
    for best in best_of_effects(ranked, len(ranked)):
        if best not in chosen and best.z_score > RULE.shortlist_effect_score and best.promise > least:
            chosen.append(best)
    return chosen


def likely(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return the most promising of those that the score test does not exclude, to be screened again."""
    visible = (c for c in candidates if c.possible)
    return sorted(visible, key=lambda c: -c.promise)[: RULE.reconsidered]


def best_of_effects(ranked: Iterable[Candidate], count: int) -> list[Candidate]:
    """Return the first candidate of each of the first effects: nearby places of one effect hardly differ."""
    best: dict[str, Candidate] = {}
    for candidate in ranked:
        best.setdefault(candidate.effect.name, candidate)
    return list(best.values())[:count]


def least_weight(best: Candidate, without: Fit) -> float:
    """Return the log weight above which others compete with the best; without: fit of the model with neither.

    Estimates err by the misfit that they leave, not by what a flexible error leaves of it.
    """
    gain = best.fitted.evidence_without_error - without.evidence_without_error
    return best.log_weight - RULE.contender_gap - RULE.contender_share * max(0.0, gain)


def with_shares(candidates: list[Candidate]) -> list[Candidate]:
    """Return the candidates with their probabilities given that one of them is what is missing."""
    weights = np.array([candidate.log_weight for candidate in candidates])
    shares = np.exp(weights - logsumexp(weights)).tolist() if candidates else []
    return [replace(candidate, share=share) for candidate, share in zip(candidates, shares, strict=True)]


def indistinguishable(best: Candidate, candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return a candidate and all with odds, or a Bayes factor, below 20 to 1 against it; most probable first.

    The same loss at a vessel may be two effects, one of which is possible at forty places: their odds differ, although
    no data distinguish them.
    """
    evidence = best.fitted.evidence
    rivals = [
        c
        for c in candidates
        if c.placed != best.placed
        and c.fit is not None
        and min(best.log_weight - c.log_weight, evidence - c.fit.evidence) < RULE.class_odds
    ]
    return [best, *sorted(rivals, key=lambda c: -c.log_weight)]


def class_log_weight(candidate: Candidate, candidates: Iterable[Candidate]) -> float:
    """Return the log weight of a candidate with its class; effects and wiring errors are counted separately.

    Three places that data cannot distinguish have together the odds that one of them would have alone.
    """
    members = indistinguishable(candidate, candidates)
    return float(logsumexp([c.log_weight for c in members if c.effect.nameable == candidate.effect.nameable]))


def least_log_odds(problem: Problem, others: Hypothesis) -> float:
    """Return the log odds that one more effect requires.

    A first one need only be likelier than none: the answer weighs it against nothing and something else by all data.
    """
    return problem.settings.min_log_odds if others else 0.0


def preferred(candidates: Iterable[Candidate]) -> Candidate:
    """Return the best candidate; an effect is preferred to a wiring error that data cannot distinguish from it."""
    candidates = list(candidates)
    best = max(candidates, key=lambda c: c.log_weight)
    return next((c for c in indistinguishable(best, candidates) if c.effect.nameable), best)
