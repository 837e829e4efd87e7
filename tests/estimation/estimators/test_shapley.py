"""Shapley effects and total indices against closed forms of linear models with dependent normal inputs."""

from dataclasses import replace
from itertools import combinations
from math import comb

import numpy as np
import pytest

from coronaryuq.bench.estimation.problems import ROW, Trial, as_design
from coronaryuq.core.seeds import generator
from coronaryuq.estimation.estimators import shapley
from coronaryuq.estimation.estimators.folds import assign
from coronaryuq.estimation.estimators.per_row import predict
from coronaryuq.estimation.surrogates.control_variates import Seen
from support.linear_trials import coverage

SLOPES = np.array([1.0, 0.7, -0.3, 0.15])
COVARIANCE = np.array([[1.0, 0.5, 0.0, -0.3], [0.5, 1.5, 0.2, 0.0], [0.0, 0.2, 0.8, 0.1], [-0.3, 0.0, 0.1, 1.2]])


def made(function, covariance, trial=0, n=60, more=1500, noise=0.0):
    """Return a design with normal log θ, and linear or quadratic predictions."""
    rng = generator(5, "shapley", trial)
    x, further = (rng.multivariate_normal(np.zeros(len(covariance)), covariance, size) for size in (n, more))
    y = function(x) + noise * rng.normal(size=n)
    design = as_design(Trial(Seen(x, x[:, 0], x), y, Seen(further, further[:, 0], further)), assign(n, 5, 5, "shapley"))
    return design, predict(design, ROW, simple=True)


def estimated(function, covariance, groups=None, **options):
    design, predictions = made(function, covariance, **options)
    return shapley.effects(design, ROW, predictions, groups=groups)


def explained(slopes, covariance, known):
    """var(E[Y | x_u]) of a linear model."""
    if not known:
        return 0.0
    known = list(known)
    joint = slopes @ covariance[:, known]
    return joint @ np.linalg.solve(covariance[np.ix_(known, known)], joint)


def closed_form(slopes, covariance):
    """Shapley effects by their definition, a sum over all sets of other inputs."""
    d, found = len(slopes), []
    for j in range(d):
        rest = [i for i in range(d) if i != j]
        gains = (
            (explained(slopes, covariance, (*u, j)) - explained(slopes, covariance, u)) / comb(d - 1, size)
            for size in range(d) for u in combinations(rest, size)
        )  # fmt: skip
        found.append(sum(gains) / d)
    return np.array(found) / explained(slopes, covariance, range(d))


def test_two_dependent_inputs_share_as_owen_and_prieur_have_it():
    """Their closed form for a linear model of two correlated normals (2017, section 4)."""
    a, b, rho, sd = 1.0, -0.4, 0.6, 1.5
    cross, total = rho * a * b * sd, a**2 + 2 * rho * a * b * sd + b**2 * sd**2
    first = (a**2 * (1 - rho**2 / 2) + cross + b**2 * sd**2 * rho**2 / 2) / total
    covariance = np.array([[1.0, rho * sd], [rho * sd, sd**2]])
    got = estimated(lambda x: a * x[:, 0] + b * x[:, 1], covariance, more=20000)
    assert got.shapley["theta_0"].value == pytest.approx(first, abs=0.01)
    assert closed_form(np.array([a, b]), covariance)[0] == pytest.approx(first)


def test_effects_of_four_dependent_inputs_add_up_to_one_and_equal_the_closed_form():
    got = estimated(lambda x: x @ SLOPES, COVARIANCE, more=20000)
    values = [value.value for value in got.shapley.values()]
    assert sum(values) == pytest.approx(1, abs=1e-9)
    assert values == pytest.approx(closed_form(SLOPES, COVARIANCE), abs=0.01)
    whole = explained(SLOPES, COVARIANCE, range(4))
    total = [1 - explained(SLOPES, COVARIANCE, [i for i in range(4) if i != j]) / whole for j in range(4)]
    assert [value.value for value in got.total.values()] == pytest.approx(total, abs=0.01)


def test_an_interaction_is_shared_by_its_inputs_and_counts_in_both_total_indices():
    """Y = x_0 x_1 + x_2² / √2 of independent normals: half of the variance each."""
    got = estimated(lambda x: x[:, 0] * x[:, 1] + x[:, 2] ** 2 / np.sqrt(2), np.eye(3), n=200, more=20000)
    assert [value.value for value in got.shapley.values()] == pytest.approx([0.25, 0.25, 0.5], abs=0.03)
    assert [value.value for value in got.total.values()] == pytest.approx([0.5, 0.5, 0.5], abs=0.03)


def test_inputs_that_determine_each_other_share_equally_and_have_no_total_index():
    """A preserved total: x_1 = −x_0."""
    covariance = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    got = estimated(lambda x: x[:, 0] + x[:, 2], covariance, more=5000)
    assert [value.value for value in got.shapley.values()] == pytest.approx([0.25, 0.25, 0.5], abs=0.03)
    assert got.total["theta_0"].value == pytest.approx(0, abs=1e-6)


def test_a_group_counts_as_one_input():
    slopes = SLOPES[:3]
    got = estimated(lambda x: x @ slopes, np.diag([1.0, 2.0, 3.0]), more=20000, groups={"both": ["theta_0", "theta_2"]})
    parts = slopes**2 * [1, 2, 3] / np.sum(slopes**2 * [1, 2, 3])
    assert {name: value.value for name, value in got.shapley.items()} == pytest.approx(
        {"both": parts[0] + parts[2], "theta_1": parts[1]}, abs=0.02
    )


def test_predictions_that_no_polynomial_explains_carry_a_warning():
    design, predictions = made(lambda x: x[:, 0], np.eye(2))
    steps = [np.sign(np.sin(6 * block.log_theta[:, 0])) for block in design.blocks]
    found = shapley.effects(design, ROW, replace(predictions, raw=steps))
    assert "of the variance of the predictions" in found.shapley["theta_0"].warning
    assert shapley.effects(design, ROW, predictions).shapley["theta_0"].warning is None


@pytest.mark.long
def test_intervals_hold_the_error_of_prediction_and_propagation():
    """Runs with noise of a third of the spread and few propagation samples: both parts matter.

    Least squares does not shrink, so the square of its error counts twice in small effects.
    """
    truth, trials = closed_form(SLOPES, COVARIANCE), 60
    found = [estimated(lambda x: x @ SLOPES, COVARIANCE, trial=trial, more=300, noise=0.5) for trial in range(trials)]
    for name, effect in zip(found[0].shapley, truth, strict=True):
        of = [got.shapley[name] for got in found]
        values = np.array([value.value for value in of])
        assert coverage(of, effect) >= 0.95 - 3 * np.sqrt(0.95 * 0.05 / trials)
        assert np.sqrt(np.mean([value.std**2 for value in of])) > 0.7 * values.std()
        if effect > 0.1:
            assert np.sqrt(np.mean([value.std**2 for value in of])) == pytest.approx(values.std(), rel=0.3)
            assert abs(values.mean() - effect) < 4 * values.std() / np.sqrt(trials)


@pytest.mark.parametrize("share", [0.12, 0.4])
def test_a_choice_has_the_share_of_its_variance(share):
    """Of y = b + z / 2, b the choice of 1 with probability p, its effect is p (1 - p) / (p (1 - p) + 1 / 4)."""
    rng = generator(5, "shapley", "choice")
    values = [np.column_stack([rng.uniform(size=m) < share, rng.normal(size=m)]).astype(float) for m in (200, 3000)]
    (x, further), y = values, values[0] @ [1.0, 0.5]
    design = as_design(
        Trial(Seen(x, x[:, 0], x), y, Seen(further, further[:, 0], further)), assign(200, 5, 5, "choice")
    )
    found = shapley.effects(design, ROW, predict(design, ROW, simple=True)).shapley
    variance = share * (1 - share)
    choice, other = found.values()
    # The expansion follows a step with a few polynomials; what it misses is shared by neither.
    assert choice.value == pytest.approx(variance / (variance + 0.25), abs=0.12)
    assert choice.value + other.value == pytest.approx(1.0, abs=1e-6)
