"""The whole search on one case: locate, name, add, verify, until nothing is left to explain or nothing helps."""

from dataclasses import dataclass, field

import numpy as np

from coronaryuq.discrepancy import outside
from coronaryuq.discrepancy.candidates import (
    CONTENDER,
    ROUGH,
    Candidate,
    all_candidates,
    fit_shortlist,
    indistinguishable,
    posterior,
    screen,
    shortlist,
)
from coronaryuq.discrepancy.forward import Acting
from coronaryuq.discrepancy.inference import Fit
from coronaryuq.discrepancy.locate import Located, locate
from coronaryuq.discrepancy.problem import Problem
from coronaryuq.discrepancy.verify import Gap, folds, gap, linearise
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.library import LIBRARY

RIVALS = 5
"""Runners-up of an earlier round that a look back tries in the place of what was accepted."""
WORTH = 0.2
"""Held-out log predictive density per row that named effects must add to a flexible discrepancy to be named beside it.

Effects outside the library that the benchmark hides add up to 0.06; compression in recorded coronary flow 0.5 to 1."""


@dataclass
class Round:
    """One round of naming: everything on the shortlist, and what was accepted (None: nothing helped enough)."""

    shortlist: list[Candidate]
    probabilities: dict[str, float]
    accepted: Candidate | None
    members: list[Candidate] = field(default_factory=list)
    """Accepted one and those that the data cannot tell from it."""
    worth: float = np.inf
    """Log evidence that the accepted effect adds to all the others."""


@dataclass
class Discovery:
    """What a search found. acting: the named effects, in order; fit: their joint fit; base: the model without any."""

    problem: Problem
    base: Fit
    located: Located
    alarm: bool
    rounds: list[Round]
    acting: list[Acting]
    fit: Fit
    remaining: Located
    outside_library: bool
    before: Gap
    after: Gap
    flexible: Gap
    both: Gap
    folds: list
    candidates_tested: int = 0

    @property
    def named(self) -> list[Round]:
        """Rounds that named an effect, the one worth most first; none where the effect is outside the library."""
        kept = [] if self.outside_library else [r for r in self.rounds if r.accepted is not None]
        return sorted(kept, key=lambda r: -r.worth)


def discover(problem: Problem, seed: int, library: tuple[Effect, ...] = LIBRARY) -> Discovery:
    """Search one problem. `seed` only enters the bootstrap intervals of the gaps."""
    settings = problem.settings
    base = fit = problem.calibrate([])
    acting: list[Acting] = []
    located, everything = assess(problem, fit, acting, library)
    remaining, alarm = located, located.alarm(settings.alarm_level)
    rounds: list[Round] = []
    features = outside.features(problem)
    tested = len(everything)
    while remaining.alarm(settings.alarm_level) and len(acting) < settings.max_effects:
        found = name_one(problem, fit, acting, features, everything)
        rounds.append(found)
        if found.accepted is None:
            break
        acting = [*acting, found.accepted.acting]
        fit = found.accepted.fit
        for _ in range(len(acting) - 1):
            before = acting
            acting, fit = look_back(problem, acting, fit, rounds)
            if acting == before:
                break
        remaining, everything = assess(problem, fit, acting, library)
        tested += len(everything)
    if len(acting) > 1:
        for entry in (r for r in rounds if r.accepted is not None):
            others = [one for one in acting if one != entry.accepted.acting]
            entry.worth = fit.evidence - problem.calibrate(others).evidence
    parts = folds(problem, [name for name, c in problem.forward.conditions.items() if c.held_out])
    plain = linearise(problem, base.z, [])
    repaired = linearise(problem, fit.z, acting) if acting else plain
    before, after = gap(problem, plain, parts, seed), gap(problem, repaired, parts, seed)
    _, amplitude = outside.gain(base, features[problem.train])
    flexible = gap(problem, plain.extended(amplitude * features), parts, seed)
    _, amplitude = outside.gain(fit, features[problem.train])
    both = gap(problem, repaired.extended(amplitude * features), parts, seed) if acting else flexible
    abstained = alarm and _outside(remaining.alarm(settings.alarm_level), after, flexible, both)
    return Discovery(
        problem=problem,
        base=base,
        located=located,
        alarm=alarm,
        rounds=rounds,
        acting=acting,
        fit=fit,
        remaining=remaining,
        outside_library=abstained,
        before=before,
        after=after,
        flexible=flexible,
        both=both,
        folds=parts,
        candidates_tested=tested,
    )


def assess(
    problem: Problem, fit: Fit, acting: list[Acting], library: tuple[Effect, ...] = LIBRARY
) -> tuple[Located, list[Candidate]]:
    """Locate what disagrees and score every candidate; the global test counts the best of them (Bonferroni)."""
    everything = all_candidates(problem, acting, library)
    screen(problem, fit, acting, everything)
    located = locate(problem, fit)
    directed = min((c.p_value for c in everything), default=1.0) * max(len(everything), 1)
    return located.with_test("best candidate", directed), everything


def name_one(
    problem: Problem, fit: Fit, acting: list[Acting], features: np.ndarray, everything: list[Candidate]
) -> Round:
    """One round: fit the shortlist of scored candidates, weigh, accept the best where the odds suffice."""
    chosen = shortlist(everything, problem.settings.shortlist)
    fit_shortlist(problem, fit, acting, chosen)
    chosen = [c for c in chosen if c.fit is not None]
    flexible, _ = outside.gain(fit, features[problem.train])
    probabilities = posterior(fit, chosen, flexible)
    chosen.sort(key=lambda c: -c.log_weight)
    if not chosen or chosen[0].log_weight - fit.evidence < problem.settings.least_log_odds:
        return Round(chosen, probabilities, None)
    return Round(chosen, probabilities, chosen[0], indistinguishable(chosen[0], chosen))


def look_back(problem: Problem, acting: list[Acting], fit: Fit, rounds: list[Round]) -> tuple[list[Acting], Fit]:
    """Ask again whether each earlier effect is needed, and whether a runner-up of its round would now do better."""
    accepted = [r for r in rounds if r.accepted is not None]
    for number in range(len(acting) - 1):
        current = accepted[number]
        others = acting[:number] + acting[number + 1 :]
        rivals = [c for c in current.shortlist if c.acting not in acting][:RIVALS]
        options: list[tuple[float, Candidate | None, Fit]] = [
            (fit.evidence + current.accepted.log_prior, current.accepted, fit)
        ]
        without = problem.calibrate(others)
        options.append((without.evidence, None, without))
        trials = problem.fit_candidates(without, others, [r.acting for r in rivals], [r.guess for r in rivals])
        tried = [(rival, trial) for rival, trial in zip(rivals, trials, strict=True) if trial is not None]
        near = CONTENDER + ROUGH * max(0.0, fit.evidence - without.evidence)
        for rival, trial in tried:
            if trial.evidence + rival.log_prior > options[0][0] - near:
                exact = problem.calibrate([*others, rival.acting], trial.z)
                options.append((exact.evidence + rival.log_prior, rival, exact))
        _, best, found = max(options, key=lambda option: option[0])
        if best is current.accepted:
            continue
        if best is None:
            current.accepted = None
            return others, without
        # Its round's other fits knew nothing of the later effects: they are no class of it, and its probability is that
        # among what was tried here.
        weights = np.exp([weight - max(o[0] for o in options) for weight, _, _ in options])
        best.probability = float(weights.max() / weights.sum())
        current.accepted, current.members = best, [best]
        # The rival's sizes stand last in its fit; keep the order of places in step with it.
        accepted.append(accepted.pop(number))
        return [*others, best.acting], found
    return acting, fit


def _outside(still: bool, after: Gap, flexible: Gap, both: Gap) -> bool:
    """True when the named effects leave something, and a flexible discrepancy does without them.

    It does where it predicts held-out data clearly better than the named effects, and where their company does not
    clearly help it: by `WORTH` nats per row and two standard errors at least.
    """
    if not still or not _better(flexible, after, 0.5):
        return False
    return not (_better(both, flexible, 2.0) and both.lpd - flexible.lpd > WORTH)


def _better(one: Gap, other: Gap, errors: float) -> bool:
    """Whether held-out density is higher by 3 nats and by so many standard errors, rows grouped in eights."""
    difference = 0.5 * (other.residual**2 - one.residual**2)
    blocks = np.array([part.sum() for part in np.array_split(difference, max(2, len(difference) // 8))])
    error = np.sqrt(len(blocks) * blocks.var(ddof=1))
    return one.total_lpd - other.total_lpd > max(3.0, errors * error)
