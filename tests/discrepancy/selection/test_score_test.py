"""Score test and estimate from a few runs, against full fits of models that are linear but in size."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.hypothesis import PLAIN, PlacedEffect
from coronaryuq.discrepancy.inference.gauss_newton import Search, maximise
from coronaryuq.discrepancy.selection.candidates import Candidate
from coronaryuq.discrepancy.selection.score_test import SHAPE_CHANGING, SIGNED, _worth_rerunning, screen
from coronaryuq.zerod.effects.base import Parameter
from coronaryuq.zerod.effects.library import effect
from support.hypotheses import assume
from support.linear_problem import LinearForward, fit_of, linear_problem, made_up

ROWS, NUISANCES = 200, 6
CONDITIONS = np.repeat(["rest", "hyperaemia"], ROWS // 2)


def problem_of(design, responses, y):
    return linear_problem(design, responses, y, CONDITIONS)


def screened(design, responses, y, candidates=None, point=None):
    """Candidates, one for each effect by default, as they look about the exact fit without any."""
    candidates = candidates or [Candidate(placed, -1.0) for placed in responses]
    return screen(problem_of(design, responses, y), point or fit_of(design, y), PLAIN, candidates)


def case(kind, true):
    """A linear model with one effect of true size z: sensitivities, responses and data."""
    random = generator(8, "test", "screening", kind)
    design, along = random.standard_normal((ROWS, NUISANCES)), random.standard_normal(ROWS)
    size = Parameter("size", "1", kind, 1.0 if kind == "lognormal" else 0.0, 1.2, "")
    y = design @ random.standard_normal(NUISANCES) + along * size.from_standard(true) + random.standard_normal(ROWS)
    placed = PlacedEffect(made_up("made up", size), "here")
    return design, {placed: lambda z: along * size.from_standard(z)}, y


@pytest.mark.parametrize(("kind", "true"), [("lognormal", -0.8), ("lognormal", 1.4), ("normal", -1.1), ("normal", 0.7)])
def test_the_estimate_is_the_evidence_of_a_full_fit(kind, true):
    design, responses, y = case(kind, true)
    (candidate,) = screened(design, responses, y)
    base = fit_of(design, y)
    search = Search(assume(candidate.placed), np.append(base.z, candidate.guess), list(range(NUISANCES + 1)))
    maximise(problem_of(design, responses, y).fitted, [search], 30, tolerance=1e-6)
    # Sizes between the runs are tried on a grid of 0.03 prior standard deviations.
    assert candidate.estimate == pytest.approx(search.fit.evidence, abs=2.0)
    assert search.fit.evidence - base.evidence > 10.0
    assert candidate.guess == pytest.approx(search.fit.z[-1], abs=0.2)
    assert candidate.z_score > 3.0


@pytest.mark.parametrize(("kind", "typical"), [("lognormal", 1.0), ("normal", 1.2)])
def test_the_signal_of_a_typical_size_is_what_recalibration_leaves_of_it(kind, typical):
    """The nuisance parameters have unit priors: they absorb design @ z at the cost of |z|^2."""
    design, responses, y = case(kind, 0.0)
    ((placed, response),) = responses.items()
    change = response(1.0 if kind == "normal" else 0.0)
    assert placed.effect.parameters[0].from_standard(1.0 if kind == "normal" else 0.0) == pytest.approx(typical)
    left = np.linalg.solve(np.eye(ROWS) + design @ design.T, change)
    (candidate,) = screened(design, responses, y)
    assert candidate.signal == pytest.approx(np.sqrt(change @ left), rel=0.02)


def test_a_strong_effect_is_weighed_by_its_response_to_its_own_size():
    """It bends, as a loss does that lowers the flow: multiples of the responses to other sizes leave 600 nats."""
    random = generator(27, "test", "screening")
    design, (along, across) = random.standard_normal((ROWS, NUISANCES)), random.standard_normal((2, ROWS))
    size = Parameter("size", "1", "lognormal", 1.0, 1.2, "")

    def response(z):
        value = size.from_standard(z)
        return 4.0 * along * value + 0.8 * across * value**2

    y = design @ random.standard_normal(NUISANCES) + response(0.8) + random.standard_normal(ROWS)
    placed = PlacedEffect(made_up("bent", size), "here")
    (candidate,) = screened(design, {placed: response}, y)
    search = Search(assume(placed), np.append(fit_of(design, y).z, 0.8), list(range(NUISANCES + 1)))
    maximise(problem_of(design, {placed: response}, y).fitted, [search], 30, tolerance=1e-6)
    assert candidate.estimate == pytest.approx(search.fit.evidence, abs=3.0)


def at(design, y, z):
    return replace(fit_of(design, y), z=z, residual=y - design @ z)


def test_the_estimate_does_not_depend_on_how_far_recalibration_has_gone():
    """The linear model gives the same estimate about a point that recalibration has not moved to yet."""
    design, responses, y = case("lognormal", 0.5)
    points = (np.zeros(NUISANCES), np.full(NUISANCES, 0.7))
    first, second = (screened(design, responses, y, point=at(design, y, z))[0].estimate for z in points)
    assert first == pytest.approx(second, rel=1e-9)


def test_a_positive_size_is_no_candidate_for_the_other_direction():
    design, responses, y = case("lognormal", 0.5)
    opposite = {placed: lambda z, response=response: -response(z) for placed, response in responses.items()}
    (candidate,) = screened(design, opposite, y)
    assert candidate.z_score == 0.0


def test_a_point_nearer_the_priors_mean_stands_in_where_the_model_does_not_run():
    design, responses, y = case("lognormal", 0.5)
    (candidate,) = screened(design, responses, y)
    z = fit_of(design, y).z
    for reach, scored in ((0.9, True), (0.0, False)):

        class Breaking(LinearForward):
            def predict_rows(self, rows, conditions=None, grafts=(), reach=reach):
                predicted = super().predict_rows(rows, conditions, grafts)
                lengths = [np.linalg.norm(hypothesis.nuisances(row)) for row, hypothesis in rows]
                predicted[np.array(lengths) > reach * np.linalg.norm(z)] = np.nan
                return predicted

        problem = problem_of(design, responses, y)
        problem.forward = Breaking(**vars(problem.forward))
        (other,) = screen(problem, fit_of(design, y), PLAIN, [candidate])
        assert (other.z_score > 3.0) is scored
        if scored:  # linear but in size: any point gives the same
            assert other.estimate == pytest.approx(candidate.estimate, rel=1e-9)
            assert other.guess == pytest.approx(candidate.guess)
    assert (other.estimate, other.p_varying, other.guess) == (-np.inf, 1.0, 0.0)


@pytest.mark.parametrize(("norm", "seen"), [(0.04, True), (1e-4, False)])
def test_an_effect_that_is_visible_only_if_large_is_run_larger(norm, seen):
    """Its smallest size changes the data by `norm` noise sd, and its true one by some 200 times that."""
    random = generator(26, "test", "screening")
    design, along = random.standard_normal((ROWS, NUISANCES)), random.standard_normal(ROWS) / np.sqrt(ROWS)
    size = Parameter("size", "1", "lognormal", norm * np.exp(1.5), 1.5, "")
    y = design @ random.standard_normal(NUISANCES) + along * size.from_standard(2.5) + random.standard_normal(ROWS)
    placed = PlacedEffect(made_up("made up", size), "here")
    (candidate,) = screened(design, {placed: lambda z: along * size.from_standard(z)}, y)
    assert (candidate.z_score > 5.0) is seen
    assert not seen or candidate.guess == pytest.approx(2.5, abs=0.3)


def varying(random, sizes):
    """The candidate of an effect that has these sizes under the two conditions."""
    design, along = random.standard_normal((ROWS, NUISANCES)), random.standard_normal(ROWS) / np.sqrt(ROWS)
    felt = along * np.where(CONDITIONS == "rest", *sizes)
    y = design @ random.standard_normal(NUISANCES) + felt + random.standard_normal(ROWS)
    (candidate,) = screened(design, {PlacedEffect(made_up("made up"), "here"): 5.0 * along}, y)
    return candidate


def test_an_effect_that_changes_its_sign_is_seen_only_by_the_test_of_a_varying_size():
    candidate = varying(generator(21, "test", "screening"), (12.0, -12.0))
    assert candidate.p_varying < 1e-8 and candidate.z_score < 4.0


@pytest.mark.long
def test_the_test_of_a_varying_size_keeps_its_level():
    """Without the effect p is below 0.05 in that share of 2000 trials, four standard errors allowed."""
    trials, level, random = 2000, 0.05, generator(22, "test", "screening")
    share = np.mean([varying(random, (0.0, 0.0)).p_varying < level for _ in range(trials)])
    assert abs(share - level) < 4.0 * np.sqrt(level * (1.0 - level) / trials)


def shifted(z: float) -> np.ndarray:
    """(ROWS,): what an effect does whose shape changes with its size z: a wave that comes late by z."""
    phase = 2.0 * np.pi * np.arange(ROWS) / ROWS
    return 3.0 * (np.sin(phase - 1.2 * z) - np.sin(phase))


def late(data, changes_shape: bool) -> Candidate:
    """The candidate of a late wave; recalibration compensates what a small size does."""
    design = shifted(SHAPE_CHANGING[0])[:, None] / SHAPE_CHANGING[0]
    (candidate,) = screened(design, {PlacedEffect(made_up("late", changes_shape=changes_shape), "here"): shifted}, data)
    return candidate


def test_an_effect_that_changes_its_shape_is_seen_although_a_small_size_shows_nothing():
    noise = generator(23, "test", "screening").standard_normal(ROWS)
    small, large = (late(shifted(-1.2) + noise, changes_shape) for changes_shape in (False, True))
    assert small.z_score < 2.0 < 6.0 < large.z_score
    assert large.guess == pytest.approx(-1.2, abs=0.1) and large.estimate > small.estimate + 20.0


@pytest.mark.parametrize("true", [-1.7, -0.6, 0.8, 2.2])
def test_the_guess_of_an_effect_that_changes_its_shape_is_near_its_true_size(true):
    noise = generator(25, "test", "screening").standard_normal(ROWS)
    assert late(shifted(true) + noise, changes_shape=True).guess == pytest.approx(true, abs=0.35)


@pytest.mark.long
def test_the_best_score_of_several_sizes_keeps_its_level():
    """Nothing hidden: p below 0.05 in that share of 2000 trials at most, four standard errors allowed."""
    trials, level, random = 2000, 0.05, generator(24, "test", "screening")
    p_values = [late(random.standard_normal(ROWS), changes_shape=True).p_value for _ in range(trials)]
    assert np.mean(np.array(p_values) < level) < level + 4.0 * np.sqrt(level * (1.0 - level) / trials)


def test_each_of_many_collaterals_is_run():
    """Between any two outlets: the right one is among the best only if it was run."""
    random = generator(8, "test", "many collaterals")
    design = random.standard_normal((ROWS, NUISANCES))
    size = Parameter("size", "1", "lognormal", 1.0, 1.2, "")
    effect = made_up("collateral", size, grafted=True)
    along = {PlacedEffect(effect, str(k)): row for k, row in enumerate(random.standard_normal((65, ROWS)))}
    hidden = PlacedEffect(effect, "23")
    y = design @ random.standard_normal(NUISANCES) + random.standard_normal(ROWS) + 0.8 * along[hidden]
    responses = {placed: lambda z, row=row: row * size.from_standard(z) for placed, row in along.items()}
    candidates = screened(design, responses, y)
    assert all(candidate.response is not None for candidate in candidates)
    assert max(candidates, key=lambda c: c.promise).placed == hidden


def test_what_a_probe_reads_elsewhere_is_read_again_about_every_point():
    """Two flows that are alike about one point may be far apart about another."""
    known = [
        Candidate(PlacedEffect(made_up(f"made up {number}"), "here"), 0.0, estimate=float(number))
        for number in range(99)
    ]
    several = [replace(c, placed=PlacedEffect(known[0].effect, f"place {k}")) for k, c in enumerate(known)]
    exchange = [replace(c, placed=PlacedEffect(effect("exchanged_flows"), f"place {k}")) for k, c in enumerate(known)]
    again = _worth_rerunning([*several, *exchange])
    assert {c.placed for c in exchange} <= {c.placed for c in again}
    assert len(again) < len(several) + len(exchange)


def test_a_response_known_about_another_point_is_used_unless_it_may_matter():
    """Of 400 places, and three of another effect, the likely ones are run again, the others weighed as known."""
    random = generator(9, "test", "known responses")
    design = random.standard_normal((ROWS, NUISANCES))
    many, few = made_up("many"), made_up("few")
    hidden = PlacedEffect(many, "37")
    priors = {PlacedEffect(many, str(k)): -4.0 for k in range(400)} | {PlacedEffect(few, k): -30.0 for k in "abc"}
    along = {placed: random.standard_normal(ROWS) for placed in priors}
    y = design @ random.standard_normal(NUISANCES) + random.standard_normal(ROWS) + 2.0 * along[hidden]
    known = {placed: SIGNED[0] * (row + 0.1 * random.standard_normal(ROWS)) for placed, row in along.items()}
    failed = PlacedEffect(many, "399")
    known[failed] = np.full(ROWS, np.nan)
    candidates = [Candidate(placed, prior, response=known[placed]) for placed, prior in priors.items()]
    candidates = screened(design, along, y, candidates)
    assert max(candidates, key=lambda c: c.promise).placed == hidden
    run = [c for c in candidates if c.response is not known[c.placed]]
    assert RULE.rerun <= len(run) < RULE.rerun + 50
    assert {failed, *(PlacedEffect(few, place) for place in "abc")} <= {c.placed for c in run}
    assert all(c.response == pytest.approx(SIGNED[0] * along[c.placed]) for c in run)
