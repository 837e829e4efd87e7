"""Shapes of missed narrowings: their losses by the published rules are those asked for, in vessels of any radii."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel, area_ratio
from coronaryuq.case.lumen.narrowing import diffuse, stenosis
from coronaryuq.case.network.build import Physics, elements, stenosis_coefficient
from coronaryuq.core.seeds import generator

PHYSICS = Physics()
OUTSIDE = np.array([-0.5, -1e-9, 0.0])
seeds = st.integers(0, 10_000)


def vessel(seed: int, lesion: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths and radii of a tapering, uneven vessel, with a lesion of that depth around a third of its length."""
    random = generator(seed, "narrowing")
    length, first = random.uniform(0.5, 3.0), random.uniform(0.08, 0.25)
    arc = np.linspace(0.0, length, 201)
    taper = 1.0 - random.uniform(0.0, 0.2) * arc / length
    uneven = 1.0 + random.uniform(0.0, 0.05) * np.sin(2 * np.pi * (random.integers(1, 5) * arc / length))
    return arc, first * taper * uneven * (1.0 - lesion * np.exp(-(((arc / length - 1 / 3) / 0.1) ** 2)))


def by_rule(arc: np.ndarray, radii: np.ndarray) -> float:
    """The coefficient that the case stage gives a stenosis with these radii."""
    line = np.zeros((len(arc), 3))
    line[:, 2] = arc
    tree = Tree([Vessel("B", line, radii, None, "LAD")])
    return stenosis_coefficient(area_ratio(tree, Stenosis("LAD", "B", 0.0, float(arc[-1]))), float(radii[0]), PHYSICS)


@given(seed=seeds, ratio=st.floats(0.05, 0.99))
def test_the_throat_has_the_loss_of_the_vessel_and_the_added_one(seed, ratio):
    arc, radii = vessel(seed)
    added = stenosis_coefficient(ratio, float(radii[0]), PHYSICS)
    shape = stenosis(arc, radii, 0.5 * arc[-1], added, PHYSICS)
    here = [shape.place]
    own, narrowed = np.interp(here, arc, radii)[0], np.interp(here, arc, radii * shape.ratio(arc))[0]
    healthy = max(np.interp(here, arc[[0, -1]], radii[[0, -1]])[0], own)
    present, drawn = (stenosis_coefficient((r / healthy) ** 2, float(radii[0]), PHYSICS) for r in (own, narrowed))
    assert drawn == pytest.approx(present + added, rel=1e-6)


@given(first=st.floats(0.08, 0.25), length=st.floats(0.3, 3.0), ratio=st.floats(0.05, 0.99))
def test_in_an_even_vessel_the_case_stage_finds_the_added_coefficient(first, length, ratio):
    arc, radii = np.linspace(0.0, length, 201), np.full(201, first)
    added = stenosis_coefficient(ratio, first, PHYSICS)
    shape = stenosis(arc, radii, 0.5 * length, added, PHYSICS)
    assert by_rule(arc, radii * shape.ratio(arc)) == pytest.approx(added, rel=1e-6)


@given(seed=seeds, lesion=st.floats(0.3, 0.6), more=st.floats(0.0, 5.0))
@example(seed=965, lesion=0.3, more=0.0)
def test_a_lesion_gets_tighter_where_it_is_tightest(seed, lesion, more):
    arc, radii = vessel(seed, lesion)
    present = by_rule(arc, radii)
    narrowed = radii * stenosis(arc, radii, None, more * present, PHYSICS).ratio(arc)
    assert by_rule(arc, narrowed) == pytest.approx((1.0 + more) * present, rel=1e-6)
    assert np.argmin(narrowed) == np.argmin(radii) and (narrowed <= radii).all()


@given(seed=seeds, loss=st.floats(0.0, 20.0))
def test_a_diffuse_narrowing_has_the_resistance_of_the_vessel_and_the_added_one(seed, loss):
    arc, radii = vessel(seed)

    def resistance(r):
        line = np.zeros((len(arc), 3))
        line[:, 2] = arc
        return elements(Vessel("B", line, r, None, "LAD"), PHYSICS)["R_poiseuille"]

    added = loss * resistance(radii) * np.pi / (8 * PHYSICS.viscosity)
    shape = diffuse(arc, radii, added)
    assert resistance(radii * shape.ratio(arc)) == pytest.approx((1.0 + loss) * resistance(radii), rel=1e-6)


def test_of_a_long_vessel_the_radius_is_that_of_poiseuilles_law():
    arc, radii = np.linspace(0.0, 30.0, 3001), np.full(3001, 0.15)
    shape = diffuse(arc, radii, 1.0 * 30.0 / 0.15**4)
    assert 1.0 - shape.depth == pytest.approx(0.5**0.25, rel=0.02)


@given(seed=seeds, ratio=st.floats(0.1, 0.9))
def test_the_lumen_is_as_it_was_from_the_ends_on(seed, ratio):
    arc, radii = vessel(seed)
    beyond = np.concatenate([OUTSIDE, arc[-1] - OUTSIDE])
    added = stenosis_coefficient(ratio, float(radii[0]), PHYSICS)
    for shape in (
        stenosis(arc, radii, 0.5 * arc[-1], added, PHYSICS),
        stenosis(arc, radii, None, added, PHYSICS),
        diffuse(arc, radii, 50.0),
    ):
        np.testing.assert_array_equal(shape.ratio(beyond), 1.0)
        assert shape.ratio(arc).min() < 1.0


@given(seed=seeds)
def test_no_loss_leaves_the_lumen_as_it_is(seed):
    arc, radii = vessel(seed)
    for shape in (stenosis(arc, radii, None, 0.0, PHYSICS), diffuse(arc, radii, 0.0)):
        np.testing.assert_allclose(shape.ratio(arc), 1.0, rtol=1e-12)
