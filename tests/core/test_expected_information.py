"""Expected information of a measurement on which prediction is true, against its known limits."""

import numpy as np
import pytest

from coronaryuq.core.expected_information import information
from coronaryuq.core.seeds import generator


def test_information_has_its_known_limits_for_distant_and_for_close_predictions():
    predicted = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.1], [200.0, 100.0, 0.1]])
    far, two_alike, _ = information(predicted)
    assert far == pytest.approx(np.log(3.0))
    assert two_alike == pytest.approx(np.log(3.0) - 2.0 / 3.0 * np.log(2.0))
    (close,) = information(np.array([[0.0], [0.1]]))
    assert close == pytest.approx(0.1**2 / 8.0, rel=0.01)


def test_information_in_between_agrees_with_sampling():
    random, predicted = generator(1, "test", "information"), np.array([-1.0, 0.4, 2.0])
    true = random.integers(0, 3, 400_000)
    read = predicted[true] + random.standard_normal(len(true))
    density = np.exp(-0.5 * (read - predicted[:, None]) ** 2)
    gained = np.log(density[true, np.arange(len(true))] / density.mean(axis=0))
    error = gained.std() / np.sqrt(len(gained))
    assert information(predicted[:, None])[0] == pytest.approx(gained.mean(), abs=4.0 * error)
