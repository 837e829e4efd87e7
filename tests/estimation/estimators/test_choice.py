"""Which estimator is recommended, over repeated trials in which the best one is known."""

from dataclasses import replace

import numpy as np

from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import choice
from coronaryuq.estimation.estimators.crossfit import CrossFit, Options, Propagated, combine
from coronaryuq.estimation.estimators.dependence import INDEPENDENT, Dependence, Segments


def plain(y, dependence=INDEPENDENT):
    fit = CrossFit(y, np.zeros(len(y)), [Propagated(np.zeros(1))], np.zeros(len(y), int), dependence)
    return combine("", fit, len(y), Options(beta=0.0))


def test_the_standard_error_of_a_difference_of_variances_is_that_of_repeated_trials():
    draw, differences, found = generator(5, "choice"), [], []
    for _ in range(400):
        x = draw.normal(size=(2, 60))
        one, other = plain(x[0]), plain(0.8 * x[0] + 0.6 * x[1])
        differences.append(one.std**2 - other.std**2)
        found.append(choice.uncertainty(one, other))
    # The scatter of a standard deviation of 400 trials is 3.5 %, that of the reported value far less.
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(found))), np.std(differences), rtol=3 * 0.035)


def test_runs_of_one_segment_count_as_one():
    """Six copies of each run in its own segment: the variances are those of single runs, as is their uncertainty."""
    x = generator(5, "segments").normal(size=(2, 12))
    label = np.repeat(np.arange(12), 6)
    repeated = [plain(np.repeat(values, 6), Dependence(pilot=Segments(label, label))) for values in x]
    once = [plain(values) for values in x]
    assert np.isclose(repeated[0].std, once[0].std)
    # Segments of two lengths are allowed for: a variance from them is three times as uncertain.
    factors = [np.sum(a.contributions.pilot**2) / a.residual_variance for a in repeated]
    assert max(factors) < 1.01
    assert 1 < choice.uncertainty(*repeated) / choice.uncertainty(*once) < 3


def test_of_equal_estimators_the_usual_one_is_recommended_however_the_variances_fell():
    """Choosing the smallest variance would take MFMC in half of the trials, always where its variance is too small."""
    draw, taken = generator(5, "equal"), []
    for _ in range(200):
        x = draw.normal(size=(2, 50))
        made = {"MC": plain(3 * x[0]), "MFMC": plain(x[0]), "crossfit-GP": plain(x[1])}
        taken.append(choice.recommended(made) == "MFMC")
    # Beyond one standard error of a normal difference: 16 %, with the scatter of 200 trials.
    assert np.mean(taken) < 0.16 + 3 * (0.16 * 0.84 / 200) ** 0.5


def test_a_clearly_smaller_variance_is_taken_and_an_unsound_one_never():
    draw = generator(5, "clear")
    x = draw.normal(size=60)
    made = {"MC": plain(x), "MFMC": plain(0.1 * x), "crossfit-GP": plain(0.5 * draw.normal(size=60))}
    assert choice.recommended(made) == "MFMC"
    assert choice.recommended(made | {"MFMC": replace(made["MFMC"], sound=False)}) == "crossfit-GP"
    unsound = {name: replace(made[name], sound=False) for name in ("MFMC", "crossfit-GP")}
    assert choice.recommended(made | unsound) == "MC"


def test_a_control_variate_that_one_run_spoils_is_not_preferred_to_none():
    """One residual as large as all others together is no significant difference, but neither a gain."""
    x = generator(5, "spoilt").normal(size=25)
    spoilt = 0.1 * x
    spoilt[3] = 12.0
    assert choice.recommended({"MC": plain(x), "crossfit-GP": plain(spoilt)}) == "MC"
