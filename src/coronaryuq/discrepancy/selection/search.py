"""The search for a missing effect: locate, forward and backward steps, confirmation, answer.

`discover` estimates the noise and calls `search_without_confounder`, which calls `_search`: assess the candidates, add
effects by forward steps (each with backward steps and the time-step correction), confirm them by all data, weigh
the answers.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from coronaryuq.discrepancy.data.conditions import held_out_names
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference.cross_validation import Folds, Gaps, evidence_of_all, folds_of, held_out
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import Located, locate
from coronaryuq.discrepancy.inference.noise import TOO_LOUD, most_probable
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.selection import observed_noise
from coronaryuq.discrepancy.selection.answer import ALONE, MISWIRED, OTHER, SOURCE, answer, beyond, without_effects
from coronaryuq.discrepancy.selection.backward_step import backward_step, correct_time_steps
from coronaryuq.discrepancy.selection.candidates import (
    Candidate,
    Rounds,
    all_candidates,
    best_of_effects,
    least_log_odds,
    updated,
)
from coronaryuq.discrepancy.selection.confirmation import confirm
from coronaryuq.discrepancy.selection.discovery import Discovery
from coronaryuq.discrepancy.selection.forward_step import forward_step
from coronaryuq.discrepancy.selection.observed_noise import OtherNoise, observe, watch
from coronaryuq.discrepancy.selection.pair_step import pair_step
from coronaryuq.discrepancy.selection.refit import fit_each, with_own_time_steps
from coronaryuq.discrepancy.selection.score_test import screen
from coronaryuq.discrepancy.selection.unknown_source import source_changes, unknown_source
from coronaryuq.zerod.effects.base import Effect
from coronaryuq.zerod.effects.library import SEARCHED

Report = Callable[[str], None]
Library = tuple[Effect, ...]
Search = Callable[[Problem, int, Library, Report], Discovery]

CONFOUNDER = "drive_gain"
"""The effect that acts on all readings: errors of several readings at first resemble it, each alone less so."""
NOISE_ESTIMATES = 3
"""Maximum number of estimates of the noise: about the model alone, then about the effects found with the last one."""
Watch = Callable[[Problem, Hypothesis, Fit], None]
"""Called with the effects found so far, and their fit; raises `OtherNoise` to end a search."""


def discover(problem: Problem, seed: int, library: Library = SEARCHED, report: Report = lambda line: None) -> Discovery:
    """Search for the effects that a model is missing.

    The noise of the waveforms is estimated before the search, and again about each effect found, whose sharp features
    had looked like noise; if it is another, the search begins again. Noise of more than `TOO_LOUD` times the stated
    size may be an effect in all waveforms: the data are then searched with the stated noise as well, and what that
    names stands if its evidence, averaged over the same noises, is larger.

    Parameters
    ----------
    problem
        Measurements, model and settings, as `read_problem` returns them.
    seed
        Seed of the bootstrap intervals of the held-out misfits; nothing else is random.
    library
        Effects to consider.
    report
        Called with a line of text at each step.

    Returns
    -------
    Discovery
        The answer, whether or not an effect is named.

    Raises
    ------
    FloatingPointError
        If the model without any effect does not run under every condition.
    """
    if problem.settings.noise == "stated":
        return search_without_confounder(_search, problem, seed, library, report)
    report("recalibrating, to see the noise")
    if uneven := observed_noise.uneven_noise(problem):
        report(f"noise over its stated size is larger than under other conditions: {', '.join(uneven)}")
        problem = observed_noise.with_uneven_noise(problem, uneven)
    observed = observe(problem, PLAIN, problem.recalibrated)
    for last in (*(False,) * (NOISE_ESTIMATES - 1), True):
        known = observed_noise.with_observed_noise(problem, observed, report)
        search = _search if last else partial(_search, watch=partial(watch, problem, observed))
        try:
            found = search_without_confounder(search, known, seed, library, report)
            break
        except OtherNoise as other:
            observed = other.observed
            report(f"given {_listed(other.hypothesis)}, the noise is another: searching again with it")
    if any(estimate.scale > TOO_LOUD for estimate in observed.estimates.values()):
        report("so much noise may be none: searching with the stated noise as well")
        known = observed_noise.with_observed_noise(problem, observed.stated, report)
        stated = search_without_confounder(_search, known, seed, library, report)
        if stated.named and stated.log_evidence > found.log_evidence:
            observed, found = observed.stated, stated
    noise, measured = most_probable(observed.estimates), problem.forward.measured
    return replace(found, measured=measured, uneven=uneven, noise=noise, outliers=observed.outliers)


def search_without_confounder(
    search: Search, problem: Problem, seed: int, library: Library, report: Report
) -> Discovery:
    """Search, and repeat without an effect that is easily confused with others; return the likelier answer.

    Such effects are a named `CONFOUNDER` and an implausibly large measurement error.
    """
    first = search(problem, seed, library, report)
    named = [placed.effect for placed in first.hypothesis if placed.effect.name == CONFOUNDER]
    implausible = [placed.effect for placed in first.answer.implausible if placed.effect.is_measurement_error]
    if not (named or implausible):
        return first
    doubtful = (named + implausible)[0].name
    report(f"{doubtful} may stand in for other effects: searching again without it")
    second = search(problem, seed, tuple(effect for effect in library if effect.name != doubtful), report)
    return second if second.log_evidence > first.log_evidence else first


def _search(
    problem: Problem, seed: int, library: Library, report: Report, watch: Watch = lambda *found: None
) -> Discovery:
    """Search once, with the problem's noise and all effects of a library."""
    report(f"{np.count_nonzero(problem.train)} fitted measurements, {problem.count} nuisance parameters: recalibrating")
    base_problem, base = recalibrate(problem)
    folds = folds_of(base_problem, held_out_names(base_problem.forward.conditions))
    plain = evidence_of_all(base_problem, base, PLAIN)
    nothing, something = without_effects(plain)
    state = start = replace(_State.assessed(base_problem, PLAIN, base, library), suspected=something > nothing)
    report(_progress(start))
    state = _select(state, library, report, watch)
    for _ in range(RULE.further_searches):
        state, confirmed = _check(state, library, report)
        if confirmed:
            break
        watch(state.problem, state.hypothesis, state.fit)
        before, state = state, _select(state, library, report, watch)
        if state.implausible and not before.implausible:
            report("rejected: implausibly large")
            state = before
            break
    else:
        state, _ = _check(state, library, report)
    gaps, p = _held_out(base_problem, base, state, folds, seed)
    accepted = {entry.named.placed: entry for entry in state.rounds if entry.accepted is not None}
    priors = [accepted[placed].class_log_prior for placed in state.hypothesis]
    possible = list({candidate.effect.name: candidate.effect for candidate in start.candidates}.values())
    rivals = {error: odds for placed in state.hypothesis for error, odds in accepted[placed].wiring_errors.items()}
    changes = source_changes(base_problem, base.z, PLAIN) if start.alarm or state.hypothesis else None
    weighed = answer(state.problem, plain, state.fit, state.hypothesis, priors, possible, rivals, changes)
    sought = weighed.given == OTHER and weighed.leading_form != MISWIRED
    # Where the effects found are taken to be something else themselves, the source stands in for them.
    alone = weighed.leading_form in (ALONE, SOURCE)
    seen = (base_problem, base.z, PLAIN) if alone else (state.problem, state.fit.z, state.hypothesis)
    nodes, source = unknown_source(*seen, (changes if alone else source_changes(*seen)) if changes and sought else {})
    return Discovery(
        base_problem=base_problem,
        base=base,
        problem=state.problem,
        hypothesis=state.hypothesis,
        fit=state.fit,
        located=start.remaining,
        alarm=start.remaining.alarm(problem.settings.alarm_level),
        remaining=state.remaining,
        rounds=state.rounds,
        gaps=gaps,
        answer=weighed,
        held_out_p=p,
        folds=folds,
        measured=problem.forward.measured,
        candidates=start.candidates,
        candidates_tested=state.tested,
        nodes=nodes,
        source=source,
    )


@dataclass(frozen=True, eq=False)
class _State:
    """State of a search.

    remaining: misfit of the fit; candidates: scored in addition to it; tested: number of candidates scored so far;
    refused: those that are not considered again; suspected: whether all data make it probable that something is missing
    from the model without effects.
    """

    problem: Problem
    hypothesis: Hypothesis
    fit: Fit
    remaining: Located
    candidates: list[Candidate]
    tested: int
    rounds: Rounds = ()
    refused: frozenset[PlacedEffect] = frozenset()
    suspected: bool = False

    @classmethod
    def assessed(cls, problem: Problem, hypothesis: Hypothesis, fit: Fit, library: Library) -> "_State":
        remaining, candidates = assess(problem, fit, hypothesis, library)
        return cls(problem, hypothesis, fit, remaining, candidates, len(candidates))

    @property
    def alarm(self) -> bool:
        """Whether the global test finds a misfit or, without effects, all data make one probable."""
        return (self.suspected and not self.hypothesis) or self.remaining.alarm(self.problem.settings.alarm_level)

    @property
    def implausible(self) -> bool:
        return bool(beyond(self.fit, self.hypothesis, RULE.implausible))

    def reassessed(self, library: Library) -> "_State":
        remaining, candidates = assess(self.problem, self.fit, self.hypothesis, library, self.candidates)
        return replace(self, remaining=remaining, candidates=candidates)

    def converged(self) -> "_State":
        return replace(self, fit=self.problem.converge(self.hypothesis, self.fit))

    def without_refuted(self) -> "_State":
        """Drop the classes of all refuted effects from the candidates of this and earlier rounds."""
        members = {c.placed for entry in self.rounds if entry.refuted is not None for c in entry.members}
        refused = self.refused | members
        rounds = tuple(
            replace(entry, scored=[c for c in entry.scored if c.placed not in refused]) for entry in self.rounds
        )
        return replace(self, refused=refused, rounds=rounds)


def _select(state: _State, library: Library, report: Report, watch: Watch) -> _State:
    """Add one effect after the other until no misfit remains or no effect helps."""
    settings = state.problem.settings
    # Twice as many rounds as effects, in case backward steps repeatedly undo what was named.
    most = len(state.rounds) + 2 * settings.max_effects
    while state.alarm and len(state.hypothesis) < settings.max_effects and len(state.rounds) < most:
        candidates = [c for c in state.candidates if c.placed not in state.refused]
        least = least_log_odds(state.problem, state.hypothesis)
        point = state.problem.linearisation_point(state.fit, state.hypothesis)
        step = forward_step(state.problem, state.fit, state.hypothesis, candidates, point, least)
        state = replace(state, rounds=(*state.rounds, step))
        if step.accepted is None:
            report(f"no {'further ' * bool(len(state.hypothesis))}candidate is worth naming")
            break
        state = replace(state, hypothesis=state.hypothesis.with_(step.accepted.placed), fit=step.accepted.fitted)
        if state.problem.unresolved:
            problem, fit = state.problem.corrected(state.hypothesis, state.fit)
            state = replace(state, problem=problem, fit=fit)
        report(f"best: {_listed(state.hypothesis)}")
        recent = 1
        for _ in range(len(state.hypothesis)):
            before = state.hypothesis
            hypothesis, fit, rounds = backward_step(state.problem, before, state.fit, state.rounds, recent)
            state = replace(state, hypothesis=hypothesis, fit=fit, rounds=rounds)
            if hypothesis == before:
                break
            # Classes were found beside an effect that is gone.
            recent *= len(hypothesis) == len(before)
        state = _with_better_pair(state, report)
        count = len(state.hypothesis)
        problem, hypothesis, fit, rounds = correct_time_steps(state.problem, state.hypothesis, state.fit, state.rounds)
        watch(problem, hypothesis, fit)
        state = replace(state, problem=problem, hypothesis=hypothesis, fit=fit, rounds=rounds).reassessed(library)
        state = replace(state, tested=state.tested + len(state.candidates))
        report(f"given {_listed(hypothesis)}: {_progress(state)}")
        if len(hypothesis) < count:
            report("the last effect was an artefact of the time step; removed")
            break
    if state.hypothesis:
        state = state.converged()
        # The tests of the candidates, which a converged fit does not repeat, are kept.
        state = replace(state, remaining=locate(state.problem, state.fit).with_tests(state.remaining.tests))
    return state


def _with_better_pair(state: _State, report: Report) -> _State:
    """Replace two effects by a pair that is more probable, if there is one."""
    candidates = [c for c in state.candidates if c.placed not in state.refused]
    for removed in combinations(state.hypothesis, 2):
        found = pair_step(state.problem, state.hypothesis, state.fit, state.rounds, removed, candidates)
        if found[0] != state.hypothesis:
            report(f"together better: {_listed(found[0])}")
            hypothesis, fit, rounds = backward_step(state.problem, *found, recent=0)
            return replace(state, hypothesis=hypothesis, fit=fit, rounds=rounds)
    return state


def _check(state: _State, library: Library, report: Report) -> tuple[_State, bool]:
    """Remove effects that the data, held-out ones included, do not confirm; return whether they confirm all.

    A refuted effect, with its class, is not considered again: it may have hidden one that the data confirm.
    """
    report("checking each effect by all data")
    hypothesis, fit, rounds = confirm(state.problem, state.hypothesis, state.fit, state.rounds)
    if len(hypothesis) == len(state.hypothesis):
        return replace(state, hypothesis=hypothesis, fit=fit, rounds=rounds), True
    report(f"all data confirm only {_listed(hypothesis)}")
    problem, fit = state.problem.corrected(hypothesis, fit)
    # Classes were found beside an effect that is gone.
    hypothesis, fit, rounds = backward_step(problem, hypothesis, fit, rounds, recent=0)
    state = replace(state, problem=problem, hypothesis=hypothesis, fit=fit, rounds=rounds)
    return state.converged().reassessed(library).without_refuted(), False


def _held_out(base_problem: Problem, base: Fit, state: _State, folds: Folds, seed: int) -> tuple[Gaps, float]:
    """Return the held-out misfits and the p-value of the held-out data under the best hypothesis."""
    before, flexible, p = held_out(base_problem, base, PLAIN, folds, seed)
    after, both = before, flexible
    if state.hypothesis:
        after, both, p = held_out(state.problem, state.fit, state.hypothesis, folds, seed)
    return Gaps(before, after, flexible, both), p


def _progress(state: _State) -> str:
    outcome = "something is missing" if state.alarm else "nothing to explain"
    return f"{len(state.candidates)} candidates tested; {outcome} (global test p = {state.remaining.p:.1g})"


def _listed(effects: Iterable[PlacedEffect]) -> str:
    return " and ".join(f"{effect.name} at {place}" for effect, place in effects) or "nothing"


def recalibrate(problem: Problem) -> tuple[Problem, Fit]:
    """Fit the model without any effect, with the time-step error corrected at that fit.

    Parameters
    ----------
    problem
        Measurements and model.

    Returns
    -------
    problem, fit
        The problem with its correction, and the fit.

    Raises
    ------
    FloatingPointError
        If the model does not run at the prior's mean.
    """
    return problem.corrected(PLAIN, problem.recalibrated)


def assess(
    problem: Problem, fit: Fit, hypothesis: Hypothesis, library: Library = SEARCHED, earlier: Iterable[Candidate] = ()
) -> tuple[Located, list[Candidate]]:
    """Locate the misfit and score every candidate about a fit; the global test includes the best of them (Bonferroni).

    earlier: candidates of an earlier round, whose responses may be reused.
    """
    known = {c.placed: c.response for c in earlier}
    candidates = [replace(c, response=known.get(c.placed)) for c in all_candidates(problem, hypothesis, library)]
    candidates = screen(problem, fit, hypothesis, candidates)
    p_values = {
        "best candidate": [c.p_value for c in candidates],
        "best candidate of varying size": [c.p_varying for c in candidates],
    }
    located = locate(problem, fit).with_tests({name: min(p, default=1.0) * len(p) for name, p in p_values.items()})
    if not located.alarm(problem.settings.alarm_level):
        evidence_p = evidence_p_value(problem, fit, hypothesis, candidates)
        located = located.with_tests({"likeliest candidates, fitted": evidence_p})
    return located, candidates


def evidence_p_value(problem: Problem, fit: Fit, hypothesis: Hypothesis, candidates: list[Candidate]) -> float:
    """Return the p-value of the evidence for the most promising effects, each at its best place.

    A score test does not detect the combined change by recalibration and size, as of a narrowed valve and a stronger
    ventricle. If nothing is missing, the Bayes factor of all candidates together, weighted by their priors, exceeds 1 /
    p with a probability of p at most (Markov's inequality; Vovk & Wang 2021); those not fitted count as zero.
    """
    likeliest = best_of_effects(sorted(candidates, key=lambda c: -c.promise), RULE.likeliest_effects)
    fitted = [c for c in fit_each(problem, hypothesis, likeliest, fit) if c.fit is not None]
    # Where the loop oscillates, drawing the errors again takes as long as all else; the likeliest outweighs the others.
    best = max([fit.evidence, *(c.fitted.evidence for c in fitted)])
    worth = [c for c in fitted if fit.evidence < c.fitted.evidence == best or not problem.unresolved]
    fitted = updated(fitted, with_own_time_steps(problem, hypothesis, worth))
    factors = [c.log_weight - np.log(RULE.prior_named) - fit.evidence for c in fitted]
    return float(np.exp(-max(logsumexp([-np.inf, *factors]), 0.0)))
