"""The narrowest place of a stenosis in the law of a few coordinates, against a law of many."""

import numpy as np
import pytest

from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.narrowest_place import with_exact_throats
from coronaryuq.core.seeds import generator
from coronaryuq.core.units import MM
from support.random_trees import random_tree, tube

DRAWS, MANY = 8000, 120
OF_A_MEDIAN = 1.25 * np.sqrt(2.0 / DRAWS)
"""Standard error of the difference of two medians over the standard deviation of a normal draw."""


def drawn(law, vessel, stenosis, name):
    """Return logarithms of the narrowest radius and of the viscous resistance (draws,) of a stenosis."""
    arc = np.linspace(stenosis.start, stenosis.end, 300)
    random = generator(1, "throats", name)
    z = {coordinate: random.standard_normal(DRAWS) for coordinate in law.names}
    radii = vessel.radius_at(arc) * law.ratio(stenosis.vessel, arc, z)
    return np.log(radii.min(axis=1)), np.log((radii**-4).mean(axis=1))


@pytest.mark.parametrize("severity", [0.3, 0.7])
@pytest.mark.parametrize("length", [3.0, 5.0, 15.0])
def test_throat_and_resistance_have_the_medians_of_the_exact_law(severity, length):
    tree, stenoses = tube(length=4.0, radius=0.16, severity=severity)
    error = LumenError(length=length)
    carried = lumen_law(tree, stenoses, error)
    moved = with_exact_throats(carried, tree, stenoses, MM * length)
    vessel, stenosis = tree[stenoses[0].vessel], stenoses[0]
    exact = drawn(lumen_law(tree, stenoses, error, modes=MANY), vessel, stenosis, "exact")
    before, after = (drawn(law, vessel, stenosis, "carried") for law in (carried, moved))
    tolerance = 4.0 * OF_A_MEDIAN * exact[0].std() + 0.004  # many terms and knots are not all
    assert np.median(after[0]) == pytest.approx(np.median(exact[0]), abs=tolerance)
    assert np.quantile(after[0], 0.05) == pytest.approx(np.quantile(exact[0], 0.05), abs=0.04)
    assert np.median(after[1]) == pytest.approx(np.median(exact[1]), abs=4.0 * OF_A_MEDIAN * exact[1].std() + 0.05)
    if length < 10.0:
        assert np.median(before[0]) > np.median(exact[0]) + tolerance


def test_what_differs_is_the_mean_at_a_stenosis_alone():
    tree, stenoses = random_tree(3)
    error = LumenError()
    carried = lumen_law(tree, stenoses, error)
    moved = with_exact_throats(carried, tree, stenoses, MM * error.length)
    assert moved.names == carried.names
    narrowed = {stenosis.vessel for stenosis in stenoses}
    for name, own in moved.vessels.items():
        assert own.columns is carried.vessels[name].columns
        assert np.array_equal(own.mean, carried.vessels[name].mean) == (name not in narrowed)


def test_a_law_without_local_error_stays():
    tree, stenoses = tube(length=3.0, radius=0.15, severity=0.5)
    law = lumen_law(tree, stenoses, LumenError(local_sd=0.0))
    moved = with_exact_throats(law, tree, stenoses, 0.5)
    np.testing.assert_array_equal(moved.vessels["LAD"].mean, law.vessels["LAD"].mean)
