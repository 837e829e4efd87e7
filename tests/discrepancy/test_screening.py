"""Candidates weighed from three runs: the estimate is a full fit's evidence where the model is linear but in size."""

from types import SimpleNamespace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference.gauss_newton import Fit, Search, maximise
from coronaryuq.discrepancy.selection.candidates import Candidate
from coronaryuq.discrepancy.selection.score_test import ANEW, SIGNED, TURNING, screen
from coronaryuq.zerod.effects.base import Parameter
from support.hypotheses import assume
from support.linear_problem import made_up

ROWS, NUISANCES = 200, 6
CONDITIONS = np.repeat(["rest", "hyperaemia"], ROWS // 2)


def problem(residuals):
    return SimpleNamespace(fitted=residuals, condition=CONDITIONS, train=np.ones(ROWS, bool), count=NUISANCES)


def case(kind, true):
    """Whitened data of a linear model with one effect of true size z, and the model's residuals at any (z, sizes)."""
    random = generator(8, "test", "screening", kind)
    g, along = random.standard_normal((ROWS, NUISANCES)), random.standard_normal(ROWS)
    parameter = Parameter("size", "1", kind, 1.0 if kind == "lognormal" else 0.0, 1.2, "")
    y = g @ random.standard_normal(NUISANCES) + along * parameter.from_standard(true) + random.standard_normal(ROWS)

    def residuals(rows, grafts=()):
        sizes = [parameter.from_standard(z[NUISANCES]) if len(z) > NUISANCES else 0.0 for z, _ in rows]
        return np.array([y - g @ z[:NUISANCES] - along * size for (z, _), size in zip(rows, sizes, strict=True)])

    effect = made_up("made up", parameter)
    return g, y, residuals, Candidate(effect, "here", -1.0)


@pytest.mark.parametrize(("kind", "true"), [("lognormal", -0.8), ("lognormal", 1.4), ("normal", -1.1), ("normal", 0.7)])
def test_the_estimate_is_the_evidence_of_a_full_fit(kind, true):
    g, y, residuals, candidate = case(kind, true)
    z = np.linalg.solve(np.eye(NUISANCES) + g.T @ g, g.T @ y)
    screen(problem(residuals), Fit(z, y - g @ z, g), assume(), [candidate])
    search = Search(None, np.append(z, candidate.guess), list(range(NUISANCES + 1)))
    maximise(residuals, [search], 30, tolerance=1e-6)
    # Sizes between the runs are tried on a grid of 0.03 prior standard deviations.
    assert candidate.estimate == pytest.approx(search.fit.evidence, abs=2.0)
    assert search.fit.evidence - Fit(z, y - g @ z, g).evidence > 10.0
    assert candidate.guess[0] == pytest.approx(search.fit.z[-1], abs=0.2)
    assert candidate.z_score > 3.0


def test_the_estimate_does_not_depend_on_how_far_recalibration_has_gone():
    """About a point that recalibration has not moved to yet the linear model gives the same estimate."""
    g, y, residuals, candidate = case("lognormal", 0.5)
    found = []
    for z in (np.zeros(NUISANCES), np.full(NUISANCES, 0.7)):
        screen(problem(residuals), Fit(z, y - g @ z, g), assume(), [candidate])
        found.append(candidate.estimate)
    assert found[0] == pytest.approx(found[1], rel=1e-9)


def test_a_positive_size_is_no_candidate_for_the_other_direction():
    g, y, _, candidate = case("lognormal", 0.5)
    _, _, opposite, _ = case("lognormal", 0.5)
    z = np.linalg.solve(np.eye(NUISANCES) + g.T @ g, g.T @ y)

    def mirrored(rows, grafts=()):
        own = opposite([(row[:NUISANCES], acting) for row, acting in rows])
        return own + (own - opposite(rows))

    screen(problem(mirrored), Fit(z, y - g @ z, g), assume(), [candidate])
    assert candidate.z_score == 0.0


def test_where_the_model_does_not_run_a_nearer_point_stands_for_it_or_nothing_gets_a_score():
    g, y, residuals, candidate = case("lognormal", 0.5)
    z = np.linalg.solve(np.eye(NUISANCES) + g.T @ g, g.T @ y)
    at = Fit(z, y - g @ z, g)
    screen(problem(residuals), at, assume(), [candidate])
    estimate, guess = candidate.estimate, candidate.guess
    for reach, scored in ((0.9, True), (0.0, False)):

        def broken(rows, grafts=(), reach=reach):
            found = residuals(rows)
            found[[np.linalg.norm(row[:NUISANCES]) > reach * np.linalg.norm(z) for row, _ in rows]] = np.nan
            return found

        screen(problem(broken), at, assume(), [candidate])
        assert (candidate.z_score > 3.0) is scored
        if scored:  # linear but in size: any point gives the same
            assert candidate.estimate == pytest.approx(estimate, rel=1e-9)
            assert candidate.guess == pytest.approx(guess)
    assert (candidate.estimate, candidate.p_varying, candidate.guess.tolist()) == (-np.inf, 1.0, [0.0])


@pytest.mark.parametrize(("norm", "seen"), [(0.04, True), (1e-4, False)])
def test_what_data_see_only_if_it_is_large_is_run_larger(norm, seen):
    """An effect whose smallest size changes the data by `norm` noise sd, and its true one by 200 times that, or so."""
    random = generator(26, "test", "screening")
    g, along = random.standard_normal((ROWS, NUISANCES)), random.standard_normal(ROWS) / np.sqrt(ROWS)
    parameter = Parameter("size", "1", "lognormal", norm * np.exp(1.5), 1.5, "")
    y = g @ random.standard_normal(NUISANCES) + along * parameter.from_standard(2.5) + random.standard_normal(ROWS)

    def residuals(rows, grafts=()):
        sizes = [parameter.from_standard(z[NUISANCES]) if len(z) > NUISANCES else 0.0 for z, _ in rows]
        return np.array([y - g @ z[:NUISANCES] - along * size for (z, _), size in zip(rows, sizes, strict=True)])

    candidate = Candidate(made_up("made up", parameter), "here", -1.0)
    z = np.linalg.solve(np.eye(NUISANCES) + g.T @ g, g.T @ y)
    screen(problem(residuals), Fit(z, y - g @ z, g), assume(), [candidate])
    assert (candidate.z_score > 5.0) is seen
    assert not seen or candidate.guess[0] == pytest.approx(2.5, abs=0.3)


def varying(random, sizes):
    """p-value of the varying size of an effect that has these sizes under the two conditions."""
    g, along = random.standard_normal((ROWS, NUISANCES)), random.standard_normal(ROWS) / np.sqrt(ROWS)
    felt = along * np.where(CONDITIONS == "rest", *sizes)
    y = g @ random.standard_normal(NUISANCES) + felt + random.standard_normal(ROWS)

    def residuals(rows, grafts=()):
        return np.array(
            [y - g @ z[:NUISANCES] - along * 5.0 * (z[NUISANCES] if len(z) > NUISANCES else 0) for z, _ in rows]
        )

    effect = made_up("made up")
    z = np.linalg.solve(np.eye(NUISANCES) + g.T @ g, g.T @ y)
    candidate = Candidate(effect, "here", -1.0)
    screen(problem(residuals), Fit(z, y - g @ z, g), assume(), [candidate])
    return candidate.p_varying, candidate.z_score


def test_what_changes_its_sign_is_seen_by_the_test_of_a_varying_size_alone():
    p, z = varying(generator(21, "test", "screening"), (12.0, -12.0))
    assert p < 1e-8 and z < 4.0


def test_a_varying_size_is_found_where_there_is_none_as_often_as_said():
    """Without the effect the p-value is below 0.05 in that share of 2000 trials, four standard errors allowed."""
    trials, level, random = 2000, 0.05, generator(22, "test", "screening")
    share = np.mean([varying(random, (0.0, 0.0))[0] < level for _ in range(trials)])
    assert abs(share - level) < 4.0 * np.sqrt(level * (1.0 - level) / trials)


def turned(z: float) -> np.ndarray:
    """(ROWS,): what an effect of size z does that turns: a wave that comes late by z."""
    phase = 2.0 * np.pi * np.arange(ROWS) / ROWS
    return 3.0 * (np.sin(phase - 1.2 * z) - np.sin(phase))


def of_a_turning_effect(data, turning: bool) -> Candidate:
    """Weighed from its runs; recalibration takes up what a small size does."""
    g = turned(TURNING[0])[:, None] / TURNING[0]

    def residuals(rows, grafts=()):
        return np.array([data - g @ z[:1] - turned(z[1] if len(z) > 1 else 0.0) for z, _ in rows])

    candidate = Candidate(made_up("late", changes_shape=turning), "here", -1.0)
    z = np.linalg.solve(np.eye(1) + g.T @ g, g.T @ data)
    screen(problem(residuals), Fit(z, data - g @ z, g), assume(), [candidate])
    return candidate


def test_an_effect_that_turns_with_its_size_is_seen_though_a_small_one_tells_nothing_of_it():
    noise = generator(23, "test", "screening").standard_normal(ROWS)
    small, large = (of_a_turning_effect(turned(-1.2) + noise, turning) for turning in (False, True))
    assert small.z_score < 2.0 < 6.0 < large.z_score
    assert large.guess[0] == pytest.approx(-1.2, abs=0.1) and large.estimate > small.estimate + 20.0


@pytest.mark.parametrize("true", [-1.7, -0.6, 0.8, 2.2])
def test_the_estimate_of_an_effect_that_turns_is_near_that_at_its_true_size(true):
    noise = generator(25, "test", "screening").standard_normal(ROWS)
    found = of_a_turning_effect(turned(true) + noise, turning=True)
    assert found.guess[0] == pytest.approx(true, abs=0.35)


def test_the_best_score_of_several_sizes_raises_no_more_alarms_than_said():
    """Nothing hidden: p below 0.05 in that share of 2000 trials at most, four standard errors allowed."""
    trials, level, random = 2000, 0.05, generator(24, "test", "screening")
    found = [of_a_turning_effect(random.standard_normal(ROWS), turning=True).p_value for _ in range(trials)]
    assert np.mean(np.array(found) < level) < level + 4.0 * np.sqrt(level * (1.0 - level) / trials)


def test_of_many_collaterals_each_is_run():
    """Between any two outlets: the right one is among the best only if it has been run."""
    random, places = generator(8, "test", "many collaterals"), [str(k) for k in range(65)]
    g = random.standard_normal((ROWS, NUISANCES))
    along = dict(zip(places, random.standard_normal((65, ROWS)), strict=True))
    size = Parameter("size", "1", "lognormal", 1.0, 1.2, "")
    effect = made_up("collateral", size, grafted=True)
    hidden, y = places[23], g @ random.standard_normal(NUISANCES) + random.standard_normal(ROWS)
    y = y + 0.8 * along[hidden]

    def residuals(rows, grafts=()):
        return np.array(
            [y - g @ z[:6] - (along[of.effects[0].place] * size.from_standard(z[6]) if of else 0.0) for z, of in rows]
        )

    candidates = [Candidate(effect, place, -4.0) for place in places]
    z = np.linalg.solve(np.eye(NUISANCES) + g.T @ g, g.T @ y)
    screen(problem(residuals), Fit(z, y - g @ z, g), assume(), candidates)
    assert all(candidate.guess is not None for candidate in candidates)
    assert max(candidates, key=lambda c: c.promise).place == hidden


def test_a_response_known_about_another_point_serves_where_little_is_promised():
    """Of 400 places and three of another effect: the likely ones are run anew, the others weighed as they are known."""
    random, places = generator(9, "test", "known responses"), [str(k) for k in range(400)]
    g = random.standard_normal((ROWS, NUISANCES))
    many, few = made_up("many"), made_up("few")
    hidden = (many, "37")
    candidates = [Candidate(many, place, -4.0) for place in places] + [Candidate(few, place, -30.0) for place in "abc"]
    along = {c.placed: random.standard_normal(ROWS) for c in candidates}
    y = g @ random.standard_normal(NUISANCES) + random.standard_normal(ROWS) + 2.0 * along[hidden]
    ran = []

    def residuals(rows, grafts=()):
        ran.extend(of.effects[0] for _, of in rows if of)
        return np.array([y - g @ z[:6] - (along[of.effects[0]] * z[6] if of else 0.0) for z, of in rows])

    z = np.linalg.solve(np.eye(NUISANCES) + g.T @ g, g.T @ y)
    for candidate in candidates:
        candidate.response = SIGNED[0] * (along[candidate.placed] + 0.1 * random.standard_normal(ROWS))
    failed = candidates[399]
    failed.response = np.full(ROWS, np.nan)
    before = {c.placed: c.response for c in candidates}
    screen(problem(residuals), Fit(z, y - g @ z, g), assume(), candidates)
    assert max(candidates, key=lambda c: c.promise).placed == hidden
    anew = set(ran)
    kept = [c for c in candidates if c.placed not in anew]
    assert ANEW <= len(anew) < ANEW + 50 and {failed.placed, *((few, place) for place in "abc")} <= anew
    assert all(c.response is before[c.placed] and c.guess is not None for c in kept)
    exact = [c for c in candidates if c.placed in anew]
    assert all(c.response == pytest.approx(SIGNED[0] * along[c.placed]) for c in exact)
