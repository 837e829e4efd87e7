"""One size under all conditions, or a different one under each: exact if linear, and for a drifting vessel."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp, softmax

from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import analyse, hide
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES, RIGHT
from coronaryuq.discrepancy.inference.gauss_newton import Linear
from coronaryuq.discrepancy.result.summary_text import paragraph
from coronaryuq.discrepancy.result.write import summary
from coronaryuq.discrepancy.selection.size_constancy import FLAT, Constancy, constancy
from coronaryuq.zerod.effects.base import Parameter
from support.hypotheses import assume
from support.linear_problem import linear_problem, made_up

CONDITIONS = np.repeat(["rest", "hyperaemia", "pacing"], 20)
NUISANCES = 2
HYPOTHESIS = assume((made_up("made up"), "here"))


def case(random, sizes=None):
    """Sensitivities (60, 3), the size's last, and data with one size for all conditions, or these."""
    g = random.standard_normal((60, NUISANCES + 1))
    z = random.standard_normal(NUISANCES + 1)
    size = z[-1] if sizes is None else np.repeat(sizes, 20)
    return g, g[:, :-1] @ z[:-1] + g[:, -1] * size + random.standard_normal(60)


def judged(g, y, held_out=(), hypothesis=HYPOTHESIS):
    z = np.linalg.solve(np.eye(g.shape[1]) + g.T @ g, g.T @ y)
    problem = linear_problem(np.zeros((60, NUISANCES)), {}, y, CONDITIONS, held_out)
    return constancy(problem, Linear(z, y - g @ z, g), hypothesis)[0]


def apart(g):
    return np.column_stack([g[:, -1] * (name == CONDITIONS) for name in dict.fromkeys(CONDITIONS)])


def test_the_odds_are_those_of_two_gaussian_densities():
    g, y = case(generator(1, "test", "constancy"))
    # One size of its own each, less what is common to them, which may be any.
    common = np.full((3, 3), 1.0 / 3.0)
    g = g * [1.0, 1.0, FLAT]
    wide = np.hstack([g, apart(g) / FLAT @ (np.eye(3) - common)])
    problem = linear_problem(np.zeros((60, NUISANCES)), {}, y, CONDITIONS)
    features = gp_discrepancy.features(problem)
    evidences = []
    for matrix in (wide, g):
        models = [np.eye(60) + matrix @ matrix.T + (a**2) * features @ features.T for a in AMPLITUDES]
        densities = [stats.multivariate_normal(np.zeros(60), model).logpdf(y) for model in models]
        evidences.append(logsumexp(densities + RIGHT))
    assert judged(g / [1.0, 1.0, FLAT], y).log_odds == pytest.approx(evidences[0] - evidences[1], rel=1e-4)


def test_sizes_are_those_of_the_wider_model():
    g, y = case(generator(2, "test", "constancy"), (2.0, 0.0, -2.0))
    wide = np.hstack([g, apart(g)])
    features = gp_discrepancy.features(linear_problem(np.zeros((60, NUISANCES)), {}, y, CONDITIONS))
    weights, means, covariances = [], [], []
    for amplitude, prior in zip(AMPLITUDES, RIGHT, strict=True):
        noise = np.eye(60) + amplitude**2 * features @ features.T
        covariances.append(np.linalg.inv(np.eye(wide.shape[1]) + wide.T @ np.linalg.solve(noise, wide)))
        means.append(covariances[-1] @ wide.T @ np.linalg.solve(noise, y))
        weights.append(prior + stats.multivariate_normal(np.zeros(60), noise + wide @ wide.T).logpdf(y))
    weights = softmax(weights)
    mean = weights @ means
    covariance = np.einsum("t,tij->ij", weights, covariances) + np.cov(np.array(means).T, aweights=weights, ddof=0)
    for number, (found, sd) in enumerate(judged(g, y).sizes.values()):
        both = [NUISANCES, NUISANCES + 1 + number]
        assert found == pytest.approx(mean[both].sum())
        assert sd == pytest.approx(np.sqrt(covariance[np.ix_(both, both)].sum()))


def test_sizes_of_a_narrow_prior_differ_by_a_factor_as_in_the_odds():
    """A positive size of which the prior allows 10 % may differ by a factor of two: 7 of its standard deviations."""
    g, y = case(generator(4, "test", "constancy"), (2.0, 0.0, -2.0))
    narrow = assume((made_up("made up", Parameter("size", "-", "lognormal", 1.0, 0.1, "made up")), "here"))
    y = y + 20.0 * apart(g)[:, 0]
    found, (size, sd) = judged(g, y, hypothesis=narrow), judged(g, y, hypothesis=narrow).sizes["rest"]
    assert size == pytest.approx(22.0, abs=4.0 * sd) and sd < 0.5 and found.log_odds > 100.0


@pytest.mark.slow
def test_one_size_rarely_seems_to_vary():
    """A Bayes factor exceeds e^3 with a chance of e^-3 at most where one size is true; and four standard errors."""
    trials, odds = 1000, 3.0
    random = generator(3, "test", "constancy")
    often = sum(judged(*case(random)).log_odds > odds for _ in range(trials))
    bound = np.exp(-odds)
    assert often <= trials * bound + 4.0 * np.sqrt(trials * bound)


def test_a_size_far_out_in_its_prior_does_not_seem_to_vary():
    """Its mean over the conditions says nothing of their differences."""
    random = generator(5, "test", "constancy")
    assert not any(judged(*case(random, (9.0, 9.0, 9.0))).log_odds > 3.0 for _ in range(50))


def test_a_size_that_is_nearly_known_differs_if_the_effect_comes_and_goes():
    """Two channels are exchanged by 95 to 105 %: by as little no data see them differ, and absence is what matters."""
    exchanged = assume((made_up("exchanged", Parameter("share", "1", "lognormal", 1.0, 0.05, "")), "here"))
    odds = []
    for number in range(20):
        random = generator(8, "test", "constancy", number)
        g, _ = case(random)
        g[:, -1] *= 0.05
        y = g[:, :-1] @ random.standard_normal(NUISANCES) + random.standard_normal(60)
        absent = y - 20.0 * g[:, -1] * (CONDITIONS == "pacing")
        odds.append([judged(g, data, hypothesis=exchanged).log_odds for data in (y, absent)])
    present, in_some = np.mean(odds, axis=0)
    assert present < -1.0 and in_some > 2.0


def test_sizes_that_differ_are_seen():
    random = generator(4, "test", "constancy")
    assert all(judged(*case(random, (0.0, 1.5, 3.0))).log_odds > 3.0 for _ in range(50))


def test_a_size_that_differs_under_the_held_out_condition_is_seen():
    random = generator(6, "test", "constancy")
    assert all(judged(*case(random, (1.5, 1.5, -1.5)), ["pacing"]).log_odds > 3.0 for _ in range(50))


@pytest.mark.long
def test_a_drifting_vessel_is_not_named_as_a_narrowing(tmp_path):
    """Its resistance differs between conditions, which a flexible discrepancy alone does not predict better here."""
    hide(Case((), "medium", "nominal", 701, "drifting_vessel"), open_loop(), tmp_path)
    found = analyse(tmp_path)
    assert found.hypothesis and found.outside_library and not found.named
    assert max(entry.log_odds for entry in found.answer.varying) > 20.0
    text = paragraph(summary(found))
    assert "would need a different size under each condition" in text


@pytest.mark.long
def test_a_narrowing_has_one_size(tmp_path):
    hide(Case(("diffuse_narrowing",), "medium", "nominal", 701), open_loop(), tmp_path)
    found = analyse(tmp_path)
    assert [entry.named.effect.name for entry in found.named] == ["diffuse_narrowing"] and not found.answer.varying


def test_uninformed_conditions_are_left_out():
    """Without sensitivity under one condition its size is the prior's, wider than any that data tell of."""
    g, y = case(generator(5, "test", "constancy"), (2.0, 0.0, -2.0))
    g[CONDITIONS == "pacing", -1] = 0.0
    found = judged(g, y)
    assert found.sizes["pacing"][1] > 1.0
    assert list(found.known) == ["rest", "hyperaemia"]
    assert list(Constancy(None, 5.0, {"a": (0.0, 0.9), "b": (9.0, 0.8), "c": (1.0, 1.2)}).known) == ["a", "b"]
