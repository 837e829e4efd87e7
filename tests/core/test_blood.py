"""Viscosity from haematocrit."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.core.blood import viscosity_of


@pytest.mark.parametrize(("haematocrit", "relative"), [(0.0, 1.0), (0.45, 3.2)])
def test_plasma_and_normal_blood_are_those_of_the_published_law(haematocrit, relative):
    assert viscosity_of(haematocrit) == pytest.approx(0.012 * relative, rel=1e-12)


@given(st.floats(0.1, 0.69), st.floats(0.001, 0.01))
def test_more_cells_make_blood_more_viscous(haematocrit, more):
    assert viscosity_of(haematocrit + more) > viscosity_of(haematocrit)


def test_without_a_haematocrit_it_is_the_papers():
    assert viscosity_of(None) == 0.04
