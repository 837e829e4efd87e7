"""Responses of devices: a Gaussian process over impulse responses, linear in its weights."""

import numpy as np
import pytest
from scipy.integrate import quad

from coronaryuq.zerod.effects.linear_response import amplitudes, late_parts, picked_up, read_late

PERIOD, POINTS = 0.8, 300
HARMONICS = np.arange(1, 13) / PERIOD
PHASE = np.arange(POINTS) / POINTS


def wave(phase):
    return 90.0 + 20.0 * np.exp(3.0 * (np.cos(2.0 * np.pi * phase) - 1.0))


def shapes(scale, frequency):
    """Change of the transfer function by each shape of a part that is read late."""
    return late_parts(scale, frequency.tobytes()) - late_parts(scale, np.zeros(1).tobytes())


@pytest.mark.parametrize("samples", [24, 40, 300])
def test_the_amplitudes_are_those_of_the_wave_whatever_its_samples(samples):
    """Of 24 samples, too: 11 harmonics, of which the sixth and later ones are below 1 % of the first."""
    at = np.sort((np.arange(samples) / samples + 0.37 / samples) % 1.0)
    exact = 2.0 * np.fft.rfft(wave(PHASE))[1:33] / POINTS
    found = amplitudes(at, wave(at), PERIOD)
    assert len(found) == 32 and np.abs(found - exact).max() < 2e-3 * np.abs(exact).max()


def test_a_signal_is_picked_up_in_part_at_once_and_in_part_late():
    """The first shape of a short time scale is smooth, so that it delays the signal by about that time."""
    signal = amplitudes(PHASE, wave(PHASE), PERIOD)
    at_once, late = picked_up(signal, PHASE, PERIOD, 0.01)[:, :2].T
    assert at_once == pytest.approx(wave(PHASE) - wave(PHASE).mean(), abs=0.01)
    lag = PERIOD * (np.argmax(late) - np.argmax(at_once)) / POINTS
    assert 0.005 < lag < 0.02


def test_what_is_read_late_is_linear_in_its_signal_and_keeps_the_mean():
    signal = amplitudes(PHASE, wave(PHASE), PERIOD)
    late = read_late(signal, PHASE, PERIOD, 0.05)
    assert read_late(2.0 * signal, PHASE, PERIOD, 0.05) == pytest.approx(2.0 * late)
    assert late.mean(axis=0) == pytest.approx(np.zeros(8), abs=1e-9)


def test_what_is_read_late_is_missing_where_it_would_have_been():
    """A beat of 100 s is steady within the time scale."""
    slow = read_late(amplitudes(PHASE, wave(PHASE), 100.0), PHASE, 100.0, 0.01)
    assert np.abs(slow).max() < 0.02


def test_the_share_that_arrives_late_has_the_standard_deviation_one():
    """At frequencies where all lags differ in phase the transfer function has lost exactly that share."""
    high = np.array([5.0])
    transfer = shapes(2.0, high)[:, 0]
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
    found = (np.abs(shapes(scale, np.array([frequency]))[:, 0]) ** 2).sum()
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
    own = shapes(scale, HARMONICS)
    design, wanted = np.hstack([own.real, own.imag]).T, np.hstack([(response - 1.0).real, (response - 1.0).imag])
    precision = design.T @ design / 0.01**2 + np.eye(len(own))
    found = np.linalg.solve(precision, design.T @ wanted / 0.01**2)
    assert np.sqrt(np.mean((wanted - design @ found) ** 2)) < 0.02 and np.abs(found).max() < 6.0
