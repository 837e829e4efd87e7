"""Effects of a law are selected by their posterior probability and grouped into indistinguishable classes."""

import numpy as np
import pytest

from coronaryuq.discrepancy.table_model.law_selection import choose, inclusion
from coronaryuq.discrepancy.table_model.laws import Law, LawFit


def ranked(rms=0.01, **evidence):
    """Fits with given log evidences, keyed by effects joined with "_and_"; the law without effects has zero."""
    laws = [Law((), ()), *(Law(tuple(name.split("_and_")), ("synthetic",)) for name in evidence)]
    fits = [LawFit(law, {}, e, rms, (0.0, 0.0, 0.0)) for law, e in zip(laws, [0.0, *evidence.values()], strict=True)]
    return sorted(fits, key=lambda fit: -fit.evidence)


def test_two_equally_probable_sensors_form_a_class():
    found = choose(ranked(pressure_offset=100.6, pressure_gain=100.0))
    (one,) = found.classes
    assert found.fit.law.effects == ("pressure_offset",)
    assert one.members == ("pressure_offset", "pressure_gain") and one.probability == pytest.approx(1.0)


def test_an_effect_that_clearly_beats_the_others_is_alone_in_its_class():
    found = choose(ranked(pressure_offset=100.0, pressure_gain=90.0))
    assert found.classes[0].members == ("pressure_offset",)


def test_an_uncertain_second_effect_is_dropped():
    found = choose(ranked(quadratic_stenosis=100.0, quadratic_stenosis_and_pressure_gain=100.5))
    assert found.fit.law.effects == ("quadratic_stenosis",)


def test_a_certain_second_effect_is_kept():
    found = choose(ranked(quadratic_stenosis=50.0, quadratic_stenosis_and_pressure_gain=100.0))
    assert found.fit.law.effects == ("quadratic_stenosis", "pressure_gain")


def test_no_effect_is_selected_if_none_improves_the_fit():
    assert choose(ranked(pressure_offset=-3.0)).classes == ()
    assert inclusion(ranked(pressure_offset=np.log(3.0))) == {"pressure_offset": pytest.approx(0.75)}


def test_a_sensor_is_not_selected_if_recalibration_leaves_almost_no_error():
    """A slightly different form of the model's own loss may explain the remainder."""
    assert choose(ranked(rms=0.0028, pressure_offset=15.0)).classes == ()
    assert choose(ranked(rms=0.0028, quadratic_stenosis=15.0)).classes[0].members == ("quadratic_stenosis",)
