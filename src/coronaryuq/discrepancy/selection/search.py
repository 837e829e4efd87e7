"""The whole search on one case: locate, name, add, verify, until nothing is left to explain or nothing helps."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from coronaryuq.discrepancy.data.conditions import kept_out
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, Hypothesis, PlacedEffect
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.cross_validation import folds, foretold, gap, linearise
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.locate import Located, locate
from coronaryuq.discrepancy.inference.noise import Noise, estimated_noise, told, with_lasting
from coronaryuq.discrepancy.inference.outliers import Spike, spikes
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.read_problem import with_noise
from coronaryuq.discrepancy.selection.abstention import CENTRAL_99, FAR_OUT, Gaps, Verdict, far_out, judge
from coronaryuq.discrepancy.selection.backward_step import correct, look_back
from coronaryuq.discrepancy.selection.candidates import PRIOR_NAMED, Candidate, all_candidates, best_of_effects
from coronaryuq.discrepancy.selection.forward_step import Round, name_one
from coronaryuq.discrepancy.selection.held_out_check import borne_out
from coronaryuq.discrepancy.selection.refit import LIKELIEST, by_own_steps, fit_each
from coronaryuq.discrepancy.selection.score_test import screen
from coronaryuq.zerod.effects.base import Effect, Parameter
from coronaryuq.zerod.effects.library import SEARCHED

Report = Callable[[str], None]

CULPRIT = "drive_gain"
"""The effect that all readings follow: several of them that are off look like it at first, each alone less so."""
FURTHER = 2
"""How many times a search goes on after effects that held-out measurements do not bear out."""
LARGEST_LOG = 500.0
"""Log Bayes factor beyond which its size is of no matter."""


@dataclass
class Discovery:
    """What a search found. hypothesis: the effects that come nearest, in order, whether or not they are named; fit:
    their joint fit; base: the model without any.

    plain, problem: with the time steps put right about the model as it is, and about the named effects. given: the
    measurements as they are; scattered: what their waveforms say of their noise, about all that came nearest; noise: of
    waveforms, by quantity, where it is not taken to be what their standard deviations say; spikes: samples that stand
    out alone.
    """

    plain: Problem
    problem: Problem
    base: Fit
    located: Located
    alarm: bool
    rounds: list[Round]
    hypothesis: Hypothesis
    fit: Fit
    remaining: Located
    gaps: Gaps
    verdict: Verdict
    folds: list
    given: list[Measured]
    scattered: dict[str, Noise]
    candidates_tested: int = 0
    noise: dict[str, Noise] = field(default_factory=dict)
    spikes: list[Spike] = field(default_factory=list)

    @property
    def outside_library(self) -> bool:
        """Whether something is missing that the library does not have: nothing is named then."""
        return self.alarm and self.verdict.abstains

    @property
    def named(self) -> list[Round]:
        """Rounds that named an effect, the one worth most first; none where the effect is outside the library."""
        kept = [] if self.outside_library else [r for r in self.rounds if r.accepted is not None]
        return sorted(kept, key=lambda r: -r.worth)

    @property
    def not_borne_out(self) -> list[PlacedEffect]:
        """Effects that the fitted measurements ask for beside the named ones, and those kept out of the fits do not."""
        return [entry.taken_back.placed for entry in self.rounds if entry.taken_back is not None]

    @property
    def log_weight(self) -> float:
        """Of what comes nearest: log evidence, with its share of the prior, and log predictive density of what was kept
        out of the fits; where no condition is, that would count the fitted measurements twice."""
        priors = {r.accepted.placed: r.class_log_prior for r in self.rounds if r.accepted is not None}
        held_out = self.gaps.after.total_lpd if kept_out(self.problem.forward.conditions) else 0.0
        return self.fit.evidence + sum(priors[one] for one in self.hypothesis) + held_out

    def beyond_prior(self, one: PlacedEffect) -> list[Parameter]:
        """Sizes of a named effect that lie outside the central 99 % of their prior: it may stand for something else."""
        return [parameter for parameter, z, _ in self.sizes(one) if abs(z) > CENTRAL_99]

    @property
    def far_out(self) -> list[PlacedEffect]:
        """Those that come nearest with a size that is not to be believed."""
        return [one for one in self.hypothesis if any(abs(z) > FAR_OUT for _, z, _ in self.sizes(one))]

    def sizes(self, one: PlacedEffect) -> list[tuple[Parameter, float, float]]:
        """Sizes of an effect: each with its standard number z and the standard deviation of that."""
        columns = self.hypothesis.columns(self.fit.z, one)
        spread = np.sqrt(np.diag(self.fit.covariance))
        return list(zip(one.effect.parameters, self.fit.z[columns], spread[columns], strict=True))


def discover(
    problem: Problem, seed: int, library: tuple[Effect, ...] = SEARCHED, report: Report = lambda line: None
) -> Discovery:
    """Search one problem. `seed` only enters the bootstrap intervals of the gaps; report: gets a line at each step.

    Where something is missing and waveforms scatter more than their standard deviations say, what was found is judged
    by the wrong measure, and so it is where something stays unexplained and they scatter less, as noise that lasts
    does: the search is made again with noise as they have it, which stands if it foretells what was held out better.
    """
    found = _searched(problem, seed, library, report)
    (residual,) = found.problem.whitened([(found.fit.z, found.hypothesis)])
    # By what the table says of them: beyond lasting noise the model's own corners are sharp, too.
    off = residual * found.problem.sd / with_lasting(found.problem)
    return replace(found, spikes=spikes(found.problem, off))


def _searched(problem: Problem, seed: int, library: tuple[Effect, ...], report: Report) -> Discovery:
    """A search, and another one where waveforms have other noise than is said."""
    found = _with_and_without(problem, seed, library, report)
    noise = found.scattered if found.alarm and problem.settings.noise == "estimated" else {}
    if not found.outside_library and not found.remaining.alarm(problem.settings.alarm_level):
        noise = {quantity: one for quantity, one in noise.items() if one.lasting == 0.0}
    if not noise:
        return found
    report(f"waveforms scatter otherwise than their standard deviations say ({told(noise)}): searching again so")
    again = _with_and_without(with_noise(problem, noise), seed, library, report)
    if again.gaps.after.total_lpd > found.gaps.after.total_lpd:
        return replace(again, noise=noise, given=found.given)
    report("measurements kept out of the fits are foretold no better with that: noise stays as it is said")
    return found


def _with_and_without(problem: Problem, seed: int, library: tuple[Effect, ...], report: Report) -> Discovery:
    """One search, and another one without an effect that is easily taken for others: which of the two all measurements
    make likelier stands. Such are a named `CULPRIT`, and an instrument's error of a size that nobody has."""
    found = _search(problem, seed, library, report)
    named = [entry.accepted.effect for entry in found.named if entry.accepted.effect.name == CULPRIT]
    far = [placed.effect for placed in found.far_out if placed.effect.is_measurement_error]
    if not (named or far):
        return found
    doubtful = (named + far)[0].name
    report(f"{doubtful} may stand for others: searching again without it")
    other = _search(problem, seed, tuple(one for one in library if one.name != doubtful), report)
    return other if other.log_weight > found.log_weight else found


def _search(problem: Problem, seed: int, library: tuple[Effect, ...], report: Report) -> Discovery:
    """One search with standard deviations as they are."""
    settings, given = problem.settings, problem.forward.measured
    report(f"{np.count_nonzero(problem.train)} fitted measurements, {problem.count} nuisance parameters: recalibrating")
    plain, base = recalibrate(problem)
    located, everything, vantage = assess(plain, base, PLAIN, library)
    alarm = located.alarm(settings.alarm_level)
    report(_told(everything, located, alarm))
    features = gp_discrepancy.features(plain)
    parts = folds(plain, kept_out(plain.forward.conditions))
    at = _Standing(plain, base, located, everything, vantage, len(everything))
    _name(at, features, library, report)
    scattered = estimated_noise(at.problem, at.fit)
    for _ in range(FURTHER):
        if _take_back(at, parts, library, seed, report):
            break
        before = at.copy()
        _name(at, features, library, report)
        if at.far_out and not before.far_out:
            report("with a size that nobody has: that stays out")
            at = before
            break
    else:
        _take_back(at, parts, library, seed, report)
    problem, hypothesis, fit = at.problem, at.hypothesis, at.fit
    recalibrated = linearise(plain, base.z, PLAIN)
    repaired = linearise(problem, fit.z, hypothesis) if hypothesis else recalibrated
    _, amplitude = gp_discrepancy.gain(base, features[problem.train])
    process = recalibrated.extended(amplitude * features)
    _, amplitude = gp_discrepancy.gain(fit, features[problem.train])
    both = repaired.extended(amplitude * features) if hypothesis else process
    gaps = Gaps(*(gap(problem, model, parts, seed) for model in (recalibrated, repaired, process, both)))
    priors = {entry.accepted.placed: entry.class_log_prior for entry in at.rounds if entry.accepted is not None}
    effects = len({candidate.effect.name for candidate in at.everything})
    named = [(one, priors[one]) for one in hypothesis]
    verdict = judge(problem, base, fit, named, effects, at.alarm, gaps, foretold(problem, repaired, parts))
    return Discovery(
        plain,
        problem,
        base,
        located,
        alarm,
        at.rounds,
        hypothesis,
        fit,
        at.remaining,
        gaps,
        verdict,
        parts,
        given,
        scattered,
        at.tested,
    )


@dataclass
class _Standing:
    """Where a search stands: effects that act, their fit, what remains, candidates beside them and where these were
    looked at from; how many were, round by round, and those that are not asked again."""

    problem: Problem
    fit: Fit
    remaining: Located
    everything: list[Candidate]
    vantage: Fit
    tested: int
    hypothesis: Hypothesis = PLAIN
    rounds: list[Round] = field(default_factory=list)
    refused: list[PlacedEffect] = field(default_factory=list)

    @property
    def alarm(self) -> bool:
        return self.remaining.alarm(self.problem.settings.alarm_level)

    @property
    def far_out(self) -> bool:
        """Whether a size is not to be believed."""
        return far_out(self.fit, self.hypothesis, FAR_OUT)

    def copy(self) -> "_Standing":
        return replace(self, rounds=[replace(entry) for entry in self.rounds], refused=list(self.refused))

    def assess(self, library: tuple[Effect, ...]) -> None:
        self.remaining, self.everything, self.vantage = assess(
            self.problem, self.fit, self.hypothesis, library, self.everything
        )

    def to_the_end(self) -> None:
        self.fit = self.problem.to_the_end(self.hypothesis, self.fit)

    def refuse(self, candidates: list[Candidate]) -> None:
        self.refused += [candidate.placed for candidate in candidates]
        for entry in self.rounds:
            entry.screened = [candidate for candidate in entry.screened if candidate.placed not in self.refused]


def _name(at: _Standing, features: np.ndarray, library: tuple[Effect, ...], report: Report) -> None:
    """One effect after the other, until nothing is left to explain or nothing helps."""
    settings = at.problem.settings
    # Twice as many rounds as effects, should a look back undo what is named again and again.
    most = len(at.rounds) + 2 * settings.max_effects
    while at.alarm and len(at.hypothesis) < settings.max_effects and len(at.rounds) < most:
        left = [candidate for candidate in at.everything if candidate.placed not in at.refused]
        found = name_one(at.problem, at.fit, at.hypothesis, features, left, at.vantage)
        at.rounds.append(found)
        if found.accepted is None:
            report("none of them is worth naming")
            break
        at.hypothesis, at.fit = at.hypothesis.with_(found.accepted.placed), found.accepted.fit
        report(f"nearest: {_listed(at.hypothesis)}")
        for _ in range(len(at.hypothesis) - 1):
            before = at.hypothesis
            at.hypothesis, at.fit = look_back(at.problem, at.hypothesis, at.fit, at.rounds)
            if at.hypothesis == before:
                break
        wanted = len(at.hypothesis)
        at.problem, at.hypothesis, at.fit = correct(at.problem, at.hypothesis, at.fit, at.rounds)
        at.assess(library)
        at.tested += len(at.everything)
        report(f"beside {_listed(at.hypothesis)}: {_told(at.everything, at.remaining, at.alarm)}")
        if len(at.hypothesis) < wanted:
            report("the last of them was of the time steps")
            break
    if at.hypothesis:
        at.to_the_end()
        at.remaining = _located_again(at.problem, at.fit, at.remaining)


def _take_back(at: _Standing, parts: list, library: tuple[Effect, ...], seed: int, report: Report) -> bool:
    """Take back effects that measurements kept out of the fits do not bear out; whether these bear out all.

    One that they do not, with its class, is not asked again: it may have stood in the way of one that they do.
    """
    report("verifying on what was kept out of the fits")
    wanted = at.hypothesis
    at.hypothesis, at.fit = borne_out(at.problem, at.hypothesis, at.fit, at.rounds, at.alarm, parts, seed)
    if len(at.hypothesis) == len(wanted):
        return True
    report(f"those bear out {_listed(at.hypothesis)} alone")
    at.problem, at.fit = at.problem.corrected(at.hypothesis, at.fit)
    at.to_the_end()
    at.assess(library)
    for entry in at.rounds:
        if entry.taken_back is not None:
            at.refuse(entry.members)
    return False


def _located_again(problem: Problem, fit: Fit, before: Located) -> Located:
    """What disagrees with a fit gone on with; what candidates told of it before stands."""
    found = locate(problem, fit)
    for name, p in before.tests.items():
        if name not in found.tests:
            found = found.with_test(name, p)
    return found


def _told(everything: list[Candidate], located: Located, alarm: bool) -> str:
    left = "something is missing" if alarm else "nothing to explain"
    return f"{len(everything)} candidates looked at; {left} (global test p = {located.p:.1g})"


def _listed(hypothesis: Iterable[PlacedEffect]) -> str:
    return " and ".join(f"{effect.name} at {place}" for effect, place in hypothesis) or "nothing"


def recalibrate(problem: Problem) -> tuple[Problem, Fit]:
    """The model without any effect fitted, and the time steps put right there.

    Where recalibration leaves the prior even so, they stay: candidates are looked at from elsewhere then, and so are
    steps.
    """
    fit = problem.calibrate(PLAIN)
    right, again = problem.corrected(PLAIN, fit)
    return (problem, fit) if problem.distorted(again) else (right, again)


def assess(
    problem: Problem,
    fit: Fit,
    hypothesis: Hypothesis,
    library: tuple[Effect, ...] = SEARCHED,
    earlier: list[Candidate] = (),
) -> tuple[Located, list[Candidate], Fit]:
    """Locate what disagrees and score every candidate; the global test counts the best of them (Bonferroni).

    earlier: candidates of an earlier round, whose responses may serve again. Returns also where the candidates were
    looked at from.
    """
    everything, known = all_candidates(problem, hypothesis, library), {c.placed: c.response for c in earlier}
    for candidate in everything:
        candidate.response = known.get(candidate.placed)
    vantage = problem.vantage(fit, hypothesis)
    screen(problem, vantage, hypothesis, everything)
    located = locate(problem, fit)
    for name, p in (
        ("best candidate", [c.p_value for c in everything]),
        ("best candidate of varying size", [c.p_varying for c in everything]),
    ):
        located = located.with_test(name, min(p, default=1.0) * max(len(everything), 1))
    if not located.alarm(problem.settings.alarm_level):
        located = located.with_test(
            "likeliest candidates, fitted", _chance_of_evidence(problem, fit, hypothesis, everything)
        )
    return located, everything, vantage


def _chance_of_evidence(problem: Problem, fit: Fit, hypothesis: Hypothesis, everything: list[Candidate]) -> float:
    """p-value of the evidence for the effects that promise most, each where it does: a score test does not see what
    recalibration and size do together, as a narrowed valve does with a stronger ventricle.

    The Bayes factor of all candidates together, weighed by their priors, exceeds 1 / p with a probability of p at most
    where nothing is missing (Markov's inequality; Vovk & Wang 2021); those that are not fitted count nought.
    """
    likeliest = best_of_effects(sorted(everything, key=lambda c: -c.promise), LIKELIEST)
    found = zip(likeliest, fit_each(problem, hypothesis, likeliest, fit), strict=True)
    tried = [replace(candidate, fit=its) for candidate, its in found if its is not None]
    by_own_steps(problem, hypothesis, tried)
    shares = [np.exp(c.log_prior) / PRIOR_NAMED for c in tried]
    factors = [np.exp(min(c.fit.evidence - fit.evidence, LARGEST_LOG)) for c in tried]
    return float(1.0 / max(np.dot(shares, factors), 1.0))
