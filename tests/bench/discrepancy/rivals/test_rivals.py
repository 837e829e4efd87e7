"""Every rival finds an easy effect in a real case, and says nothing where nothing is hidden."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.benchmark import NATURE, run
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.rivals import compare
from coronaryuq.bench.discrepancy.rivals.adapter import look
from coronaryuq.bench.discrepancy.rivals.classifier import Classifier, Features, decided
from coronaryuq.bench.discrepancy.rivals.compare import LEVEL
from coronaryuq.bench.discrepancy.rivals.forward_selection import ForwardSelection
from coronaryuq.bench.discrepancy.rivals.gaussian_process import GaussianProcess, discrepancy
from coronaryuq.bench.discrepancy.rivals.score_tests import ScoreTests
from coronaryuq.bench.discrepancy.rivals.sparse_regression import SparseRegression, select
from coronaryuq.bench.discrepancy.rivals.training_cases import NONE, OTHER, training_cases
from coronaryuq.bench.discrepancy.trial import hide
from coronaryuq.discrepancy.inference.flexible import AMPLITUDES, Flexible
from coronaryuq.discrepancy.inference.gauss_newton import Fit

RIVALS = [ForwardSelection(LEVEL), SparseRegression(LEVEL), GaussianProcess(LEVEL), ScoreTests(LEVEL)]


@pytest.fixture(scope="module")
def experiment():
    return open_loop()


@pytest.fixture(scope="module")
def easy(experiment, tmp_path_factory):
    folder = tmp_path_factory.mktemp("easy")
    truth, _ = hide(Case(("flow_gain",), "strong", "nominal", 31), experiment, folder)
    assert truth.visible > 20.0
    return look(folder), truth.hypothesis.effects[0].key


@pytest.fixture(scope="module")
def nothing(experiment, tmp_path_factory):
    folder = tmp_path_factory.mktemp("nothing")
    hide(Case((), "none", "nominal", 31), experiment, folder)
    return look(folder)


@pytest.fixture(scope="module")
def subjects(experiment):
    """Training cases of the five subjects that come first."""
    return list(training_cases(experiment, NATURE, 5))


@pytest.mark.slow
@pytest.mark.parametrize("rival", RIVALS, ids=lambda rival: rival.name)
def test_an_easy_effect_is_named_and_nothing_where_nothing_is_hidden(rival, easy, nothing):
    seen, hidden = easy
    found = rival.answer(seen)
    assert found.alarmed and found.classes[0][0].key == hidden
    found = rival.answer(nothing)
    assert not found.alarmed and found.classes == ()


@pytest.mark.long
def test_the_classifier_learns_from_other_seeds(subjects, easy):
    """With four subjects, 80 of 80 cases with nothing hidden were "nothing": at least 0.96, so 16 of 20 at least."""
    *batches, held_back = subjects
    labels = [case.label for batch in batches for case in batch]
    assert labels.count(NONE) == 80 and OTHER in labels and len(set(labels)) > 80
    rival, extract = Classifier.trained(batches), Features(held_back[0].problem)
    answers = [(case.label, decided(rival.votes(extract(case.fit)))) for case in held_back]
    assert sum(answer == NONE for hidden, answer in answers if hidden == NONE) >= 16
    assert sum(answer == NONE for hidden, answer in answers if hidden != NONE) <= 6, "0.01 of ninety"
    seen, hidden = easy
    found = rival.answer(seen)
    assert hidden in [placed.key for placed in found.classes[0]] and 0.0 < found.probability < 1.0


def test_sparse_regression_selects_the_columns_of_which_the_data_are_made():
    random = np.random.default_rng(3)
    columns = random.standard_normal((300, 40))
    columns /= np.linalg.norm(columns, axis=0)
    data = 30.0 * columns[:, 7] - 15.0 * columns[:, 21] + random.standard_normal(300)
    assert select(columns, data) == [7, 21]
    assert select(columns, np.zeros(300)) == [] and select(columns[:, :0], data) == []


def test_discrepancy_is_the_mean_of_the_process():
    """C = 1 + GG' + K with K the covariance of the process: its mean is K C^-1 e0."""
    random = np.random.default_rng(4)
    features, jacobian = random.standard_normal((20, 6)), random.standard_normal((20, 3))
    features[:12, 3:], features[12:, :3] = 0.0, 0.0
    flexible = Flexible(30.0 * features, np.repeat([0, 1], [12, 8]))
    fit = Fit(np.zeros(3), random.standard_normal(20), jacobian, flexible=flexible)
    number = len(AMPLITUDES) - 3
    prior = (30.0 * AMPLITUDES[number]) ** 2 * features @ features.T
    wanted = prior @ np.linalg.solve(np.eye(20) + jacobian @ jacobian.T + prior, fit.at_zero)
    assert discrepancy(fit, number) == pytest.approx(wanted)


@pytest.mark.long
def test_the_benchmark_lets_rivals_answer(experiment, subjects, monkeypatch):
    def first_of(used, nature, count):
        assert used.network == experiment.network and nature == NATURE and count < len(subjects)
        return subjects[:count]

    monkeypatch.setattr(compare, "training_cases", first_of)
    found = run(quick=True, effects=("none",), rivals=True)
    (case,) = found["cases"]
    assert list(case["answers"]) == found["nature"]["rivals"] and len(case["answers"]) == 5
    assert {row["group"] for row in found["outcomes"]} == {"nothing", "all cases"}
    assert all(answer["cpu_s"] > 0.0 for answer in case["answers"].values())
