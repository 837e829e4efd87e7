"""Expected information of a measurement on which of a class is true, against what is known of it."""

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.selection.next_measurement import _of_the_patient, information
from support.hypotheses import assume


def test_far_apart_it_is_all_there_is_to_know_and_close_by_an_eighth_of_the_square():
    predicted = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.1], [200.0, 100.0, 0.1]])
    far, two_alike, _ = information(predicted)
    assert far == pytest.approx(np.log(3.0))
    assert two_alike == pytest.approx(np.log(3.0) - 2.0 / 3.0 * np.log(2.0))
    (close,) = information(np.array([[0.0], [0.1]]))
    assert close == pytest.approx(0.1**2 / 8.0, rel=0.01)


def test_in_between_it_is_what_sampling_says():
    random, predicted = generator(1, "test", "information"), np.array([-1.0, 0.4, 2.0])
    true = random.integers(0, 3, 400_000)
    read = predicted[true] + random.standard_normal(len(true))
    density = np.exp(-0.5 * (read - predicted[:, None]) ** 2)
    gained = np.log(density[true, np.arange(len(true))] / density.mean(axis=0))
    error = gained.std() / np.sqrt(len(gained))
    assert information(predicted[:, None])[0] == pytest.approx(gained.mean(), abs=4.0 * error)


def test_another_instrument_does_not_share_an_error():
    """Of what a member says only the patient's part is what a new reading would show."""
    offset, loss = ("pressure_offset", "a:b"), ("stenosis_with_friction", "a")
    z, hypothesis = _of_the_patient(np.arange(5.0), assume(offset, loss))
    assert z.tolist() == [0.0, 1.0, 3.0, 4.0] and hypothesis == assume(loss)
    z, hypothesis = _of_the_patient(np.arange(3.0), assume(offset))
    assert z.tolist() == [0.0, 1.0] and hypothesis == assume()
