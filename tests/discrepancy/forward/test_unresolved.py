"""Parts of waveforms that no run resolves: instruments read them as they read the rest."""

import numpy as np
import pytest

from coronaryuq.case.network.topology import Topology
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.forward.instruments import instruments
from coronaryuq.discrepancy.forward.simulation import TOLERANCE
from coronaryuq.discrepancy.forward.unresolved import changed_by_instruments, sampled, waveforms
from support.hypotheses import assume
from support.small_loop import fresh


@pytest.fixture(scope="module")
def forward():
    return fresh().forward


def test_samples_of_the_waveforms_are_the_predictions(forward):
    """To the tolerance of a run, for each starts from the states known at its time."""
    points = np.vstack([np.zeros(len(forward.nuisances)), 0.3 * np.ones(len(forward.nuisances))])
    predicted, found = forward.predict(points), sampled(forward, waveforms(forward, points), points)
    for rows in forward.rows:
        assert np.abs(found - predicted)[:, rows].max() < 5.0 * TOLERANCE * np.ptp(predicted[:, rows])


@pytest.mark.parametrize("effect", [("flow_low_pass", "J0:lca2"), ("trigger_delay", "every flow")])
def test_an_instrument_reads_a_sum_of_waveforms_as_the_sum_of_its_readings(forward, effect):
    """As low-pass and delay are linear."""
    hypothesis = assume(effect)
    points = np.vstack([np.zeros(len(forward.nuisances)), 0.3 * np.ones(len(forward.nuisances))])
    z = np.append(points[0], np.ones(len(hypothesis.parameters)))
    waves = waveforms(forward, points)
    parts = {name: {key: wave[1:] - wave[:1] for key, wave in own.items()} for name, own in waves.items()}
    chain, topology = instruments(hypothesis, hypothesis.physical_sizes(z)), Topology(forward.network)
    read = np.concatenate(forward.readings(waves, points, topology, chains=[chain] * 2), axis=1)
    (plain,) = np.diff(sampled(forward, waves, points), axis=0)
    (changed,) = changed_by_instruments(forward, parts, z, hypothesis)
    for series, rows in zip(forward.measured, forward.rows, strict=True):
        assert (series.quantity == "flow") == bool(np.any(changed[rows]))
        assert read[1, rows] - read[0, rows] == pytest.approx((plain + changed)[rows], abs=1e-9 * np.ptp(read[0, rows]))


def test_without_instruments_nothing_changes(forward):
    origin = np.zeros(len(forward.nuisances))
    parts = waveforms(forward, origin[None, :])
    assert not changed_by_instruments(forward, parts, origin, PLAIN).any()
    hypothesis = assume(("inertance", "lca1"))
    z = np.append(origin, np.ones(len(hypothesis.parameters)))
    assert not changed_by_instruments(forward, parts, z, hypothesis).any()
