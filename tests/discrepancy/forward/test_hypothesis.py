"""The layout of z: nuisance parameters first, then the sizes of each effect."""

import numpy as np
import pytest

from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from support.hypotheses import assume, placed

TWO_SIZES, ONE_SIZE = placed("stenosis_with_viscous_loss", "lad"), placed("pressure_offset", "lad:BC_lad")
BOTH = assume(TWO_SIZES, ONE_SIZE)
Z = np.arange(5.0)


def test_sizes_stand_behind_the_nuisance_parameters_in_the_order_of_the_effects():
    assert BOTH.nuisances(Z).tolist() == [0.0, 1.0]
    assert BOTH.sizes(Z, TWO_SIZES).tolist() == [2.0, 3.0] and BOTH.sizes(Z, ONE_SIZE).tolist() == [4.0]
    assert BOTH.all_sizes(Z).tolist() == [2.0, 3.0, 4.0]
    assert PLAIN.nuisances(Z).tolist() == Z.tolist() and PLAIN.all_sizes(Z).size == 0


def test_effects_are_added_last_and_dropped_with_their_sizes():
    assert assume(TWO_SIZES).with_(ONE_SIZE) == BOTH
    assert BOTH.without(TWO_SIZES) == assume(ONE_SIZE)
    assert BOTH.drop(Z, TWO_SIZES).tolist() == [0.0, 1.0, 4.0]
    assert BOTH.at_prior_mean(Z).tolist() == [0.0, 0.0, 2.0, 3.0, 4.0]


def test_physical_sizes_have_the_units_of_their_parameters():
    first, _ = TWO_SIZES.effect.parameters
    sizes, _ = BOTH.physical_sizes(Z)
    assert sizes[first.name] == pytest.approx(float(first.from_standard(2.0)))


def test_another_instrument_does_not_share_a_measurement_error():
    """A new reading shows only the part of a hypothesis that concerns the patient."""
    offset, loss = ("pressure_offset", "a:b"), ("stenosis_with_viscous_loss", "a")
    z, hypothesis = assume(offset, loss).without_measurement_errors(np.arange(5.0))
    assert z.tolist() == [0.0, 1.0, 3.0, 4.0] and hypothesis == assume(loss)
    z, hypothesis = assume(offset).without_measurement_errors(np.arange(3.0))
    assert z.tolist() == [0.0, 1.0] and hypothesis == assume()
