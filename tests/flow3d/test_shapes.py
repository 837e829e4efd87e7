"""Lumens of a batch of samples, some or none of whose coordinates are given."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import lumen_of, with_lumen
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.core.units import BLOOD_DENSITY
from coronaryuq.flow3d.mesh.description import Remainder
from coronaryuq.flow3d.shapes import outside_factors
from support.loops import uncertain
from support.ostium import MIDDLE, artery, entered, mesh_of, quadratic

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


@pytest.mark.parametrize("domain", ["trees", "segments"])
def test_a_narrower_lumen_takes_more_pressure_to_enter_and_leaves_no_nan_outside(domain):
    """In the part of the artery ahead of the mesh, the term of Bernoulli's equation is that of the drawn inlet."""
    tree = artery(MIDDLE)
    network = entered(tree, MIDDLE)
    law = lumen_law(tree, [MIDDLE], LumenError(unit="mm", common_sd=0.2, bias=0.05))
    held = with_lumen(network, tree, vessels_along(tree, [MIDDLE], network), law)
    mesh, radius = mesh_of(tree, held, domain)
    lumen = lumen_of(held)
    z = {name: np.array([0.0, -1.5]) for name in lumen.names}
    outside = outside_factors(lumen, mesh, z)
    assert all(np.isfinite(factor).all() for factor in outside.values())
    first = "lca1_seg0"
    whole = quadratic(held, first) * lumen.factors(z)[f"{first}.stenosis_coefficient"]
    share = mesh.cut[first].upstream["stenosis_coefficient"]
    drawn = radius["inlet_lca1"] * lumen.ratio("lca1", mesh.pieces[0]["lca1"][0], z)[:, 0]
    expected = BLOOD_DENSITY / (np.pi * drawn**2) ** 2
    np.testing.assert_allclose(whole * share * outside[f"{first}.stenosis_coefficient"], expected, rtol=1e-9)
    assert expected[1] > 1.2 * expected[0]
