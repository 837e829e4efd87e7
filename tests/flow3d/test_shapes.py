"""Lumens of a batch of samples, some or none of whose coordinates are given."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.case.description.lumen import LumenError
from coronaryuq.flow3d.mesh.description import Remainder
from support.loops import uncertain

COMMON = LumenError(unit="mm", common_sd=0.15, local_sd=0.0)


@pytest.fixture(scope="module")
def model():
    """The tube, of which the mesh begins after 0.1 cm."""
    whole = uncertain(COMMON)
    description = whole.domain.description.model_copy(
        update={"pieces": [{"B": (0.1, 0.8)}], "cut": {"B": Remainder(upstream={"R_poiseuille": 1.0, "L": 1.0})}}
    )
    return replace(whole, domain=replace(whole.domain, description=description))


def test_samples_without_coordinates_have_the_median_lumen(model):
    """As the runs that teach 0D its losses: no column of theirs is a coordinate of the lumen."""
    absent = model.shapes({}, 5)
    centre = model.shapes({name: np.zeros(5) for name in model.lumen.names}, 5)
    np.testing.assert_allclose(absent.points, centre.points, rtol=0, atol=1e-12)
    assert list(absent.outside) == list(centre.outside) == ["B.R_poiseuille", "B.L"]
    np.testing.assert_allclose(absent.outside["B.R_poiseuille"], centre.outside["B.R_poiseuille"], rtol=1e-12)


def test_any_samples_of_a_batch_can_be_picked(model):
    for theta in ({}, {"lumen_common": 0.5}, {"lumen_common": np.linspace(-1, 1, 5)}):
        shapes = model.shapes(theta, 5)
        picked = shapes.of([4, 1])
        assert len(picked.points) == len(picked.reasons) == len(picked.viscosity) == 2
        for name, factor in picked.outside.items():
            np.testing.assert_array_equal(factor, shapes.outside[name][[4, 1]])
