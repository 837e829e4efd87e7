"""Evidence averaged over noises and places of something else: against dense covariances, and in whole searches."""

from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from coronaryuq.bench.discrepancy import recordings_outside
from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import analyse, hide
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.decision_rule import RULE
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.cross_validation import of_all
from coronaryuq.discrepancy.inference.evidence import LEAST, PossibleNoise
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES, RIGHT, UNKNOWN
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.inference.noise import OF_VALUES
from coronaryuq.discrepancy.selection.answer import NAMES, NOTHING, OTHER, without_effects
from support.series_problem import series_problem, waveform

SAMPLES = 12
PLACES = (("pressure", "a", "rest"), ("pressure", "b", "rest"), ("pressure", "b", "pacing"), ("flow", "a", "rest"))
FLOW = slice(SAMPLES * 3, SAMPLES * 4)
ROWS = SAMPLES * len(PLACES)


@pytest.fixture
def problem():
    """Four waveforms; a nuisance parameter, a shape that stays, and one of the noise of the flow that is assumed."""
    random = np.random.default_rng(3)
    time = (np.arange(SAMPLES) + 0.5) / SAMPLES * 0.8
    series = [
        replace(waveform(time, 0.8, condition, quantity, place), value=random.normal(5.0, 2.0, SAMPLES))
        for quantity, place, condition in PLACES
    ]
    weights = [Nuisance("shape", 1.0, shape=0), Nuisance("noise", 1.0, shape=1, noise=True)]
    found = series_problem(series, [Nuisance("parameter", 1.0), *weights])
    shapes = random.normal(0.0, 1.0, (2, ROWS))
    shapes[1, : FLOW.start] = 0.0
    return replace(found, forward=replace(found.forward, shapes=shapes))


@pytest.fixture
def noises(problem):
    """Two of the pressure, and three of the flow, of which the first is the one that is assumed."""
    random = np.random.default_rng(5)

    def noise(log_prior, count, rows):
        variance, shapes = np.zeros(ROWS), np.zeros((count, ROWS))
        variance[rows] = random.uniform(-0.5, 2.0, rows.stop - rows.start)
        shapes[:, rows.stop - SAMPLES : rows.stop] = random.standard_normal((count, SAMPLES))
        return PossibleNoise(log_prior, variance, shapes)

    pressure, flow = slice(0, FLOW.start), FLOW
    assumed = PossibleNoise(-0.3, np.zeros(ROWS), problem.forward.shapes[1:])
    return {
        "pressure": (noise(0.0, 0, pressure), noise(-1.0, 3, pressure)),
        "flow": (assumed, noise(-0.4, 0, flow), noise(0.2, 2, flow)),
    }


def linear(problem) -> Linear:
    random = np.random.default_rng(4)
    shapes = (problem.forward.shapes / problem.sd).T
    jacobian = np.column_stack([random.standard_normal(ROWS), shapes])
    return Linear(np.array([0.3, -0.2, 0.5]), random.standard_normal(ROWS), jacobian)


def smooth(problem, common=False) -> np.ndarray:
    return gp_discrepancy.features(problem, common)


def rough(problem) -> np.ndarray:
    """Every sample by itself, by the largest value of its waveform."""
    largest = [np.full(one.value.size, np.abs(one.value).max()) for one in problem.forward.measured]
    return np.diag(np.concatenate(largest) / problem.sd)


def density(problem, model: Linear, noise: tuple[PossibleNoise, ...], amplitudes: np.ndarray, features) -> float:
    """Log density of the data under one noise, with an amplitude of something else in each row."""
    sd = problem.sd
    parts = [problem.forward.shapes[:1], model.jacobian[:, :1].T * sd, *(one.shapes for one in noise)]
    parts.append((features(problem) * (sd * amplitudes)[:, None]).T)
    variance = sd**2 + sum(one.variance for one in noise)
    covariance = np.diag(variance) + sum(part.T @ part for part in parts)
    return float(multivariate_normal.logpdf(model.at_zero * sd, cov=covariance))


def averaged(problem, noises, of_one) -> float:
    """Log mean over all pairs of noises of a log density."""
    pairs = list(product(noises["pressure"], noises["flow"]))
    priors = np.array([pressure.log_prior + flow.log_prior for pressure, flow in pairs])
    return float(logsumexp(priors - logsumexp(priors) + [of_one(pair) for pair in pairs]))


def test_noise_that_series_share_is_the_same_in_all_of_them(problem):
    """As the drift of a wire in a pullback and in its check: with one noise, the evidence is that of the fits."""
    shapes = np.vstack([problem.forward.shapes, np.random.default_rng(6).standard_normal(ROWS)])
    nuisances = [*problem.forward.nuisances, Nuisance("drift", 1.0, shape=2, noise=True)]
    shared = replace(problem, forward=replace(problem.forward, nuisances=nuisances, shapes=shapes))
    own = linear(problem)
    model = Linear(np.append(own.z, 0.4), own.residual, np.column_stack([own.jacobian, shapes[2] / problem.sd]))
    found, plain = (
        one.all_data.evidence(each.at_zero, each.jacobian).right - of_all(one, each).right
        for one, each in ((shared, model), (problem, own))
    )
    assert found == pytest.approx(plain, abs=1e-6)


def test_the_evidence_is_the_mean_of_the_densities_of_the_data(problem, noises):
    model = linear(problem)
    of_own = density(problem, model, noises["flow"][:1], np.zeros(ROWS), smooth)
    constant = float(of_all(problem, model).log_evidence[0]) - of_own
    found = replace(problem, noises=noises).all_data.evidence(model.at_zero, model.jacobian, 2.5)

    def in_rows(rows: np.ndarray, prior: np.ndarray, pair, features=smooth) -> float:
        return float(logsumexp(prior + [density(problem, model, pair, a * rows, features) for a in AMPLITUDES]))

    def rows_of(*where: int) -> list[np.ndarray]:
        """The rows of every combination of quantity (0), place (1) and condition (2)."""
        each = [tuple(waveform[k] for k in where) for waveform in PLACES]
        return [np.repeat([1.0 * (one == own) for one in each], SAMPLES) for own in dict.fromkeys(each)]

    shared = partial(smooth, common=True)
    right = averaged(problem, noises, lambda pair: in_rows(np.ones(ROWS), RIGHT, pair))
    assert found.right == pytest.approx(right + constant - 2.5, abs=1e-7)
    forms = [rows_of(), rows_of(0), rows_of(0, 1), rows_of(0, 1, 2), rows_of(0, 2), rows_of(2)]

    def anywhere(pair) -> float:
        each = [[in_rows(rows, UNKNOWN, pair) for rows in form] for form in forms]
        for where, features in ((0,), shared), ((0, 2), shared), ((0, 1), rough):
            each.append([in_rows(rows, UNKNOWN, pair, features) for rows in rows_of(*where)])
        return float(logsumexp([logsumexp(form) - np.log(len(form)) for form in each]) - np.log(9.0))

    assert found.unknown == pytest.approx(averaged(problem, noises, anywhere) + constant - 2.5, abs=1e-6)
    assert len(found.shown) == 1 + 2 + 3 + 4 + 3 + 2
    at_b, paced = rows_of(0, 1)[1], rows_of(0, 2)[1]
    for where, rows, shapes in (("b", ""), at_b, (smooth, rough)), (("", "pacing"), paced, (smooth, shared)):
        each = [averaged(problem, noises, partial(in_rows, rows, UNKNOWN, features=one)) for one in shapes]
        only = logsumexp(each) - np.log(9.0 * 3.0)
        assert found.shown["pressure", *where] == pytest.approx(only + constant - 2.5, abs=1e-6)


def test_without_other_noises_a_right_model_has_the_evidence_of_its_posterior(problem):
    model = linear(problem)
    posterior = of_all(problem, model)
    assert problem.all_data.evidence(model.at_zero, model.jacobian).right == pytest.approx(posterior.right, abs=1e-9)


def test_something_else_in_single_values_alone_exceeds_their_noise(problem):
    """With one waveform and a mean it is in both, or in one of them, of the mean at least three standard deviations.

    Each is all that is read of its quantity, at its place and under its condition.
    """
    mean = {"statistic": "mean", "value": np.array([3.0]), "sd": np.array([1.0]), "time": None}
    series = [problem.forward.measured[0], replace(problem.forward.measured[3], condition="pacing", **mean)]
    small = series_problem(series, [Nuisance("parameter", 1.0)])
    random = np.random.default_rng(6)
    at_zero, jacobian = random.standard_normal(SAMPLES + 1), random.standard_normal((SAMPLES + 1, 1))
    found = small.all_data.evidence(at_zero, jacobian).unknown

    def in_rows(rows: np.ndarray, features: np.ndarray) -> float:
        covariances = [
            np.eye(SAMPLES + 1)
            + jacobian @ jacobian.T
            + (a * rows[:, None] * features) @ (a * rows[:, None] * features).T
            for a in AMPLITUDES
        ]
        densities = [multivariate_normal.logpdf(at_zero, cov=covariance) for covariance in covariances]
        return float(logsumexp(UNKNOWN + densities))

    waves, least = np.r_[np.ones(SAMPLES), 0.0], AMPLITUDES[np.isfinite(UNKNOWN)][0]
    both, one, by_sample = (
        in_rows(np.ones(SAMPLES + 1), smooth(small)),
        in_rows(waves, smooth(small)),
        in_rows(waves, rough(small)),
    )
    gross = in_rows(1.0 - waves, np.eye(SAMPLES + 1) * LEAST / least)
    constant = 0.5 * (SAMPLES + 1) * np.log(2.0 * np.pi)
    either = logsumexp([one, gross]) - np.log(2.0)
    assert found == pytest.approx(logsumexp([both, *7 * [either], by_sample]) - np.log(9.0) + constant, abs=1e-7)


def means(random, wrong: float = 0.0):
    """What nothing and something else weigh by 24 means, of which two pressures under one condition are wrong."""
    places = [(quantity, place) for quantity in ("pressure", "flow") for place in "abcd"]
    conditions = ("rest", "hyperaemia", "pacing")
    values = {"pressure": (90.0, 1.0), "flow": (2.0, 0.1)}
    series = [
        Measured(condition, quantity, place, "mean", None, 0.8, *(np.array([number]) for number in values[quantity]))
        for condition in conditions
        for quantity, place in places
    ]
    problem = series_problem(series, [Nuisance("parameter", 1.0)])
    of_values = [PossibleNoise(float(np.log(p)), np.zeros(24), np.zeros((0, 24))) for p in OF_VALUES.values()]
    is_of = {q: np.array([one.quantity == q for one in series]) for q in values}
    noises = {
        q: tuple(
            replace(one, variance=is_of[q] * (scale**2 - 1.0) * problem.sd**2)
            for one, scale in zip(of_values, OF_VALUES, strict=True)
        )
        for q in values
    }
    at_zero = random.standard_normal(24)
    at_zero[8:10] += wrong * np.array([1.0, -1.0])
    evidence = replace(problem, noises=noises).all_data.evidence(at_zero, random.standard_normal((24, 1)))
    nothing, something = without_effects(evidence)
    return 1.0 / (1.0 + np.exp(something - nothing)), evidence.shown


def test_two_wrong_means_under_one_condition_are_something_else():
    """Eight standard deviations each, which their noise, even if 2.25 times as large as stated, explained before."""
    found = []
    for number in range(10):
        nothing, shown = means(generator(1, "test", "wrong means", number), 8.0)
        assert max(shown, key=lambda where: shown[where]) == ("pressure", "", "hyperaemia")
        found.append(nothing)
    assert np.mean(found) < 0.2 and max(found) < 0.5


def test_means_that_are_right_are_seldom_something_else():
    """In 200 trials nothing has the probability that the priors leave it, and below a half no more often than that."""
    found = np.array([means(generator(2, "test", "right means", number))[0] for number in range(200)])
    assert found.mean() > 0.93
    # Where nothing is missing, odds above one against it have at most half the prior's chance (Markov).
    assert (found < 0.5).sum() <= 200 * 0.5 * RULE.prior_outside / RULE.prior_none


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7000, *(pytest.param(seed, marks=pytest.mark.long) for seed in (10001, 42009))])
def test_noise_that_lasts_longer_than_it_seems_is_not_something_else(tmp_path, seed):
    """Standard deviations are understated by 0.7, noise has a lag-one correlation of 0.5, vessels and beds are off."""
    hide(Case((), "none", "violated", seed), open_loop(), tmp_path, NATURE)
    assert analyse(tmp_path).answer.given == NOTHING


@pytest.mark.long
def test_an_effect_is_named_where_noise_lasts_longer_than_it_seems(tmp_path):
    truth, _ = hide(Case(("intramyocardial_pressure",), "medium", "violated", 813), open_loop(), tmp_path, NATURE)
    found = analyse(tmp_path)
    assert found.answer.given == NAMES and list(found.hypothesis) == list(truth.hypothesis)


@pytest.mark.slow
@pytest.mark.parametrize("effect", [pytest.param("channel_crosstalk", marks=pytest.mark.long), "quantised_recording"])
def test_something_else_at_one_place_is_seen_there_among_the_undisturbed(tmp_path, monkeypatch, effect):
    drawn = []
    one_of = recordings_outside.one_of
    monkeypatch.setattr(recordings_outside, "one_of", lambda *given: drawn.append(one_of(*given)) or drawn[-1])
    hide(Case((), "medium", "nominal", 5000, effect), open_loop(), tmp_path, NATURE)
    answer = analyse(tmp_path).answer
    assert answer.probabilities[OTHER] > 0.95
    shown = max(answer.shown, key=lambda where: answer.shown[where])
    assert shown[:2] in drawn and not shown[2] and answer.shown[shown] > 0.9


@pytest.mark.long
@pytest.mark.parametrize("size", [0.2, 0.4])
def test_an_error_that_all_probes_share_under_one_condition_is_no_lasting_noise(tmp_path, size):
    """All flows rise over the beat in hyperaemia, about the right means: a recording whose gain drifts."""
    hide(Case((), "none", "nominal", 7000), open_loop(), tmp_path, NATURE)
    table = pd.read_csv(tmp_path / "measurements.csv", comment="#")
    wrong = (table.condition == "hyperaemia") & (table.quantity == "flow") & table.time.notna()
    phase = table.time / table.time[wrong].max()
    table.loc[wrong, "value"] *= 1.0 + size * (2.0 * phase[wrong] - 1.0)
    table.to_csv(tmp_path / "measurements.csv", index=False)
    answer = analyse(tmp_path).answer
    assert answer.probabilities[OTHER] > 0.95
    assert max(answer.shown, key=lambda where: answer.shown[where]) in (("flow", "", "hyperaemia"), ("flow", "", ""))
