"""Errors of one device by several recordings: evidence of common sizes, and what is found where the truth is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import analyse
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.discrepancy.selection.shared_device import (
    NONE,
    Fitted,
    combined,
    shared_device,
    shared_devices,
)
from coronaryuq.zerod.effects.library import effect

LOW_PASS, PLACE = effect("flow_low_pass"), "J0:lad_proximal"


def alone(slope: np.ndarray, y: np.ndarray) -> Fitted:
    """One size s by data y = slope s + noise, both standard normal."""
    precision = 1.0 + slope @ slope
    mean = (slope @ y) / precision
    evidence = -0.5 * (y @ y - mean**2 * precision) - 0.5 * np.log(precision)
    return Fitted(float(evidence), 0.0, np.array([mean]), np.array([[1.0 / precision]]))


@given(st.integers(0, 10_000), st.integers(2, 4))
def test_common_sizes_have_the_evidence_and_the_moments_of_all_data_together(seed, recordings):
    random = np.random.default_rng(seed)
    data = [(random.normal(0, 2, 5), random.normal(0, 2, 5)) for _ in range(recordings)]
    found = combined(LOW_PASS, {str(k): alone(*one) for k, one in enumerate(data)})
    whole = alone(*(np.concatenate(parts) for parts in zip(*data, strict=True)))
    assert found.log_evidence == pytest.approx(whole.log_evidence)
    assert found.mean == pytest.approx(whole.mean) and found.covariance == pytest.approx(whole.covariance)


def hidden(folder, seed: int, size: float | None):
    experiment = open_loop()
    hypothesis = Hypothesis(() if size is None else (PlacedEffect(LOW_PASS, PLACE),))
    sizes = np.zeros(0) if size is None else np.array([size])
    nature = Nature("own", vessels=0.08, beds=0.15, states=0.05)
    make_case.hide(experiment, hypothesis, sizes, make_case.Noise(), seed, folder, nature=nature)
    return analyse(folder)


@pytest.mark.long
@pytest.mark.parametrize("size", [1.0, None])
def test_an_error_that_two_recordings_share_is_named_with_one_size(tmp_path, size):
    """Two subjects, one probe; its low-pass (15 ms and a standard deviation more) or nothing is hidden."""
    discoveries = {}
    for seed in (41, 42):
        (tmp_path / str(seed)).mkdir()
        discoveries[str(seed)] = hidden(tmp_path / str(seed), seed, size)
    places = dict(shared_devices({name: one.problem for name, one in discoveries.items()}))
    assert "flow" in places
    answer = shared_device(discoveries, "flow", dict.fromkeys(discoveries, PLACE))
    assert sum(answer.probabilities.values()) == pytest.approx(1.0)
    if size is None:
        assert answer.probabilities[NONE] > 0.8
        return
    assert answer.probabilities["flow_low_pass"] > 0.8
    error = next(one for one in answer.errors if one.effect is LOW_PASS)
    spread = float(np.sqrt(error.covariance[0, 0]))
    assert abs(error.mean[0] - size) < 3.3 * spread
    assert spread < min(float(np.sqrt(own.covariance[0, 0])) for own in error.each.values())
    assert error.agreement > 0.001


def test_one_recording_is_refused():
    with pytest.raises(InputError, match="two or more"):
        shared_devices({})
