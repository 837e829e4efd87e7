"""Which effect is missing: every effect at every place, scored first by a score test, then by marginal likelihood."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from coronaryuq.discrepancy.forward import Acting
from coronaryuq.discrepancy.inference import Fit
from coronaryuq.discrepancy.problem import Problem
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.library import LIBRARY

MANY = 20
"""More collaterals than this are ranked by superposed leaks before any is run."""
LEAST_SENSITIVITY = 0.3
"""Whitened norm below which data cannot see an effect of the tested size."""
CONTENDER, ROUGH = 15.0, 0.2
"""Log weight behind the best within which a candidate is fitted in full: so much, and a share of what the best gains,
because sensitivities of the nuisance parameters that were not recomputed err the more, the farther a fit has moved."""
SMALL, SMALL_SIGNED = -1.0, 0.3
"""Sizes of the score test, in prior standard deviations: of positive and of signed sizes."""
PRIOR_NONE, PRIOR_NAMED, PRIOR_OUTSIDE = 0.45, 0.45, 0.10


@dataclass
class Candidate:
    """One effect at one place on top of what is already there.

    z_score: of the score test; guess: sizes z that its linear model would fit;
    fit: with full marginal likelihood, None while not on the shortlist.
    log_prior: its share of `PRIOR_NAMED`: effects alike, then places alike.
    """

    effect: Effect
    place: str
    log_prior: float
    z_score: float = 0.0
    guess: np.ndarray | None = None
    fit: Fit | None = None
    probability: float = 0.0

    @property
    def acting(self) -> Acting:
        return self.effect, self.place

    @property
    def one_sided(self) -> bool:
        """Whether all sizes are positive by nature."""
        return all(parameter.kind == "lognormal" for parameter in self.effect.parameters)

    @property
    def p_value(self) -> float:
        """Of the score test alone."""
        return float(stats.norm.sf(self.z_score)) * (1.0 if self.one_sided else 2.0) if self.z_score > 0 else 1.0

    @property
    def log_weight(self) -> float:
        return -np.inf if self.fit is None else self.fit.evidence + self.log_prior


def all_candidates(problem: Problem, acting: list[Acting], library: tuple[Effect, ...] = LIBRARY) -> list[Candidate]:
    """Every effect of the library at every place it may act, less what is already there."""
    forward = problem.forward
    used = {(effect.name, place) for effect, place in acting}
    fitted = {forward.measured[i].condition for i in np.unique(problem.owner[problem.train])}
    observed = [series for series in forward.measured if series.condition in fitted]
    places = {effect.name: effect.places(forward.anatomy, observed) for effect in library}
    possible = [effect for effect in library if places[effect.name]]
    found = []
    for effect in possible:
        prior = np.log(PRIOR_NAMED / len(possible) / len(places[effect.name]))
        found += [Candidate(effect, p, prior) for p in places[effect.name] if (effect.name, p) not in used]
    return found


def screen(problem: Problem, base: Fit, acting: list[Acting], candidates: list[Candidate]) -> None:
    """Set `z_score` of all candidates: the score test of a small size, one run each and condition.

    Statistic g'u / sqrt(g'Pg), u the score and P the marginal precision of the present model (Rao 1948); sizes that are
    positive by nature count only in their own direction.
    """
    many = [c for c in candidates if c.effect.name == "collateral"]
    direct = [c for c in candidates if len(many) <= MANY or c.effect.name != "collateral"]
    columns = _columns(problem, base, acting, direct)
    _score(base, direct, columns)
    if len(many) > MANY:
        likely = _likely_collaterals(problem, base, direct, columns, many)
        _score(base, likely, _columns(problem, base, acting, likely))


def _columns(problem, base, acting, candidates) -> np.ndarray:
    """Whitened change (N, k) of the fitted predictions by a small size of each candidate."""
    rows = [(base.z, list(acting))]
    for candidate in candidates:
        small = [SMALL if parameter.kind == "lognormal" else SMALL_SIGNED for parameter in candidate.effect.parameters]
        rows.append((np.concatenate([base.z, small]), [*acting, candidate.acting]))
    grafts = [one for one in [*acting, *(c.acting for c in candidates)] if one[0].grafted]
    found = problem.fitted(rows, grafts)
    return (found[0] - found[1:]).T


def _score(base: Fit, candidates: list[Candidate], columns: np.ndarray) -> None:
    usable = np.isfinite(columns).all(axis=0) if columns.size else np.zeros(0, dtype=bool)
    safe = np.where(usable, columns, 0.0)
    norm = np.sqrt(np.maximum(np.einsum("ij,ij->j", safe, base.project(safe)), 0.0)) if columns.size else []
    along = safe.T @ base.score if columns.size else []
    for candidate, ok, length, value in zip(candidates, usable, norm, along, strict=True):
        z = value / length if ok and length > LEAST_SENSITIVITY else 0.0
        candidate.guess = _guess(candidate.effect, value / length**2 if length > LEAST_SENSITIVITY else 0.0)
        candidate.z_score = float(max(z, 0.0) if candidate.one_sided else abs(z))


def _guess(effect: Effect, multiple: float) -> np.ndarray:
    """Sizes z for a multiple of the tested small sizes, kept within two and a half prior standard deviations."""
    guess = []
    for parameter in effect.parameters:
        if parameter.kind == "lognormal":
            guess.append(SMALL + np.log(max(multiple, 1e-3)) / parameter.spread)
        else:
            guess.append(SMALL_SIGNED * multiple)
    return np.clip(guess, -2.5, 2.5)


def _likely_collaterals(problem, base, direct, columns, many) -> list[Candidate]:
    """The collaterals that superposed leaks, one end giving and the other taking, explain best."""
    leaks = {c.place: columns[:, i] for i, c in enumerate(direct) if c.effect.name == "side_branch_leak"}
    pressures = problem.forward.bed_pressures()
    condition = problem.condition[problem.train]
    anatomy = problem.forward.anatomy
    guesses = np.zeros((len(base.residual), len(many)))
    for number, candidate in enumerate(many):
        one, other = candidate.place.split("~")
        if one not in leaks or other not in leaks:
            continue
        per_flow = leaks[one] / anatomy.flow_scale(one) - leaks[other] / anatomy.flow_scale(other)
        for name, at in pressures.items():
            difference = at[anatomy.outlet_bc[one]] - at[anatomy.outlet_bc[other]]
            guesses[condition == name, number] = difference * per_flow[condition == name]
    norm = np.sqrt(np.maximum(np.einsum("ij,ij->j", guesses, base.project(guesses)), 1e-300))
    order = np.argsort(-(guesses.T @ base.score) / norm, kind="stable")
    return [many[i] for i in order[: MANY // 2]]


def shortlist(candidates: list[Candidate], count: int) -> list[Candidate]:
    """The best `count` by score, and the best place of every effect that the score test does not rule out."""
    ranked = sorted(candidates, key=lambda c: -c.z_score)
    chosen = [c for c in ranked[:count] if c.z_score > 2.0]
    for name in dict.fromkeys(c.effect.name for c in ranked):
        best = next(c for c in ranked if c.effect.name == name)
        if best not in chosen and best.z_score > 3.0:
            chosen.append(best)
    return chosen


def fit_shortlist(problem: Problem, base: Fit, acting: list[Acting], chosen: list[Candidate], exact: int = 5) -> None:
    """Fit the shortlist with frozen nuisance sensitivities, then the best `exact` in full."""
    for candidate, fit in zip(
        chosen, problem.fit_candidates(base, acting, [c.acting for c in chosen], [c.guess for c in chosen]), strict=True
    ):
        candidate.fit = fit
    ranked = sorted(chosen, key=lambda c: -c.log_weight)
    near = CONTENDER + ROUGH * max(0.0, ranked[0].log_weight - base.evidence) if ranked else 0.0
    least = ranked[0].log_weight - near if ranked else 0.0
    for candidate in ranked[:exact]:
        if candidate.fit is not None and candidate.log_weight > least:
            try:
                candidate.fit = problem.calibrate([*acting, candidate.acting], candidate.fit.z)
            except FloatingPointError:
                candidate.fit = None


def posterior(base: Fit, chosen: list[Candidate], outside_gain: float) -> dict[str, float]:
    """Set the candidates' probabilities; returns those of "none" and "outside the library".

    Candidates and "none" share 1 among them, given that the truth is in the library; "outside" is the probability that
    it is not. The second is by evidence alone, and says yes to any small misfit of a model to many data: whether to
    abstain is decided by prediction of held-out data (`search`).
    outside_gain: log evidence of a flexible discrepancy over the present model.
    """
    weights = np.array(
        [base.evidence + np.log(PRIOR_NONE), base.evidence + outside_gain + np.log(PRIOR_OUTSIDE)]
        + [c.log_weight for c in chosen]
    )
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
    """The best candidate and those whose posterior odds against it are below 20 to 1, most probable first."""
    rivals = [c for c in chosen if c is not best and best.log_weight - c.log_weight < LARGEST_CLASS_ODDS]
    return [best, *sorted(rivals, key=lambda c: -c.log_weight)]
