"""Evidence averaged over plausible noises: against the dense covariance, and in searches where noise is misjudged."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import analyse, hide
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference import gp_discrepancy
from coronaryuq.discrepancy.inference.cross_validation import Linear, of_all
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES
from coronaryuq.discrepancy.inference.possible_noise import PossibleNoise
from coronaryuq.discrepancy.selection.answer import NAMES, NOTHING
from support.series_problem import series_problem, waveform

SAMPLES = 12


@pytest.fixture
def problem():
    """Two waveforms; a nuisance parameter, a shape that stays, and one of the noise that is assumed."""
    random = np.random.default_rng(3)
    time = (np.arange(SAMPLES) + 0.5) / SAMPLES * 0.8
    series = [replace(waveform(time, 0.8, location=place), value=random.normal(5.0, 2.0, SAMPLES)) for place in "ab"]
    weights = [Nuisance("shape", 1.0, shape=0), Nuisance("noise", 1.0, shape=1, noise=True)]
    found = series_problem(series, [Nuisance("parameter", 1.0), *weights])
    return replace(found, forward=replace(found.forward, shapes=random.normal(0.0, 1.0, (2, 2 * SAMPLES))))


def linear(problem, random) -> Linear:
    shapes = (problem.forward.shapes / problem.sd).T
    jacobian = np.column_stack([random.standard_normal(2 * SAMPLES), shapes])
    return Linear(np.array([0.3, -0.2, 0.5]), random.standard_normal(2 * SAMPLES), jacobian)


def dense(problem, model: Linear, variance: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """Log density of the data under one noise, by amplitude."""
    sd = problem.sd
    lasting, parameter = problem.forward.shapes[:1], (model.jacobian[:, :1].T * sd)
    rest = np.diag(sd**2 + variance) + sum(part.T @ part for part in (lasting, parameter, shapes))
    features = gp_discrepancy.features(problem) * sd[:, None]
    return np.array(
        [
            multivariate_normal.logpdf(model.at_zero * sd, cov=rest + amplitude**2 * features @ features.T)
            for amplitude in AMPLITUDES
        ]
    )


def test_the_average_is_that_of_the_densities_of_the_data(problem):
    random = np.random.default_rng(4)
    model, own = linear(problem, random), problem.forward.shapes[1:]
    noises = [
        PossibleNoise(0.0, np.zeros(2 * SAMPLES), own),
        PossibleNoise(-1.0, random.uniform(-0.5, 2.0, 2 * SAMPLES), random.standard_normal((3, 2 * SAMPLES))),
        PossibleNoise(-0.4, random.uniform(-0.5, 2.0, 2 * SAMPLES), np.zeros((0, 2 * SAMPLES))),
    ]
    plain = of_all(problem, model).log_evidence
    averaged = of_all(replace(problem, noises=tuple(noises)), model).log_evidence
    priors = np.array([noise.log_prior for noise in noises])
    each = np.array([dense(problem, model, noise.variance, noise.shapes) for noise in noises])
    expected = logsumexp(each + (priors - logsumexp(priors))[:, None], axis=0)
    assert averaged - plain == pytest.approx(expected - each[0], abs=1e-8)


def test_a_problem_whose_noise_is_the_only_plausible_one_has_its_evidence(problem):
    model = linear(problem, np.random.default_rng(5))
    alone = replace(problem, noises=(PossibleNoise(-7.0, np.zeros(2 * SAMPLES), problem.forward.shapes[1:]),))
    assert of_all(alone, model).log_evidence == pytest.approx(of_all(problem, model).log_evidence, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7000, 10001])
def test_noise_that_lasts_longer_than_it_seems_is_not_something_else(tmp_path, seed):
    """Standard deviations are understated by 0.7, noise has a lag-one correlation of 0.5, vessels and beds are off."""
    hide(Case((), "none", "violated", seed), open_loop(), tmp_path, NATURE)
    answer = analyse(tmp_path).answer
    assert answer.given == NOTHING and answer.probabilities[NOTHING] > 0.75


@pytest.mark.slow
def test_an_effect_is_named_where_noise_lasts_longer_than_it_seems(tmp_path):
    truth, _ = hide(Case(("intramyocardial_pressure",), "medium", "violated", 813), open_loop(), tmp_path, NATURE)
    found = analyse(tmp_path)
    assert found.answer.given == NAMES and list(found.hypothesis) == list(truth.hypothesis)
