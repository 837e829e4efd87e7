"""The whole search on one case: locate, name, add, verify, until nothing is left to explain or nothing helps."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from coronaryuq.discrepancy import flexible
from coronaryuq.discrepancy.abstention import Gaps, Verdict, judge
from coronaryuq.discrepancy.candidates import (
    CONTENDER,
    LARGEST_CLASS_ODDS,
    PRIOR_NAMED,
    Candidate,
    all_candidates,
    fit_shortlist,
    indistinguishable,
    least_weight,
    likely,
    lost,
    of_class,
    posterior,
    preferred,
    refit,
    shortlist,
)
from coronaryuq.discrepancy.inference import Fit
from coronaryuq.discrepancy.locate import Located, locate
from coronaryuq.discrepancy.problem import Problem
from coronaryuq.discrepancy.screening import screen
from coronaryuq.discrepancy.simulation import Acting
from coronaryuq.discrepancy.verify import folds, foretold, gap, linearise
from coronaryuq.zerod.effects.base import Effect, Parameter
from coronaryuq.zerod.effects.library import SEARCHED

Report = Callable[[str], None]

RIVALS = 5
"""Candidates that a look back, or a second look about a better point, fits in full."""
SECOND_LOOKS = 3
RINGS = 3.0
"""Noise standard deviations by which time steps were put right from which another candidate may do better with it."""
LIKELIEST = 3
"""Effects whose best candidates are fitted, or fitted again, where no test sees anything or none is worth naming."""
LARGEST_LOG = 500.0
"""Log Bayes factor beyond which its size is of no matter."""
WORTH_FITTING = 0.5
"""Log evidence by which an estimate must beat a candidate's own fit to have it fitted again."""
ALIKE = LARGEST_CLASS_ODDS + 2.0
"""Log odds, or log Bayes factor, by which an estimate about the best fit may fall behind it and be of its class."""
CENTRAL_99 = 2.5758293035489004
"""Standard deviations of a normal prior that hold its central 99 %."""


@dataclass
class Round:
    """One round of naming: everything on the shortlist, and what was accepted (None: nothing helped enough)."""

    shortlist: list[Candidate]
    probabilities: dict[str, float]
    accepted: Candidate | None
    members: list[Candidate] = field(default_factory=list)
    """Accepted one and those that the data cannot tell from it."""
    screened: list[Candidate] = field(default_factory=list)
    """Every candidate of the round."""
    beside: list[Acting] = field(default_factory=list)
    """Other effects in the fits of the shortlist; a candidate's own sizes stand last in them."""
    worth: float = np.inf
    """Log evidence that the accepted effect adds to all the others."""
    outside_evidence: float = -np.inf
    """Log evidence of a flexible discrepancy in place of any of them."""

    @property
    def class_log_prior(self) -> float:
        """Log prior that the accepted effect would have if it stood for all of its class."""
        return of_class(self.accepted, self.members) - self.accepted.fit.evidence


@dataclass
class Discovery:
    """What a search found. acting: the named effects, in order; fit: their joint fit; base: the model without any.

    plain, problem: with the time steps put right about the model as it is, and about the named effects.
    """

    plain: Problem
    problem: Problem
    base: Fit
    located: Located
    alarm: bool
    rounds: list[Round]
    acting: list[Acting]
    fit: Fit
    remaining: Located
    gaps: Gaps
    verdict: Verdict
    folds: list
    candidates_tested: int = 0

    @property
    def outside_library(self) -> bool:
        """Whether something is missing that the library does not have: nothing is named then."""
        return self.alarm and self.verdict.abstains

    @property
    def named(self) -> list[Round]:
        """Rounds that named an effect, the one worth most first; none where the effect is outside the library."""
        kept = [] if self.outside_library else [r for r in self.rounds if r.accepted is not None]
        return sorted(kept, key=lambda r: -r.worth)

    def beyond_prior(self, one: Acting) -> list[Parameter]:
        """Sizes of a named effect that lie outside the central 99 % of their prior: it may stand for something else."""
        column = self.problem.count
        for effect, place in self.acting:
            sizes = self.fit.z[column : column + len(effect.parameters)]
            if (effect, place) == one:
                return [p for p, z in zip(effect.parameters, sizes, strict=True) if abs(z) > CENTRAL_99]
            column += len(effect.parameters)
        return []


def discover(
    problem: Problem, seed: int, library: tuple[Effect, ...] = SEARCHED, report: Report = lambda line: None
) -> Discovery:
    """Search one problem. `seed` only enters the bootstrap intervals of the gaps; report: gets a line at each step."""
    settings = problem.settings
    report(f"{np.count_nonzero(problem.train)} fitted measurements, {problem.count} nuisance parameters: recalibrating")
    problem, base = recalibrate(problem)
    plain, fit = problem, base
    acting: list[Acting] = []
    located, everything, vantage = assess(problem, fit, acting, library)
    remaining, alarm = located, located.alarm(settings.alarm_level)
    report(_told(everything, located, alarm))
    rounds: list[Round] = []
    features = flexible.features(problem)
    tested = len(everything)
    # Twice as many rounds as effects, should a look back undo what is named again and again.
    most = 2 * settings.max_effects
    while remaining.alarm(settings.alarm_level) and len(acting) < settings.max_effects and len(rounds) < most:
        found = name_one(problem, fit, acting, features, everything, vantage)
        rounds.append(found)
        if found.accepted is None:
            report("none of them is worth naming")
            break
        acting = [*acting, found.accepted.acting]
        fit = found.accepted.fit
        report(f"nearest: {_listed(acting)}")
        for _ in range(len(acting) - 1):
            before = acting
            acting, fit = look_back(problem, acting, fit, rounds)
            if acting == before:
                break
        wanted = len(acting)
        problem, acting, fit = correct(problem, acting, fit, rounds)
        remaining, everything, vantage = assess(problem, fit, acting, library, everything)
        tested += len(everything)
        report(f"beside {_listed(acting)}: {_told(everything, remaining, remaining.alarm(settings.alarm_level))}")
        if len(acting) < wanted:
            report("the last of them was of the time steps")
            break
    if acting:
        fit = problem.to_the_end(acting, fit)
    if len(acting) > 1:
        for entry in (r for r in rounds if r.accepted is not None):
            without = _exact(problem, [one for one in acting if one != entry.accepted.acting])
            entry.worth = np.inf if without is None else fit.evidence - without.evidence
    report("verifying on what was kept out of the fits")
    parts = folds(problem, [name for name, c in problem.forward.conditions.items() if c.held_out])
    recalibrated = linearise(plain, base.z, [])
    repaired = linearise(problem, fit.z, acting) if acting else recalibrated
    _, amplitude = flexible.gain(base, features[problem.train])
    process = recalibrated.extended(amplitude * features)
    _, amplitude = flexible.gain(fit, features[problem.train])
    both = repaired.extended(amplitude * features) if acting else process
    gaps = Gaps(*(gap(problem, model, parts, seed) for model in (recalibrated, repaired, process, both)))
    priors = {entry.accepted.acting: entry.class_log_prior for entry in rounds if entry.accepted is not None}
    effects = len({candidate.effect.name for candidate in everything})
    still = remaining.alarm(settings.alarm_level)
    named = [(one, priors[one]) for one in acting]
    verdict = judge(problem, base, fit, named, effects, still, gaps, foretold(problem, repaired, parts))
    return Discovery(plain, problem, base, located, alarm, rounds, acting, fit, remaining, gaps, verdict, parts, tested)


def _told(everything: list[Candidate], located: Located, alarm: bool) -> str:
    left = "something is missing" if alarm else "nothing to explain"
    return f"{len(everything)} candidates looked at; {left} (global test p = {located.p:.1g})"


def _listed(acting: list[Acting]) -> str:
    return " and ".join(f"{effect.name} at {place}" for effect, place in acting) or "nothing"


def recalibrate(problem: Problem) -> tuple[Problem, Fit]:
    """The model without any effect fitted, and the time steps put right there.

    Where recalibration leaves the prior even so, they stay: candidates are looked at from elsewhere then, and so are
    steps.
    """
    fit = problem.calibrate([])
    right, again = problem.corrected([], fit)
    return (problem, fit) if problem.distorted(again) else (right, again)


def assess(
    problem: Problem,
    fit: Fit,
    acting: list[Acting],
    library: tuple[Effect, ...] = SEARCHED,
    earlier: list[Candidate] = (),
) -> tuple[Located, list[Candidate], Fit]:
    """Locate what disagrees and score every candidate; the global test counts the best of them (Bonferroni).

    earlier: candidates of an earlier round, whose responses may serve again. Returns also where the candidates were
    looked at from.
    """
    everything, known = all_candidates(problem, acting, library), {c.acting: c.response for c in earlier}
    for candidate in everything:
        candidate.response = known.get(candidate.acting)
    vantage = problem.vantage(fit, acting)
    screen(problem, vantage, acting, everything)
    located = locate(problem, fit)
    for name, p in (
        ("best candidate", [c.p_value for c in everything]),
        ("best candidate of varying size", [c.p_varying for c in everything]),
    ):
        located = located.with_test(name, min(p, default=1.0) * max(len(everything), 1))
    if not located.alarm(problem.settings.alarm_level):
        located = located.with_test(
            "likeliest candidates, fitted", _chance_of_evidence(problem, fit, acting, everything)
        )
    return located, everything, vantage


def _chance_of_evidence(problem: Problem, fit: Fit, acting: list[Acting], everything: list[Candidate]) -> float:
    """p-value of the evidence for the effects that promise most, each where it does: a score test does not see what
    recalibration and size do together, as a narrowed valve does with a stronger ventricle.

    The Bayes factor of all candidates together, weighed by their priors, exceeds 1 / p with a probability of p at most
    where nothing is missing (Markov's inequality; Vovk & Wang 2021); those that are not fitted count nought.
    """
    likeliest = _best_of_effects(sorted(everything, key=lambda c: -c.promise))
    found = zip(likeliest, _each(problem, acting, likeliest, fit), strict=True)
    tried = [replace(candidate, fit=its) for candidate, its in found if its is not None]
    _by_own_steps(problem, acting, tried)
    shares = [np.exp(c.log_prior) / PRIOR_NAMED for c in tried]
    factors = [np.exp(min(c.fit.evidence - fit.evidence, LARGEST_LOG)) for c in tried]
    return float(1.0 / max(np.dot(shares, factors), 1.0))


def _best_of_effects(ranked: list[Candidate]) -> list[Candidate]:
    """The first candidate of each of the first effects: about one place many are nearly the same."""
    best: dict[str, Candidate] = {}
    for candidate in ranked:
        best.setdefault(candidate.effect.name, candidate)
    return list(best.values())[:LIKELIEST]


def _by_own_steps(problem: Problem, acting: list[Acting], candidates: list[Candidate]) -> None:
    """Fit candidates beside other effects again, each with the time steps put right about itself."""
    found = problem.corrected_each([([*acting, c.acting], c.fit) for c in candidates])
    for candidate, (_, fit) in zip(candidates, found, strict=True):
        candidate.fit = fit


def name_one(
    problem: Problem,
    fit: Fit,
    acting: list[Acting],
    features: np.ndarray,
    everything: list[Candidate],
    vantage: Fit,
) -> Round:
    """One round: fit the shortlist of scored candidates, weigh, accept the best where the odds of its class suffice."""
    chosen = shortlist(everything, problem.settings.shortlist)
    fit_shortlist(problem, fit, acting, chosen, vantage)
    if acting and vantage is not fit:
        chosen += [c for c in _seen_from(problem, fit, acting, everything) if c not in chosen]
    chosen = [c for c in chosen if c.fit is not None]
    for _ in range(SECOND_LOOKS if chosen else 0):
        before = max(chosen, key=lambda c: c.log_weight)
        near = look_again(problem, fit, before, acting, chosen, everything)
        if before is max(chosen, key=lambda c: c.log_weight):
            fit_alike(problem, before, acting, chosen, near, everything)
            break
    chosen.sort(key=lambda c: -c.log_weight)
    worth_naming = _worth_naming(problem, fit, chosen)
    if not worth_naming:
        _by_own_steps(problem, acting, _best_of_effects(chosen))
        chosen.sort(key=lambda c: -c.log_weight)
        worth_naming = _worth_naming(problem, fit, chosen)
    outside_evidence = fit.evidence + flexible.gain(fit, features[problem.train])[0]
    probabilities = posterior(fit.evidence, chosen, outside_evidence)
    if not worth_naming:
        return Round(chosen, probabilities, None, beside=acting, outside_evidence=outside_evidence)
    accepted = preferred(worth_naming)
    members = indistinguishable(accepted, chosen)
    return Round(chosen, probabilities, accepted, members, everything, acting, outside_evidence=outside_evidence)


def _seen_from(problem: Problem, fit: Fit, acting: list[Acting], everything: list[Candidate]) -> list[Candidate]:
    """Candidates of the shortlist as they look from a distorted fit, with their fits from there where those are better.

    From the prior's mean, where they were looked at, what is named already hides those that explain less than
    recalibration beside it does.
    """
    here = [replace(c, fit=None) for c in everything]
    screen(problem, fit, acting, here)
    known = {c.acting: c for c in everything}
    chosen = shortlist(here, problem.settings.shortlist)
    fit_shortlist(problem, fit, acting, chosen, fit)
    for candidate in chosen:
        one = known[candidate.acting]
        one.z_score = max(one.z_score, candidate.z_score)
        if candidate.estimate > one.estimate:
            one.estimate, one.guess = candidate.estimate, candidate.guess
        if candidate.log_weight > one.log_weight:
            one.fit = candidate.fit
    return [known[candidate.acting] for candidate in chosen]


def _worth_naming(problem: Problem, fit: Fit, chosen: list[Candidate]) -> list[Candidate]:
    """Those whose class has the odds over the present model that are asked for."""
    return [c for c in chosen if of_class(c, chosen) - fit.evidence >= problem.settings.least_log_odds]


def look_again(
    problem: Problem,
    fit: Fit,
    best: Candidate,
    acting: list[Acting],
    chosen: list[Candidate],
    everything: list[Candidate],
) -> list[Candidate]:
    """Screen all candidates in the place of the best one, about its fit; add to `chosen` those that now look as good.

    Recalibration without the right effect distorts the nuisance parameters, and about such a point a neighbour of the
    right place may look best. About the best fit so far they are nearly as they should be, if it has left them within
    their prior. fit: of the present model. Returns the candidates as they look from there, those far behind left out.
    """
    if problem.distorted(best.fit):
        return []
    about = _around(best)
    known = {c.acting: c for c in everything}
    fresh = [replace(c, fit=None) for c in likely(everything)]
    screen(problem, about, acting, fresh)
    near = sorted((c for c in fresh if c.promise > best.log_weight - CONTENDER), key=lambda c: -c.promise)
    waiting = [c for c in near if c.promise > known[c.acting].log_weight + WORTH_FITTING][:RIVALS]
    found = _each(problem, acting, waiting, about, least_weight(best, fit), fit.evidence)
    for candidate, its in zip(waiting, found, strict=True):
        one = known[candidate.acting]
        if its is not None and its.evidence + one.log_prior > one.log_weight:
            one.fit = its
            if one not in chosen:
                chosen.append(one)
    return near


def fit_alike(
    problem: Problem,
    best: Candidate,
    acting: list[Acting],
    chosen: list[Candidate],
    near: list[Candidate],
    everything: list[Candidate],
) -> None:
    """Fit all that may be of the best one's class, as they look about its fit (`near`), and add them to `chosen`.

    Many more may be than a look again fits in full: each segment of one vessel, say. Sensitivities to all but their own
    sizes stay those of the best fit, of which theirs hardly differ; one that goes ahead is fitted in full.
    """
    known = {c.acting: c for c in everything}
    waiting = [c for c in near if known[c.acting].fit is None and _may_be_alike(c, best)]
    if not waiting:
        return
    found = problem.fit_roughly(_around(best), acting, [c.acting for c in waiting], [c.guess for c in waiting])
    for candidate, fit in zip(waiting, found, strict=True):
        if fit is not None:
            known[candidate.acting].fit = fit
            chosen.append(known[candidate.acting])
    ahead = max(chosen, key=lambda c: c.log_weight)
    if ahead is not best:
        ahead.fit = _exact(problem, [*acting, ahead.acting], ahead.fit.z) or ahead.fit


def _may_be_alike(candidate: Candidate, best: Candidate) -> bool:
    """Whether a candidate may be of the class of the best one, as it looks about its fit."""
    return min(best.log_weight - candidate.promise, best.fit.evidence - candidate.estimate) < ALIKE


def _around(best: Candidate) -> Fit:
    """The point of a candidate's fit without its own sizes."""
    return _without(best.fit, len(best.fit.z) - len(best.effect.parameters), len(best.effect.parameters))


def _without(fit: Fit, column: int, count: int) -> Fit:
    """The point of a fit without `count` of its parameters."""
    gone = np.arange(column, column + count)
    return Fit(np.delete(fit.z, gone), fit.residual, np.delete(fit.jacobian, gone, axis=1))


def _exact(problem: Problem, acting: list[Acting], start: np.ndarray | None = None) -> Fit | None:
    """A fit in full, None where the model does not run at its start."""
    return problem.calibrate_each([(acting, start)])[0]


def _each(
    problem: Problem,
    acting: list[Acting],
    candidates: list[Candidate],
    about: Fit,
    least: float = -np.inf,
    without: float = -np.inf,
) -> list[Fit | None]:
    """Fits of candidates beside other effects, from a point and their own guesses: with the sensitivities there, and
    then, where they weigh more than `least`, in full; without: log evidence of the other effects alone, by which those
    that went astray are known and fitted from other points."""
    found = problem.fit_roughly(about, acting, [c.acting for c in candidates], [c.guess for c in candidates])
    weights = [-np.inf if fit is None else fit.evidence + c.log_prior for c, fit in zip(candidates, found, strict=True)]
    close = [i for i, weight in enumerate(weights) if weight > least]
    exact = problem.calibrate_each([([*acting, candidates[i].acting], found[i].z) for i in close])
    for i, fit in zip(close, exact, strict=True):
        found[i] = fit or found[i]
    tried = [replace(candidate, fit=fit) for candidate, fit in zip(candidates, found, strict=True)]
    refit(problem, acting, lost(tried, least, without))
    return [candidate.fit for candidate in tried]


def correct(problem: Problem, acting: list[Acting], fit: Fit, rounds: list[Round]) -> tuple[Problem, list[Acting], Fit]:
    """Put the time steps right about the named effects; where that was much, about what competed with the last, too,
    unless something is left that another effect may explain: a look back comes after that."""
    before = problem
    problem, fit = before.corrected(acting, fit)
    if problem.missed(before.change) < RINGS or locate(problem, fit).alarm(problem.settings.alarm_level):
        return problem, acting, fit
    current = next(r for r in rounds if r.accepted is not None and r.accepted.acting == acting[-1])
    return _compete_again(before, problem, current, acting[:-1], fit)


def _compete_again(
    before: Problem, problem: Problem, current: Round, others: list[Acting], fit: Fit
) -> tuple[Problem, list[Acting], Fit]:
    """Weigh a round's candidates anew beside other effects, each with the time steps put right about itself.

    before: the problem without that; problem, fit: with that about the accepted one, whose sizes stand last. Returns
    the problem, effects and fit of what is accepted now: nothing beside the others where the odds do not suffice.
    """
    present = replace(current.accepted, fit=fit)
    problems = {present.acting: problem}
    least = present.log_weight - CONTENDER
    best, tried = _weighed(problem, current, present, others, _around(present), least, problems)
    plain, without = before, _exact(before, others)
    if without is not None:
        plain, without = before.corrected(others, without)
    _decide(current, best, tried, -np.inf if without is None else without.evidence, others)
    if without is not None and of_class(best, tried) - without.evidence < problem.settings.least_log_odds:
        current.accepted = None
        return plain, others, without
    return problems.get(best.acting, problem), [*others, best.acting], best.fit


def _weighed(
    problem: Problem,
    current: Round,
    present: Candidate,
    others: list[Acting],
    about: Fit,
    least: float,
    problems: dict[Acting, Problem] | None = None,
    without: float = -np.inf,
) -> tuple[Candidate, list[Candidate]]:
    """The best, and all fitted by weight, of a round's present candidate and what promises more than `least`.

    Where an effect that the round knew beside it has been replaced, all its candidates are looked at anew, not only
    those that were likely then.

    about: the point of the present one's fit without its own sizes; problems: gets those that have the time steps put
    right about each of the ones that are fitted in full; None: the time steps stay as they are. without: log evidence
    of the others alone.
    """
    replaced = any(one not in others for one in current.beside)
    pool = current.screened if replaced else likely(current.screened)
    rivals = [replace(c, fit=None) for c in pool if c.acting not in (*others, present.acting)]
    screen(problem, about, others, rivals)
    rivals = sorted((c for c in rivals if c.promise > least), key=lambda c: -c.promise)
    first = rivals[:RIVALS]
    for rival, its in zip(first, _each(problem, others, first, about, least, without), strict=True):
        rival.fit = its
    if problems is not None:
        close = [rival for rival in first if rival.log_weight > least]
        found = problem.corrected_each([([*others, rival.acting], rival.fit) for rival in close])
        for rival, (its, fit) in zip(close, found, strict=True):
            problems[rival.acting], rival.fit = its, fit
    # Of a large class, every pair of outlets perhaps, the sensitivities hardly differ from the present one's.
    members = {member.acting for member in current.members}
    ahead = max([present, *(c for c in rivals if c.fit is not None)], key=lambda c: c.log_weight)
    alike = [c for c in rivals[RIVALS:] if c.acting in members or _may_be_alike(c, ahead)]
    found = problem.fit_roughly(about, others, [c.acting for c in alike], [c.guess for c in alike])
    for rival, its in zip(alike, found, strict=True):
        rival.fit = its
    tried = sorted([present, *(c for c in rivals if c.fit is not None)], key=lambda c: -c.log_weight)
    best = preferred(tried)
    if best in alike:
        best.fit = _exact(problem, [*others, best.acting], best.fit.z) or best.fit
    return best, tried


def _decide(current: Round, best: Candidate, tried: list[Candidate], without: float, others: list[Acting]) -> None:
    """Let a round have another outcome, beside other effects; without: log evidence of those alone."""
    current.probabilities = posterior(without, tried, current.outside_evidence)
    current.shortlist, current.beside = tried, others
    current.accepted, current.members = best, indistinguishable(best, tried)


def look_back(problem: Problem, acting: list[Acting], fit: Fit, rounds: list[Round]) -> tuple[list[Acting], Fit]:
    """Ask again whether each earlier effect is needed, whether another candidate would now do better, and which ones
    the data cannot tell from it now: its round's fits knew nothing of the later effects."""
    accepted = {r.accepted.acting: r for r in rounds if r.accepted is not None}
    column = len(problem.forward.nuisances)
    for number in range(len(acting) - 1):
        current = accepted[acting[number]]
        count = len(acting[number][0].parameters)
        others = acting[:number] + acting[number + 1 :]
        about = _without(fit, column, count)
        present = replace(current.accepted, fit=_last(fit, column, count))
        column += count
        without = _exact(problem, others)
        if without is None:
            continue
        # Other effects may have grown by then: what a rival promises is as rough as on the first shortlist.
        least = least_weight(present, without)
        best, tried = _weighed(problem, current, present, others, about, least, without=without.evidence)
        if of_class(best, tried) - without.evidence < problem.settings.least_log_odds:
            current.accepted = None
            return others, without
        _decide(current, best, tried, without.evidence, others)
        if best is not present:
            return [*others, best.acting], best.fit
    return acting, fit


def _last(fit: Fit, column: int, count: int) -> Fit:
    """The same fit with `count` of its parameters moved to the end."""
    order = np.r_[0:column, column + count : len(fit.z), column : column + count]
    return Fit(fit.z[order], fit.residual, fit.jacobian[:, order])
