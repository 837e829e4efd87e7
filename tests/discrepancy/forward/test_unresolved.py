"""Waveforms at points of a model, with effects on its network and as instruments read them."""

import numpy as np
import pytest

from coronaryuq.discrepancy.forward.hypothesis import Hypothesis
from coronaryuq.discrepancy.forward.instruments import instruments
from coronaryuq.discrepancy.forward.unresolved import CYCLE_ERROR, sampled, waveforms
from support.hypotheses import assume
from support.small_loop import fresh


@pytest.fixture(scope="module")
def forward():
    return fresh().forward


@pytest.mark.parametrize(
    "effects",
    [
        (),
        [("inertance", "lca1")],
        # This adds a vessel, so that places have other names.
        [("quadratic_stenosis", "lca1"), ("flow_low_pass", "J0:lca2")],
        # The pressure at the other place is measured.
        [("exchanged_pressures", "J_heart_outlet:aorta and lca1:BC_lca1")],
        [("trigger_delay", "every flow")],
    ],
)
def test_samples_of_the_waveforms_are_the_predictions(forward, effects):
    """To the tolerance of a run, for each starts from the states known at its time."""
    hypothesis = assume(*effects) if effects else Hypothesis()
    sizes = 0.5 * np.ones(len(hypothesis.parameters))
    points = np.array([np.append(z * np.ones(len(forward.nuisances)), sizes) for z in (0.0, 0.2)])
    chain = instruments(hypothesis, hypothesis.physical_sizes(points[0]))
    separate = [hypothesis.without_measurement_errors(z) for z in points]
    on_network, (_, network) = np.array([z for z, _ in separate]), separate[0]
    waves = waveforms(forward, on_network, network)
    predicted, found = forward.predict(points, hypothesis), sampled(forward, waves, on_network, network, chain)
    for rows in forward.rows:
        assert np.abs(found - predicted)[:, rows].max() < 5.0 * CYCLE_ERROR * np.ptp(predicted[:, rows])


def test_a_probe_at_a_place_that_is_not_measured_reads_as_at_its_own(forward):
    """The waveforms there are not kept."""
    misplaced = assume(("misplaced_flow", "J0:lca2 towards aorta"))
    origin = np.zeros((1, len(forward.nuisances)))
    waves = waveforms(forward, origin, Hypothesis())
    chain = instruments(misplaced, misplaced.physical_sizes(np.append(origin[0], 1.0)))
    read, plain = (sampled(forward, waves, origin, Hypothesis(), one) for one in (chain, []))
    assert np.array_equal(read, plain)
