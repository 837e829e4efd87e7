"""The search as a whole: tests of evidence, time steps, and a second search without a confounder."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import closed_loop, open_loop
from coronaryuq.bench.discrepancy.trial import analyse, hide, read_case
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference.noise import Alternative, Estimate, Noise, most_probable
from coronaryuq.discrepancy.result.summary_text import paragraph
from coronaryuq.discrepancy.result.write import summary
from coronaryuq.discrepancy.selection import search
from coronaryuq.discrepancy.selection.answer import NAMES, NOTHING, OTHER
from coronaryuq.discrepancy.selection.candidates import Candidate, Round
from coronaryuq.discrepancy.selection.observed_noise import Observed
from coronaryuq.discrepancy.selection.search import evidence_p_value, recalibrate, search_without_confounder
from support.discoveries import discovery
from support.hypotheses import assume
from support.linear_problem import LinearProblem, here, linear_problem, made_up
from support.small_loop import loop

ROWS, NUISANCES, EFFECTS = 60, 3, 12


class Many:
    """Twelve effects; data are drawn from the model without any, or with the first at so many standard deviations."""

    log_prior = np.log(RULE.prior_named / EFFECTS)

    def __init__(self):
        random = generator(3, "test", "evidence")
        self.design = random.standard_normal((ROWS, NUISANCES))
        self.responses = {here(f"effect {number}"): 2.0 * random.standard_normal(ROWS) for number in range(EFFECTS)}
        self.problem = linear_problem(self.design, self.responses, np.zeros(ROWS))

    def p_value(self, random, size=0.0):
        spread = random.standard_normal(NUISANCES)
        hidden = size * next(iter(self.responses.values()))
        self.problem.y = self.design @ spread + hidden + random.standard_normal(ROWS)
        candidates = [
            Candidate(
                placed, np.log(RULE.prior_named / EFFECTS), estimate=self.problem.calibrate(assume(placed)).evidence
            )
            for placed in self.responses
        ]
        return evidence_p_value(self.problem, self.problem.calibrate(PLAIN), PLAIN, candidates)


@pytest.mark.long
def test_the_evidence_p_value_is_one_where_nothing_is_missing():
    """It is smaller than p with a probability of p at most, and not always 1."""
    many, random, trials = Many(), generator(4, "test", "evidence"), 1000
    p_values = np.array([many.p_value(random) for _ in range(trials)])
    for level in (0.3, 0.1, 0.03):
        assert np.sum(p_values <= level) <= stats.binom.ppf(0.999, trials, level)
    assert p_values.min() < 1.0


def test_the_evidence_for_an_effect_that_is_there_is_overwhelming():
    assert Many().p_value(generator(5, "test", "evidence"), size=0.6) < 1e-4
    assert RULE.likeliest_effects < EFFECTS


def test_recalibration_corrects_time_steps_where_it_ends():
    class Ringing(LinearProblem):
        def corrected(self, hypothesis, fit):
            other = replace(self)
            other.change = 5.0 * np.eye(ROWS)[1]
            return other, other.calibrate(hypothesis)

    problem = linear_problem(10.0 * np.eye(ROWS)[:, :1], {}, 90.0 * np.eye(ROWS)[0], kind=Ringing)
    chosen, fit = recalibrate(problem)
    assert chosen.change == pytest.approx(5.0 * np.eye(ROWS)[1])
    assert fit.z == pytest.approx(chosen.calibrate(PLAIN).z)


DRIVE, PROBE, LOSS = made_up("drive_gain"), made_up("flow_gain", is_measurement_error=True), made_up("loss")
LIBRARY = (DRIVE, PROBE, LOSS)


def searched(first, second):
    """What stands of a search that finds `first`, and `second` without an effect; and which effect that was."""
    left_out = []

    def search(problem, seed, library, report):
        gone = set(LIBRARY) - set(library)
        left_out.extend(effect.name for effect in gone)
        return second if gone else first

    return search_without_confounder(search, first.problem, 1, LIBRARY, lambda line: None), left_out


@pytest.mark.parametrize("likelier", [True, False])
@pytest.mark.parametrize(
    ("sizes", "without"), [({LOSS: 1.0, DRIVE: 1.0}, "drive_gain"), ({LOSS: 1.0, PROBE: 5.0}, "flow_gain")]
)
def test_the_likelier_search_stands(sizes, without, likelier):
    first = discovery(sizes, evidence=-10.0)
    second = discovery({LOSS: 1.0}, evidence=-5.0 if likelier else -50.0)
    stands, left_out = searched(first, second)
    assert left_out == [without] and stands is (second if likelier else first)


@pytest.mark.parametrize("sizes", [{LOSS: 1.0, PROBE: 1.0}, {LOSS: 5.0}, {}])
def test_other_effects_need_no_second_search(sizes):
    first = discovery(sizes, evidence=-10.0)
    stands, left_out = searched(first, discovery({LOSS: 1.0}, evidence=-1.0))
    assert stands is first and not left_out


@pytest.mark.parametrize(("scale", "evidence", "stands"), [(2.5, -5.0, True), (2.5, -50.0, False), (1.8, -5.0, False)])
def test_what_only_the_stated_noise_shows_is_named_if_it_is_likelier(monkeypatch, scale, evidence, stands):
    """Noise of more than twice the stated size may be an effect in all waveforms: both are searched."""
    estimated, stated = discovery({}, evidence=-10.0), discovery({LOSS: 1.0}, evidence=evidence)
    noises = tuple(Alternative(Noise(own), 0.0) for own in (1.0, scale))
    observed = Observed({"flow": Estimate(noises[1].noise, noises)}, [], False)
    monkeypatch.setattr(search, "observe", lambda *given: observed)
    monkeypatch.setattr(
        search.observed_noise, "with_observed_noise", lambda problem, found, report: most_probable(found.estimates)
    )
    monkeypatch.setattr(search, "_search", lambda noise, *given, **more: estimated if noise else stated)
    found = search.discover(estimated.problem, 1, LIBRARY)
    assert bool(found.named) is stands and bool(found.noise) is not stands


def test_classes_are_judged_again_after_the_confirmation_has_removed_an_effect(monkeypatch):
    random, kept, gone = generator(8, "test", "check"), here("kept"), here("gone")
    design, along, other, noise = random.standard_normal((120, 2)), *random.standard_normal((3, 120))
    problem, both = linear_problem(design, {kept: along, gone: other}, along + noise), assume(kept, gone)
    candidates = [Candidate(placed, -3.0, z_score=10.0, guess=1.0) for placed in both]
    rounds = tuple(Round([], c, [c], candidates, both.without(c.placed)) for c in candidates)
    left = rounds[0], replace(rounds[1], accepted=None, refuted=candidates[1])
    fit, fits = problem.calibrate(assume(kept)), problem.calibrate(both)
    monkeypatch.setattr(search, "confirm", lambda *given: (assume(kept), fit, left))
    monkeypatch.setattr(search._State, "converged", lambda state: state)
    monkeypatch.setattr(search._State, "reassessed", lambda state, library: state)
    state = search._State(problem, both, fits, None, candidates, 2, rounds)
    after, confirmed = search._check(state, (), lambda line: None)
    assert not confirmed and after.hypothesis == assume(kept) and after.refused == {gone}
    assert after.rounds[0].others == PLAIN and after.rounds[0].accepted.placed == kept


@pytest.mark.long
def test_the_most_probable_answer_is_given_whatever_the_global_test_says(tmp_path):
    """Pressure that leaks into a flow channel shows in all data together, but in no test of the fitted ones."""
    hide(Case((), "medium", "nominal", 20015, "channel_crosstalk"), closed_loop(loop()), tmp_path, NATURE)
    found = analyse(tmp_path)
    assert not found.alarm and found.answer.probabilities[OTHER] > 0.9
    assert found.answer.given == OTHER and not found.consistent
    text = paragraph(summary(found))
    assert "finds no misfit" in text and "Something other than an effect of the library is missing" in text


@pytest.mark.long
def test_a_first_effect_that_is_likelier_than_none_is_weighed_by_all_data(tmp_path):
    """Fitted data make exchanged probes less likely than a further effect has to be; all agree that they are."""
    hide(Case(("exchanged_pressures",), "medium", "nominal", 71062), open_loop(), tmp_path, NATURE)
    problem = read_case(tmp_path)
    found = search.discover(replace(problem, settings=problem.settings.model_copy(update={"min_log_odds": 8.0})), 1)
    gain = found.rounds[0].accepted.log_weight - found.base.evidence
    assert 0.0 < gain < found.problem.settings.min_log_odds
    assert [placed.effect.name for placed in found.hypothesis] == ["exchanged_pressures"]
    assert found.answer.given == NAMES and found.answer.probabilities[NOTHING] < 0.2


@pytest.mark.long
def test_effects_of_one_formula_are_one_class_however_strong(tmp_path):
    """A loss at the ostium of 139 noise sd is that of a stenosis in the first vessel, which alone was named, at .99."""
    hide(Case(("ostial_loss",), "medium", "nominal", 72001), open_loop(), tmp_path, NATURE)
    (entry,) = analyse(tmp_path).named
    named = {(member.effect.name, member.place) for member in entry.members}
    assert named == {("ostial_loss", "left_main"), ("quadratic_stenosis", "left_main")}


@pytest.mark.long
def test_beds_far_from_their_prior_hide_no_effect(tmp_path):
    """Recalibration moves all beds by three standard deviations; about the prior's mean an offset explains nothing."""
    hide(Case(("flow_offset",), "strong", "nominal", 72006), open_loop(), tmp_path, NATURE)
    found = analyse(tmp_path)
    assert found.problem.distorted(found.base)
    assert [placed.effect.name for placed in found.hypothesis] == ["flow_offset"] and found.answer.given == NAMES


@pytest.mark.slow
def test_a_side_branch_that_the_model_lacks_is_no_error_of_a_probe(tmp_path):
    """Its bed dilates as the others do. With a leak of constant resistance alone, a flow gain was named at 0.98."""
    truth, _ = hide(Case(("side_branch",), "medium", "nominal", 75001), open_loop(), tmp_path, NATURE)
    (entry,) = analyse(tmp_path).named
    assert set(truth.hypothesis) <= {member.placed for member in entry.members}
    assert entry.named.effect.name == "side_branch"


@pytest.mark.long
def test_an_average_of_beats_is_named(tmp_path):
    """It blurs waveforms by less than the error that a right model may have, and was answered "nothing" at 1.00."""
    truth, _ = hide(Case(("beat_averaging",), "strong", "nominal", 77001), open_loop(), tmp_path, NATURE)
    (entry,) = analyse(tmp_path).named
    assert entry.named.placed in truth.hypothesis


@pytest.mark.long
def test_a_compression_of_other_timing_is_named_with_its_times(tmp_path):
    """Three of three cases of another timing than the library's were answered "something else"."""
    hide(Case(("compressed_resistance",), "strong", "nominal", 71001), open_loop(), tmp_path, NATURE)
    found = analyse(tmp_path)
    assert [entry.named.effect.name for entry in found.named] == ["compressed_resistance"]
    hidden = np.ones(3)
    for (_, z, sd), true in zip(found.sizes(found.named[0].named.placed), hidden, strict=True):
        assert abs(z - true) < 3.0 * sd and abs(z - true) < 0.3
