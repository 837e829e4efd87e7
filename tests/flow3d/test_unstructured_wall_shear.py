"""Wall shear on unstructured meshes of the project's mesher, where a structured tube's symmetry cannot hide noise."""

import numpy as np
import pytest

from coronaryuq.bench import unstructured
from coronaryuq.flow3d.lanes import LANES

FLOW = np.linspace(0.5, 2.0, LANES)
FACETS = 0.25
"""Facets whose corners lie on the circle enclose a radius less by h²/(12 R²) of itself, and wall shear goes with
its third power: (h/R)²/4 too high at the given flow, before any error of the flow itself."""


@pytest.fixture(scope="module")
def tubes():
    return {resolution: unstructured.straight(resolution, FLOW) for resolution in (2.0, 3.0, 4.0)}


@pytest.mark.parametrize("resolution", [2.0, 3.0, 4.0])
def test_straight_tube(tubes, resolution):
    found, scale = tubes[resolution], resolution**-2
    # The flow's own error, of second order too, is allowed as much again as the facets', the scatter three times.
    assert (found["mean"] < 2.4 * FACETS * scale).all()
    assert (found["mean"] > 0.0).all()
    assert (found["rms"] < 3.2 * FACETS * scale).all()
    assert (found["min"] > -3.2 * FACETS * scale).all()
    assert (found["q01"] > -2.4 * FACETS * scale).all()


def test_straight_tube_converges_with_second_order(tubes):
    for name in ("mean", "rms"):
        assert (np.log2(tubes[2.0][name] / tubes[4.0][name]) > 1.7).all()


def test_resolving_the_jet_halves_the_error_beyond_a_stenosis():
    flows = (1.6,)
    exact = unstructured.reference(flows)
    with_jet, without = (unstructured.stenosed((4.0, 2.0, jet), flows, exact) for jet in (3.0, 1.5))
    assert with_jet["mean"][0] < 0.25
    assert with_jet["mean"][0] < 0.5 * without["mean"][0]
    assert with_jet["rms"][0] < 0.75 * without["rms"][0]
