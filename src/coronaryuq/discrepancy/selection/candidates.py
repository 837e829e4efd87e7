"""Which effect is missing: every effect at every place, the likely ones fitted and weighed by marginal likelihood."""

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.library import SEARCHED
from coronaryuq.zerod.effects.quadratic import TAG

CONTENDER, ROUGH = 15.0, 0.2
"""Log weight behind the best within which a candidate is fitted in full: so much, and a share of what the best gains,
because sensitivities of the nuisance parameters that were not recomputed err the more, the farther a fit has moved."""
ASTRAY = 10.0
"""Log evidence behind the fit without it from which a candidate's fit has gone astray."""
ASTRAY_TRIED = 5
"""Effects whose best candidate is fitted from other points where its fit has gone astray, which takes three in full."""
EXACT, LIKELY = 5, 40
"""Candidates of a shortlist that are fitted in full, and those that are worth a second look, at most."""
STORES = "epicardial_compliance"
"""The effect that gives a vessel a compliance."""
PRIOR_NONE, PRIOR_NAMED, PRIOR_OUTSIDE = 0.45, 0.45, 0.10


@dataclass
class Candidate:
    """One effect at one place on top of what is already there.

    z_score: of the score test; p_varying: of that with a size for each condition; estimate: log evidence and guess:
    size z, both as `screening` finds them; response: change (N,) of whitened predictions by a small size, about the
    point where it was last run; fit: with full marginal likelihood, None while not on the shortlist; from_the_mean: the
    best of the fits from the prior's mean beside the same effects, None while there was no need of any.
    log_prior: its share of `PRIOR_NAMED`: effects alike, then places alike.
    """

    effect: Effect
    place: str
    log_prior: float
    z_score: float = 0.0
    p_varying: float = 1.0
    estimate: float = -np.inf
    guess: np.ndarray | None = None
    response: np.ndarray | None = None
    fit: Fit | None = None
    from_the_mean: Fit | None = None
    probability: float = 0.0

    @property
    def placed(self) -> PlacedEffect:
        return PlacedEffect(self.effect, self.place)

    @property
    def one_sided(self) -> bool:
        """Whether all sizes are positive by nature."""
        return all(parameter.kind == "lognormal" for parameter in self.effect.parameters)

    @property
    def p_value(self) -> float:
        """Of the score test alone."""
        return float(stats.norm.sf(self.z_score)) * (1.0 if self.one_sided else 2.0) if self.z_score > 0 else 1.0

    @property
    def promise(self) -> float:
        """Log weight by the estimate."""
        return self.estimate + self.log_prior

    @property
    def log_weight(self) -> float:
        return -np.inf if self.fit is None else self.fit.evidence + self.log_prior

    def clear_score(self) -> None:
        """As it stands before any run of it: neither seen nor promising."""
        self.z_score, self.p_varying, self.estimate = 0.0, 1.0, -np.inf
        self.guess = np.zeros(len(self.effect.parameters))


def all_candidates(problem: Problem, hypothesis: Hypothesis, library: tuple[Effect, ...] = SEARCHED) -> list[Candidate]:
    """Every effect, and every mistake in the model, at every place it may act, less what is already there."""
    forward = problem.forward
    used = {placed.key for placed in hypothesis}
    fitted = {forward.measured[i].condition for i in np.unique(problem.owner[problem.train])}
    observed = [series for series in forward.measured if series.condition in fitted]
    # What is put ahead of a vessel to hold its loss is part of it, and no place of its own.
    ahead = {f"{vessel}_{TAG}" for vessel in forward.anatomy.vessels}
    # A vessel whose stenosis conditions declare has no compliance of its own (`conditions.under`).
    stenosed = {vessel for condition in forward.conditions.values() for vessel in condition.stenosis}
    places = {
        effect.name: [
            place
            for place in effect.places(forward.anatomy, observed)
            if place not in ahead and not (effect.name == STORES and place in stenosed)
        ]
        for effect in library
    }
    possible = [effect for effect in library if places[effect.name]]
    found = []
    for effect in possible:
        prior = np.log(PRIOR_NAMED / len(possible) / len(places[effect.name]))
        found += [Candidate(effect, p, prior) for p in places[effect.name] if (effect.name, p) not in used]
    return found


def shortlist(candidates: list[Candidate], count: int) -> list[Candidate]:
    """The most promising `count`, and the best place of every effect that the score test does not rule out."""
    ranked = sorted(candidates, key=lambda c: -c.promise)
    chosen = [c for c in ranked[:count] if c.z_score > 2.0]
    for name in dict.fromkeys(c.effect.name for c in ranked):
        best = next(c for c in ranked if c.effect.name == name)
        if best not in chosen and best.z_score > 3.0:
            chosen.append(best)
    return chosen


def likely(candidates: list[Candidate]) -> list[Candidate]:
    """The most promising `LIKELY` of those that the score test does not rule out: what is worth a second look."""
    return sorted((c for c in candidates if c.z_score > 2.0), key=lambda c: -c.promise)[:LIKELY]


def fit_shortlist(problem: Problem, base: Fit, hypothesis: Hypothesis, chosen: list[Candidate], vantage: Fit) -> None:
    """Fit the shortlist from `vantage` with its sensitivities frozen, then the best `EXACT` in full.

    Where even the best of those leaves the prior, so much is still missing that a fit may have ended anywhere: those
    that compete are fitted from other points too, as are those that promise to and have gone astray.
    """
    found = problem.fit_candidates(vantage, hypothesis, [c.placed for c in chosen], [c.guess for c in chosen])
    for candidate, fit in zip(chosen, found, strict=True):
        candidate.fit = fit
    contenders = _contenders(chosen, base)
    found = problem.calibrate_each([(hypothesis.with_(candidate.placed), candidate.fit.z) for candidate in contenders])
    for candidate, fit in zip(contenders, found, strict=True):
        candidate.fit = fit
    contenders = _contenders(chosen, base)
    again = contenders if contenders and problem.distorted(contenders[0].fit) else []
    least = contenders[0].log_weight - CONTENDER if contenders else -np.inf
    refit(problem, hypothesis, [*again, *(c for c in lost(chosen, least, base.evidence) if c not in again)])


def lost(candidates: list[Candidate], least: float, without: float) -> list[Candidate]:
    """Those that promise more than `least` but whose fit is behind that without any effect, which a size near nought
    would be: it has gone astray, perhaps because sizes of other effects make up for what this one explains. The best
    place of each effect, as a look about its fit finds the others."""
    astray = [c for c in candidates if c.promise > least and c.fit is not None and c.fit.evidence < without - ASTRAY]
    return best_of_effects(sorted(astray, key=lambda c: -c.promise), ASTRAY_TRIED)


def best_of_effects(ranked: list[Candidate], count: int) -> list[Candidate]:
    """The first candidate of each of the first effects: about one place many are nearly the same."""
    best: dict[str, Candidate] = {}
    for candidate in ranked:
        best.setdefault(candidate.effect.name, candidate)
    return list(best.values())[:count]


def refit(problem: Problem, hypothesis: Hypothesis, candidates: list[Candidate]) -> None:
    """Let candidates beside other effects have the best of their fits and of those that start from the prior's mean."""
    for candidate in candidates:
        if candidate.from_the_mean is None:
            candidate.from_the_mean = problem.from_the_mean(hypothesis.with_(candidate.placed))
        other = candidate.from_the_mean
        if other is not None and other.evidence > candidate.fit.evidence:
            candidate.fit = other


def _contenders(chosen: list[Candidate], base: Fit) -> list[Candidate]:
    """The best of those that were fitted, so many at most, and none too far behind the first."""
    ranked = sorted((c for c in chosen if c.fit is not None), key=lambda c: -c.log_weight)
    if not ranked:
        return []
    return [c for c in ranked[:EXACT] if c.log_weight > least_weight(ranked[0], base)]


def least_weight(best: Candidate, without: Fit) -> float:
    """Log weight from which another competes with the best. without: fit of the model with neither."""
    return best.log_weight - CONTENDER - ROUGH * max(0.0, best.log_weight - without.evidence)


def posterior(without: float, chosen: list[Candidate], outside: float) -> dict[str, float]:
    """Set the candidates' probabilities; returns those of "none" and "outside the library".

    Candidates and "none" share 1 among them, given that the truth is in the library; "outside" is the probability that
    it is not. The second is by evidence alone, and says yes to any small misfit of a model to many data: whether to
    abstain is decided by prediction of held-out data (`abstention.judge`).
    without, outside: log evidence of the model without any of them, and of that with a flexible discrepancy.
    """
    weights = np.array([without + np.log(PRIOR_NONE), outside + np.log(PRIOR_OUTSIDE), *(c.log_weight for c in chosen)])
    share = np.exp(weights - weights.max())
    share /= share.sum()
    inside = np.exp(np.delete(weights, 1) - np.delete(weights, 1).max())
    inside /= inside.sum()
    for candidate, probability in zip(chosen, inside[1:], strict=True):
        candidate.probability = float(probability)
    return {"none": float(inside[0]), "outside": float(share[1])}


LARGEST_CLASS_ODDS = 3.0
"""Log odds up to which the data cannot tell two candidates apart: 20 to 1."""


def indistinguishable(best: Candidate, chosen: list[Candidate]) -> list[Candidate]:
    """The best candidate and those against which it has odds, or a Bayes factor, below 20 to 1; most probable first.

    The same loss at the same vessel may be two effects, of which one could be at forty places: their odds differ, but
    no datum tells them apart.
    """

    def alike(other: Candidate) -> bool:
        odds, factor = best.log_weight - other.log_weight, best.fit.evidence - other.fit.evidence
        return min(odds, factor) < LARGEST_CLASS_ODDS

    rivals = [c for c in chosen if c is not best and c.fit is not None and alike(c)]
    return [best, *sorted(rivals, key=lambda c: -c.log_weight)]


def of_class(one: Candidate, chosen: list[Candidate]) -> float:
    """Log weight of a candidate and of its class together; effects and mistakes in the model do not count as one.

    Three places that the data cannot tell apart share the odds that one of them would have by itself.
    """
    shared = [c.log_weight for c in indistinguishable(one, chosen) if c.effect.nameable == one.effect.nameable]
    return float(logsumexp(shared))


def preferred(chosen: list[Candidate]) -> Candidate:
    """The best candidate; an effect goes before a mistake in the model that the data cannot tell from it."""
    best = max(chosen, key=lambda c: c.log_weight)
    return next((c for c in indistinguishable(best, chosen) if c.effect.nameable), best)
