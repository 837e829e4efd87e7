"""Noise estimated from waveforms: its size, its correlation time, and searches where it differs from what is stated."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import closed_loop, open_loop
from coronaryuq.bench.discrepancy.trial import hide, read_case
from coronaryuq.core.correlated_noise import autoregressive
from coronaryuq.discrepancy.data.conditions import read_conditions
from coronaryuq.discrepancy.inference.noise import (
    HARMONICS,
    SAME_SCALE,
    Estimate,
    Noise,
    differing,
    most_probable,
    noise_estimates,
    white_and_correlated,
    with_correlated,
)
from coronaryuq.discrepancy.inference.read_problem import possible_noises, read_problem, with_noise
from coronaryuq.discrepancy.result.summary_text import paragraph
from coronaryuq.discrepancy.result.write import summary
from coronaryuq.discrepancy.selection.answer import OTHER
from coronaryuq.discrepancy.selection.search import discover
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.library import SEARCHED
from coronaryuq.zerod.network.read import read_network
from support.series_problem import series_problem, waveform
from support.small_loop import loop

SAMPLES, SERIES, PERIOD = 40, 6, 0.8


def series(seed=0, quantity="flow"):
    jitter = np.random.default_rng(seed).uniform(-0.3, 0.3, SAMPLES)
    time = (np.arange(SAMPLES) + 0.5 + jitter) / SAMPLES * PERIOD
    return waveform(time, PERIOD, quantity=quantity)


def case(residual):
    """A problem of six waveforms whose fit leaves these whitened residuals (6, 40)."""
    problem = series_problem([series(number) for number in range(SERIES)])
    return problem, residual.ravel()


def estimated_noise(problem, residual):
    """The most probable noise by the scatter."""
    return most_probable(noise_estimates(problem, residual))


def correlation(time, correlation_time):
    """The shorter way round the beat."""
    apart = np.abs(time[:, None] - time)
    return np.exp(-np.minimum(apart, PERIOD - apart) / correlation_time)


def correlated_noise(random, time, correlation_time):
    return np.linalg.cholesky(correlation(time, correlation_time)) @ random.standard_normal(time.size)


@pytest.mark.long
def test_stated_noise_is_seldom_thought_to_be_another():
    """400 trials: in no more than 10 % of them, with four standard errors."""
    random, trials = np.random.default_rng(1), 400
    found = [estimated_noise(*case(random.standard_normal((SERIES, SAMPLES)))) for _ in range(trials)]
    assert sum(map(bool, found)) / trials < 0.1 + 4.0 * np.sqrt(0.1 * 0.9 / trials)


@pytest.mark.slow
@given(st.lists(st.floats(-50.0, 50.0), min_size=2 * HARMONICS + 1, max_size=2 * HARMONICS + 1), st.integers(0, 99))
def test_missing_first_harmonics_are_not_noise(weights, seed):
    noise = 2.0 * np.random.default_rng(seed).standard_normal((SERIES, SAMPLES))
    lacks = []
    for number in range(SERIES):
        angles = 2.0 * np.pi * np.outer(series(number).time / PERIOD, np.arange(1, HARMONICS + 1))
        lacks.append(np.hstack([np.ones((SAMPLES, 1)), np.cos(angles), np.sin(angles)]) @ weights)
    plain, more = estimated_noise(*case(noise))["flow"], estimated_noise(*case(noise + np.array(lacks)))["flow"]
    assert more.scale == pytest.approx(plain.scale, rel=1e-9) and more.correlation_time == plain.correlation_time


@given(st.integers(0, 99))
def test_a_misfit_of_two_waveforms_is_not_noise(seed):
    """Two of six waveforms miss by twenty standard deviations in every sample."""
    random = np.random.default_rng(seed)
    noise = random.standard_normal((SERIES, SAMPLES))
    noise[:2] += 20.0 * random.choice([-1.0, 1.0], (2, SAMPLES))
    found = estimated_noise(*case(noise)).get("flow")
    assert found is None or found.scale < 1.6


def test_the_size_of_larger_noise_is_estimated():
    random = np.random.default_rng(2)
    found = [estimated_noise(*case(2.0 * random.standard_normal((SERIES, SAMPLES))))["flow"] for _ in range(50)]
    factors = np.array([one.scale for one in found if one.correlation_time == 0.0])
    assert len(factors) >= 43, "correlated in no more than one of ten, and 1.6 standard errors"
    assert abs(factors.mean() - 2.0) < 4.0 * factors.std() / np.sqrt(50) + 0.03


@given(st.integers(0, 99), st.floats(0.1, 3.0))
def test_no_noise_is_possible_that_is_smaller_than_the_stated_and_the_most_probable_one(seed, scale):
    """Standard deviations that are overstated are kept, as the answer then warns of them."""
    noise = scale * np.random.default_rng(seed).standard_normal((SERIES, SAMPLES))
    estimate = noise_estimates(*case(noise))["flow"]
    possible = [one.noise for one in estimate.alternatives]
    assert Noise(1.0) in possible and (estimate.noise is None or estimate.noise in possible)
    assert all(one.scale >= min(1.0, estimate.scale) for one in possible)


def test_long_correlated_noise_of_dense_samples_is_not_taken_for_smaller_noise():
    """Of 180 samples in a beat, with half the stated size; what is chosen, or another that is possible, is as large."""
    random, time = np.random.default_rng(4), np.arange(180) / 180.0 * PERIOD
    problem = series_problem([waveform(time, PERIOD) for _ in range(4)])
    for correlation_time in (0.01, 0.03, 0.06):
        noise = [0.5 * correlated_noise(random, time, correlation_time) for _ in range(4)]
        estimate = noise_estimates(problem, np.concatenate(noise))["flow"]
        longest = max(one.noise.correlation_time for one in estimate.alternatives)
        assert 0.7 * correlation_time < longest < 0.1 * PERIOD
        assert 0.4 < estimate.noise.scale < 0.8


def test_the_noise_does_not_depend_on_the_order_of_the_conditions():
    """The longest correlation time followed the beat of the waveform that came first."""
    beats = {"rest": 1.2, "pacing": 0.6}
    step, found = 0.01, []
    for names in (list(beats), list(beats)[::-1]):
        measured, residual = [], []
        for name in names:
            for number in range(3):
                count = round(beats[name] / step)
                time = (np.arange(count) + 0.5) * step
                measured.append(replace(waveform(time, beats[name]), condition=name, location=f"a{number}:b"))
                random = np.random.default_rng([number, count])
                residual.append(autoregressive(count, np.exp(-step / 0.09), random))
        noise = noise_estimates(series_problem(measured), np.concatenate(residual))["flow"]
        found.append([(one.noise.correlation_time, one.noise.scale) for one in noise.alternatives])
    assert found[0] == [pytest.approx(one) for one in found[1]]


def test_waveforms_too_short_to_scatter_have_the_stated_noise():
    """Their mean leaves one number of two samples."""
    time = np.array([0.1, 0.5])
    problem = series_problem([waveform(time, PERIOD)], [])
    estimates = noise_estimates(problem, np.ones(2))
    assert not estimates["flow"].alternatives and possible_noises(problem, estimates, []) == {}
    at_zero, jacobian = np.ones(2), np.zeros((2, 0))
    with_noises = replace(problem, noises=possible_noises(problem, estimates, []))
    assert np.isfinite(with_noises.all_data.evidence(at_zero, jacobian).unknown)


def test_the_noise_of_single_values_may_be_larger_than_stated():
    """Twenty values that scatter twice as much as stated; where they scatter as stated, that costs little."""
    values = [
        replace(
            series(quantity="perfusion"), statistic="mean", time=None, value=np.zeros(1), sd=np.ones(1), location=bed
        )
        for bed in map(str, range(20))
    ]
    problem = series_problem([series(), *values])
    estimates = noise_estimates(problem, np.zeros(SAMPLES + 20))
    assert estimates["perfusion"].noise is None and len(estimates["perfusion"].alternatives) > 1
    noisy = replace(problem, noises=possible_noises(problem, {"perfusion": estimates["perfusion"]}, []))
    random = np.random.default_rng(4).standard_normal(20)
    random *= np.sqrt(20.0 / (random @ random))
    gain = {}
    for scale in (1.0, 2.0):
        at_zero, jacobian = np.concatenate([np.zeros(SAMPLES), scale * random]), np.zeros((SAMPLES + 20, 0))
        known, stated = (one.all_data.evidence(at_zero, jacobian).right for one in (noisy, problem))
        gain[scale] = known - stated
    assert gain[2.0] > 5.0 and np.log(0.6) <= gain[1.0] < 0.0


@pytest.mark.parametrize("scale", [1.0, 1.5])
@pytest.mark.parametrize("correlation_time", [0.03, 0.06])
def test_scale_and_correlation_time_are_estimated_together(correlation_time, scale):
    """Their product, that makes the variance of a mean: in 50 trials within a factor of three on average."""
    random, found = np.random.default_rng(3), []
    for _ in range(50):
        noise = [scale * correlated_noise(random, series(number).time, correlation_time) for number in range(SERIES)]
        found.append(estimated_noise(*case(np.array(noise))).get("flow", Noise(1.0)))
    seen = [one for one in found if one.correlation_time > 0.0]
    assert len(seen) >= 45
    # Beyond the first harmonics scale and time are hardly distinguished; the variance of a mean has both.
    variances = np.log([one.scale**2 * one.correlation_time / (scale**2 * correlation_time) for one in seen])
    assert abs(variances.mean()) < np.log(3.0), variances.mean()


@given(st.floats(0.005, 2.0))
def test_the_parts_of_correlated_noise_make_up_its_covariance(correlation_time):
    """The variance in all exactly, and no direction off by more than the shapes without weights differ."""
    one = series()
    white, shapes = white_and_correlated(one, Noise(1.0, correlation_time))
    made = white**2 * np.eye(SAMPLES) + shapes.T @ shapes
    true = correlation(one.time, correlation_time)
    assert np.trace(made) == pytest.approx(SAMPLES)
    assert np.abs(np.linalg.eigvalsh(made - true)).max() <= white**2 + 1e-9


@given(st.floats(0.0, 1.0), st.floats(0.01, 0.5))
def test_correlated_noise_does_not_depend_on_where_a_beat_is_cut(cut, correlation_time):
    one = series()
    moved = replace(one, time=(one.time + cut * PERIOD) % PERIOD)
    covariances = []
    for each in (one, moved):
        white, shapes = white_and_correlated(each, Noise(1.0, correlation_time))
        covariances.append(white**2 * np.eye(SAMPLES) + shapes.T @ shapes)
    np.testing.assert_allclose(covariances[1], covariances[0], atol=1e-6)


def test_the_evidence_of_a_right_model_shows_how_long_noise_lasts():
    """In 50 trials, of six waveforms, more precisely than their scatter beyond the first harmonics alone."""
    random, lasting = np.random.default_rng(8), -PERIOD / SAMPLES / np.log(0.5)
    scatter, evidence = list[float](), list[float]()
    for _ in range(50):
        noise = np.array([1.4 * correlated_noise(random, series(k).time, lasting) for k in range(SERIES)])
        problem = series_problem([replace(series(k), value=np.full(SAMPLES, 50.0)) for k in range(SERIES)])
        estimate = noise_estimates(problem, noise.ravel())["flow"]
        problem.noises = possible_noises(problem, {"flow": replace(estimate, noise=None)}, [])
        found = problem.all_data.evidence(noise.ravel(), np.zeros((noise.size, 0)))
        by_evidence = estimate.chosen(found.noises["flow"])
        for one, errors in ((estimate, scatter), (by_evidence, evidence)):
            errors += [np.log(one.noise.correlation_time / lasting)] if one.noise else []
        assert by_evidence.alternatives == estimate.alternatives
    assert len(evidence) == 50 and len(scatter) >= 40, "the scatter alone does not always show that it lasts"
    by_scatter, by_evidence = (np.sqrt(np.mean(np.square(errors))) for errors in (scatter, evidence))
    # Neighbours of the true correlation differ by 0.3 to 0.4 in the log of the time.
    assert by_evidence < 0.25 and by_evidence < 0.5 * by_scatter, (by_evidence, by_scatter)


def test_waveforms_with_the_stated_noise_rarely_show_another():
    """The scale of another is integrated over, as its best value alone is no evidence: 1.8 % of 2,000, 11 % before."""
    random, trials, others = np.random.default_rng(9), 400, 0
    problem = series_problem([replace(series(k), value=np.full(SAMPLES, 50.0)) for k in range(SERIES)])
    for _ in range(trials):
        others += noise_estimates(problem, random.standard_normal(SERIES * SAMPLES))["flow"].noise is not None
    assert others < 0.01 * trials + 4.0 * np.sqrt(0.01 * trials), others


@given(st.floats(0.5, 5.0), st.floats(0.5, 5.0))
def test_a_larger_noise_takes_the_place_of_one_that_is_known_only_about_a_right_model(scale, known):
    flow, stated = Estimate(Noise(scale, 0.02), ()), Estimate(None, ())
    now, before = {"flow": flow, "pressure": stated}, {"flow": Estimate(Noise(known, 0.03), ()), "pressure": stated}
    assume(not np.isclose(abs(np.log(scale / known)), np.log(SAME_SCALE)))
    less, more = scale * SAME_SCALE < known, known * SAME_SCALE < scale
    assert differing(now, before, right=False) == ({"flow": flow} if less else {})
    assert differing(now, before, right=True) == ({"flow": flow} if less or more else {})


@pytest.mark.parametrize(("now", "known"), [(0.0, 0.03), (0.03, 0.0)])
def test_noise_of_another_kind_takes_the_place_of_one_that_is_known_only_about_a_right_model(now, known):
    """Of a missing effect the noise had looked correlated, and stayed so about that effect, which it refuted."""
    found, before = ({"flow": Estimate(Noise(1.0, time), ())} for time in (now, known))
    assert differing(found, before, right=True) == found and not differing(found, before, right=False)


def test_larger_noise_has_no_shapes():
    white, shapes = white_and_correlated(series(), Noise(1.7))
    assert white == 1.7 and len(shapes) == 0


@pytest.mark.parametrize(("scale", "times"), [(3.0, 3.0), (0.5, 1.0)])
def test_single_values_are_as_uncertain_as_the_waveforms_of_their_quantity_and_no_less_than_stated(scale, times):
    """With flows stated too certain in a whole table, means had shown something else, at 1.00."""
    for noise in Noise(scale), Noise(scale, 0.02):
        white, shapes = white_and_correlated(replace(series(), statistic="mean", time=None), noise)
        assert white == times and len(shapes) == 0


def searched(folder, settings=None, library=SEARCHED):
    conditions = read_conditions(folder / "conditions.yaml")
    files = read_network(folder / "model.json"), folder / "measurements.csv"
    problem = read_problem(*files, conditions, folder / "conditions.yaml", settings or Settings())
    return discover(problem, 1, library)


def in_first_class(truth, found):
    """Whether one class is named, which contains the hidden effect at its place."""
    classes = [[member.placed for member in entry.members] for entry in found.named]
    return len(classes) == 1 and all(placed in classes[0] for placed in truth.hypothesis)


@pytest.mark.long
def test_the_runs_for_known_errors_are_made_once_unless_lasting_noise_asks_for_finer_steps(tmp_path):
    white, lasting = {"flow": Noise(0.8)}, {"flow": Noise(0.8, 0.05)}
    for name, experiment, finer in (("closed", closed_loop(loop()), False), ("open", open_loop(), True)):
        (tmp_path / name).mkdir()
        hide(Case((), "none", "nominal", 5), experiment, tmp_path / name, NATURE)
        problem = read_case(tmp_path / name)
        assert problem.runs is not None
        noisy = with_noise(problem, white)
        assert noisy.runs is problem.runs
        flow = np.array([series.quantity == "flow" for series in problem.forward.measured])[problem.owner]
        assert (noisy.sd[flow] < 0.9 * problem.sd[flow]).all()
        assert noisy.sd[~flow] == pytest.approx(problem.sd[~flow], rel=2e-3), "but for what the time steps leave"
        assert (with_noise(problem, lasting).runs is not problem.runs) is finer


@pytest.mark.long
@pytest.mark.parametrize("seed", [70000, 70003])
def test_a_strong_effect_outside_the_library_is_not_noise(tmp_path, seed):
    """A side vessel carries blood in late diastole alone: it is beyond the first harmonics, too, as noise is."""
    hide(Case((), "medium", "nominal", seed, "thrombosed_side_vessel"), open_loop(), tmp_path, NATURE)
    assert searched(tmp_path).answer.given == OTHER


@pytest.mark.long
def test_what_a_named_effect_explains_is_not_taken_for_noise(tmp_path):
    """A probe in the wrong place reads another waveform, whose sharp features look like noise of six times the size."""
    truth, _ = hide(Case(("misplaced_flow",), "medium", "nominal", 20009), closed_loop(loop()), tmp_path, NATURE)
    found = searched(tmp_path)
    assert in_first_class(truth, found) and not found.noise


@pytest.mark.long
def test_lasting_noise_of_understated_size_is_known_about_the_effect_found(tmp_path):
    """Noise 1.43 times as large as stated, with a correlation of 0.5: what is left is not taken for a misfit."""
    case = Case(("pressure_offset",), "medium", "violated", 91001)
    truth, _ = hide(case, open_loop(), tmp_path, case.nature(NATURE))
    found = searched(tmp_path)
    assert in_first_class(truth, found)
    assert {name: one.scale for name, one in found.noise.items()} == pytest.approx(
        {"flow": 1.43, "pressure": 1.43}, rel=0.2
    )
    assert found.remaining.p > 0.001
    ((_, size, spread),) = found.sizes(truth.hypothesis.effects[0])
    assert abs(size - truth.sizes[0]) < 3.0 * spread


@pytest.mark.long
def test_a_stenosis_is_found_with_underestimated_standard_deviations(tmp_path):
    truth, _ = hide(Case(("quadratic_stenosis",), "medium", "underestimated", 101), open_loop(), tmp_path)
    found = searched(tmp_path)
    assert in_first_class(truth, found)
    assert {name: one.scale for name, one in found.noise.items()} == pytest.approx(
        {"flow": 1.5, "pressure": 1.5}, rel=0.15
    )
    text = paragraph(summary(found))
    assert "scaled accordingly" in text or "times the stated size" in text
    table = pd.read_csv(tmp_path / "measurements.csv")
    assert found.measured[0].sd[0] == pytest.approx(table.sd[0])
    said = searched(tmp_path, Settings(noise="stated"), tuple(placed.effect for placed in truth.hypothesis))
    assert not said.noise


@pytest.mark.long
def test_correlated_noise_raises_no_alarm(tmp_path):
    hide(Case((), "none", "correlated", 101), open_loop(), tmp_path)
    found = searched(tmp_path)
    assert not found.alarm and all(one.correlation_time > 0.0 for one in found.noise.values())
    assert set(found.noise) == {"flow", "pressure"}
    said, made = np.concatenate([one.sd for one in found.measured]), with_correlated(found.problem)
    # Vessels and beds of the case are off, too: what that leaves in the waveforms counts as noise (1.0 to 1.4 on seeds
    # 101 to 108).
    assert 0.95 < np.sqrt(np.mean((made / said) ** 2)) < 1.4
    assert ", correlated over " in paragraph(summary(found))
    said = searched(tmp_path, Settings(noise="stated"))
    assert said.alarm and said.problem.settings.steps_per_cycle < found.problem.settings.steps_per_cycle


@pytest.mark.long
def test_a_stenosis_under_correlated_noise_is_found(tmp_path):
    """Its vessels are off, too, which under such noise may also be something else: it is more probable than that."""
    truth, _ = hide(Case(("quadratic_stenosis",), "medium", "correlated", 100), open_loop(), tmp_path)
    found = searched(tmp_path)
    (entry,), (hidden,) = found.rounds[:1], truth.hypothesis
    assert hidden in [member.placed for member in entry.members]
    assert found.answer.probabilities["names"] > found.answer.probabilities["something else"]
