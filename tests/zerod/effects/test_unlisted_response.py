"""Unlisted response of a device: a Gaussian process over impulse responses, linear in its sizes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import Series
from coronaryuq.zerod.effects.library import SEARCHED, effect
from coronaryuq.zerod.effects.unlisted_response import UnlistedResponse, shapes
from support.zerod_networks import bifurcation

PERIOD, POINTS = 0.8, 300
HARMONICS = np.arange(1, 13) / PERIOD
WAVE = 90.0 + 20.0 * np.exp(3.0 * (np.cos(2.0 * np.pi * np.arange(POINTS) / POINTS) - 1.0))
weights = st.lists(st.floats(-3.0, 3.0), min_size=8, max_size=8).map(np.array)


def read(one, sizes, statistic="waveform"):
    series = Series("rest", "pressure", "a:b", statistic, None, PERIOD)
    arrays = {p.name: np.array([size]) for p, size in zip(one.parameters, sizes, strict=True)}
    return one.read("a:b", arrays, series, WAVE[None, :], None, Anatomy(bifurcation()))[0]


@given(weights, weights)
def test_the_reading_is_linear_in_the_weights_and_its_mean_right(first, second):
    device = UnlistedResponse("pressure", 0.05)
    changes = [read(device, sizes) - WAVE for sizes in (first, second, first + second)]
    assert changes[2] == pytest.approx(changes[0] + changes[1], abs=1e-9)
    assert [change.mean() for change in changes] == pytest.approx([0.0] * 3, abs=1e-9)


def test_a_reading_of_the_mean_is_not_affected():
    assert read(UnlistedResponse("pressure", 0.05), np.ones(8), "mean").tolist() == WAVE.tolist()


def test_the_share_that_arrives_late_has_the_standard_deviation_one():
    """At frequencies where all lags differ in phase the transfer function has lost exactly that share."""
    high = np.array([5.0])
    transfer = shapes(2.0, high.tobytes())[:, 0]
    assert np.sqrt((transfer.real**2).sum()) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("frequency", "least"), [(1.25, 0.75), (5.0, 0.95)])
def test_the_shapes_have_most_of_the_variance_of_the_kernel(frequency, least):
    """Of the transfer function: integral over both lags of the kernel with the phases of the frequency.

    With v = exp(-u/T), min(v, w) over v and w leaves a single integral, of a closed inner one.
    """
    scale, omega = 0.05, 2.0 * np.pi * frequency
    power = -1j * omega * scale  # exp(-i omega u) = v ** -power

    def inner(w):
        """Integral over v of min(v, w) (v ** -power - 1) / v."""
        low = w ** (1.0 - power) / (1.0 - power) - w
        high = w * ((1.0 - w**-power) / -power + np.log(w))
        return low + high

    def outer(w):
        return (inner(w) * np.conj(w**-power - 1.0) / w).real

    exact = 0.5 * quad(outer, 1e-12, 1.0, limit=400)[0]
    found = (np.abs(shapes(scale, np.array([frequency]).tobytes())[:, 0]) ** 2).sum()
    assert least * exact < found < exact


@pytest.mark.parametrize(
    ("scale", "response"),
    [
        (0.02, 1.0 / (1.0 + 2j * np.pi * HARMONICS * 0.015)),
        (0.05, 1.0 / (1.0 + 2j * np.pi * HARMONICS * 0.06)),
        (0.05, (1.0 + 0.4 * np.exp(-2j * np.pi * HARMONICS * 0.06)) / 1.4),
        (0.02, 1.0 / (1.0 + 2j * np.pi * HARMONICS * 0.012) ** 2),
    ],
    ids=["low-pass", "slow low-pass", "echo", "two poles"],
)
def test_short_responses_are_near_to_a_plausible_one(scale, response):
    """Within 2 % of the signal, by weights of which none is beyond six standard deviations."""
    own = shapes(scale, HARMONICS.tobytes())
    design, wanted = np.hstack([own.real, own.imag]).T, np.hstack([(response - 1.0).real, (response - 1.0).imag])
    precision = design.T @ design / 0.01**2 + np.eye(len(own))
    found = np.linalg.solve(precision, design.T @ wanted / 0.01**2)
    assert np.sqrt(np.mean((wanted - design @ found) ** 2)) < 0.02 and np.abs(found).max() < 6.0


def test_responses_of_different_time_scales_are_different_effects():
    """Runs are shared by name, place and sizes."""
    names = {UnlistedResponse(quantity, scale).name for quantity in ("pressure", "flow") for scale in (0.01, 0.1)}
    assert len(names) == 4


def test_it_is_not_in_the_library():
    assert not any(isinstance(one, UnlistedResponse) for one in SEARCHED)
    assert not UnlistedResponse("flow", 0.1).nameable and effect("flow_low_pass").nameable
