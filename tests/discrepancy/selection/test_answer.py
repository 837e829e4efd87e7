"""The answer: names, something else, or nothing, with probabilities that are frequencies."""

import types
from unittest import mock

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.cross_validation import evidence_of_all
from coronaryuq.discrepancy.inference.evidence import Data
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES, RIGHT, UNKNOWN
from coronaryuq.discrepancy.selection import answer as answer_module
from coronaryuq.discrepancy.selection.answer import ALONE, MISWIRED, NAMES, NOTHING, OTHER, REMAINDER, VARYING, answer
from coronaryuq.discrepancy.selection.size_constancy import Constancy
from support.hypotheses import assume
from support.linear_problem import here, linear_problem

ROWS, NUISANCES, EFFECTS = 90, 2, 4
POSSIBLE = [here(f"possible {number}").effect for number in range(EFFECTS)]
CONDITIONS = np.repeat(["rest", "hyperaemia", "pacing"], ROWS // 3)
PRIOR = float(np.log(RULE.prior_named / EFFECTS))
PHASE = np.tile(np.arange(ROWS // 3) / (ROWS // 3), 3)
FOUND = here("found")
RESPONSE = 3.0 * np.sin(2.0 * np.pi * PHASE) * np.repeat([1.0, 0.5, 1.5], ROWS // 3)
SCALE = 100.0
"""Added to all data, so that the model's own error is half a standard deviation."""


def problem_of(change, seed=0, effect=FOUND, held_out=()):
    """Data with this change of the mean (N,), and unit noise."""
    random = generator(seed, "test", "answer")
    design = random.standard_normal((ROWS, NUISANCES))
    y = design @ random.standard_normal(NUISANCES) + change + random.standard_normal(ROWS)
    problem = linear_problem(design, {effect: RESPONSE}, y, CONDITIONS, held_out)
    problem.__dict__["flexible"] = None
    return problem


def weighed(problem, effect=FOUND, rivals=types.MappingProxyType({})):
    """Weigh one effect; the features are those of data as large as `SCALE`."""
    own = gp_discrepancy.features

    def features(problem, common=False):
        return own(problem, common) * SCALE / np.abs(problem.y).max()

    flexible = gp_discrepancy.Flexible(features(problem)[problem.train], np.zeros(problem.train.sum(), dtype=int))
    problem.__dict__["flexible"] = flexible
    with mock.patch.object(gp_discrepancy, "features", features):
        problem.__dict__["all_data"] = Data(problem, np.ones(len(problem.y), dtype=bool))
    hypothesis = assume(effect)
    base, fit = problem.calibrate(PLAIN), problem.calibrate(hypothesis)
    return answer(problem, evidence_of_all(problem, base, PLAIN), fit, hypothesis, [PRIOR], POSSIBLE, rivals, {})


@pytest.mark.parametrize("change", [RESPONSE, *(size * np.cos(4.0 * np.pi * PHASE) for size in (100.0, 250.0, 600.0))])
def test_probabilities_add_up(change):
    """None exceeds 1 either, however large the misfit, and with it the logarithms, is."""
    found = weighed(problem_of(change))
    assert sum(found.probabilities.values()) == pytest.approx(1.0, abs=1e-12)
    assert max(found.probabilities.values()) <= 1.0
    assert sum(found.forms.values()) == pytest.approx(found.probabilities[OTHER])


def test_an_effect_that_explains_the_data_is_named():
    assert weighed(problem_of(2.0 * RESPONSE)).given == NAMES


def test_noise_is_nothing():
    assert weighed(problem_of(np.zeros(ROWS))).given == NOTHING


def test_a_remainder_of_another_shape_is_something_else():
    """The effect explains most, and no misfit of that size belongs to a right model."""
    other = 4.0 * np.cos(4.0 * np.pi * PHASE)
    found = weighed(problem_of(2.0 * RESPONSE + other))
    assert found.given == OTHER and found.leading_form == REMAINDER
    assert weighed(problem_of(3.0 * other)).leading_form == ALONE


def test_a_size_that_differs_between_conditions_is_something_else():
    sizes = np.repeat([0.0, 1.5, 3.0], ROWS // 3)
    found = weighed(problem_of(sizes * RESPONSE))
    assert found.given == OTHER and found.leading_form == VARYING
    assert [entry.placed for entry in found.varying] == [FOUND]


@pytest.mark.parametrize(("size", "given"), [(3.3, NAMES), (-3.3, NAMES), (4.7, OTHER), (-4.7, OTHER)])
def test_an_implausible_size_is_not_named_however_well_it_explains(size, given):
    found = weighed(problem_of(size * RESPONSE))
    assert found.given == given and bool(found.implausible) == (given == OTHER)


def test_a_wiring_error_is_not_named():
    effect = here("exchanged", nameable=False)
    found = weighed(problem_of(2.0 * RESPONSE, effect=effect), effect)
    assert found.given == OTHER and list(found.wiring_errors) == [effect] and found.leading_form == MISWIRED


@pytest.mark.parametrize(("log_odds", "given"), [(2.0, OTHER), (-1e-3, OTHER), (-2.0, NAMES)])
def test_a_wiring_error_that_explains_the_same_takes_its_share(log_odds, given):
    rival = here("exchanged", nameable=False)
    found = weighed(problem_of(2.0 * RESPONSE), rivals={rival: log_odds})
    # Just below even odds, the other forms of something else decide.
    assert found.given == given and found.wiring_errors == ([rival] if given == OTHER else [])
    odds = found.forms[MISWIRED] / found.probabilities[NAMES]
    assert np.log(odds) == pytest.approx(log_odds)


def test_held_out_data_count():
    """An effect that the fitted data show and the held-out ones do not is not named."""
    there = np.where(CONDITIONS == "pacing", 0.0, 1.0)
    assert weighed(problem_of(2.0 * RESPONSE, held_out=["pacing"])).given == NAMES
    assert weighed(problem_of(2.0 * RESPONSE * there, held_out=["pacing"])).given == OTHER


@pytest.mark.long
def test_probabilities_are_frequencies():
    """1,500 truths from the prior: in each fifth of the probability of a name, within four standard errors and 0.02.

    Sizes that differ between conditions are weighed, but are none of these truths.
    """
    random, trials = generator(5, "test", "reliability"), 1500
    right, stated = np.zeros(trials, dtype=bool), np.zeros(trials)
    share = 1.0 / EFFECTS
    truths = {
        NOTHING: RULE.prior_none,
        NAMES: RULE.prior_named * share,
        ALONE: RULE.prior_outside,
        REMAINDER: RULE.prior_outside * share,
    }
    chances = np.array(list(truths.values())) / sum(truths.values())
    for number in range(trials):
        truth = list(truths)[random.choice(len(truths), p=chances)]
        problem = problem_of(np.zeros(ROWS), number)
        features = gp_discrepancy.features(problem) * SCALE / np.abs(problem.y).max()
        amplitude = random.choice(AMPLITUDES, p=np.exp(RIGHT if truth in (NOTHING, NAMES) else UNKNOWN))
        problem.y = problem.y + amplitude * features @ random.standard_normal(features.shape[1])
        if truth in (NAMES, REMAINDER):
            problem.y = problem.y + random.standard_normal() * RESPONSE
        stated[number], right[number] = weighed(problem).probabilities[NAMES], truth == NAMES
    for low in (0.0, 0.2, 0.4, 0.6, 0.8):
        own = (stated >= low) & (stated < low + 0.2 + 1e-9)
        if own.sum() > 10:
            error = np.sqrt(stated[own].mean() * (1.0 - stated[own].mean()) / own.sum())
            assert abs(right[own].mean() - stated[own].mean()) < 4.0 * error + 0.02, (low, own.sum())


@pytest.mark.parametrize("count", [1, 2])
def test_sizes_that_vary_have_a_quarter_of_the_prior_however_many_effects_there_are(monkeypatch, count):
    """Where no size differs more or less than it does not, names keep four times the odds of something else."""
    problem, effects = problem_of(RESPONSE), [FOUND, here("second")][:count]
    problem.forward.responses |= {effect: np.cos(2.0 * np.pi * PHASE) for effect in effects[1:]}
    same = [Constancy(effect, 0.0, {}) for effect in effects]
    monkeypatch.setattr(answer_module, "constancy", lambda *given: same)
    hypothesis, flexible = assume(*effects), gp_discrepancy.Flexible(np.zeros((ROWS, 1)), np.zeros(ROWS, dtype=int))
    problem.__dict__["flexible"] = flexible
    base, fit = problem.calibrate(PLAIN), problem.calibrate(hypothesis)
    plain = evidence_of_all(problem, base, PLAIN)
    found = answer(problem, plain, fit, hypothesis, [PRIOR] * count, POSSIBLE, {}, {})
    odds = found.forms[VARYING] / found.probabilities[NAMES]
    assert odds == pytest.approx(0.25 * RULE.prior_outside / RULE.prior_named)
