"""Which effects a table model's law has, what its samples cannot tell apart, and how well its sizes are known."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.table_model.law_selection import choose, inclusion
from coronaryuq.discrepancy.table_model.laws import LAWS, Law, LawFit, fit_law, sizes
from coronaryuq.discrepancy.table_model.tables import Branch

QUADRATIC = next(law for law in LAWS if law.terms == ("quadratic",))


def ranked(rms=0.01, **evidence):
    """Laws by their effects joined with "_and_", with these log evidences; none at nought."""
    laws = [Law((), ()), *(Law(tuple(name.split("_and_")), ("made up",)) for name in evidence)]
    fits = [LawFit(law, {}, e, rms, (0.0, 0.0, 0.0)) for law, e in zip(laws, [0.0, *evidence.values()], strict=True)]
    return sorted(fits, key=lambda fit: -fit.evidence)


def test_two_sensors_that_share_a_law_are_a_class():
    found = choose(ranked(pressure_offset=100.6, pressure_gain=100.0))
    (one,) = found.classes
    assert found.fit.law.effects == ("pressure_offset",)
    assert one.members == ("pressure_offset", "pressure_gain") and one.probability == pytest.approx(1.0)


def test_an_effect_that_clearly_beats_the_others_is_alone_in_its_class():
    found = choose(ranked(pressure_offset=100.0, pressure_gain=90.0))
    assert found.classes[0].members == ("pressure_offset",)


def test_a_second_effect_that_is_not_sure_is_left_out():
    found = choose(ranked(quadratic_stenosis=100.0, quadratic_stenosis_and_pressure_gain=100.5))
    assert found.fit.law.effects == ("quadratic_stenosis",)


def test_a_second_effect_that_is_sure_stays():
    found = choose(ranked(quadratic_stenosis=50.0, quadratic_stenosis_and_pressure_gain=100.0))
    assert found.fit.law.effects == ("quadratic_stenosis", "pressure_gain")


def test_nothing_is_chosen_where_nothing_is_missing():
    assert choose(ranked(pressure_offset=-3.0)).classes == ()
    assert inclusion(ranked(pressure_offset=np.log(3.0))) == {"pressure_offset": pytest.approx(0.75)}


def test_a_sensor_is_not_chosen_where_recalibration_leaves_next_to_nothing():
    """A loss of the model in another form than the patient's may be what remains."""
    assert choose(ranked(rms=0.0028, pressure_offset=15.0)).classes == ()
    assert choose(ranked(rms=0.0028, quadratic_stenosis=15.0)).classes[0].members == ("quadratic_stenosis",)


def test_an_offset_is_found_whole_where_the_outlet_s_reading_has_it_too():
    """-5 mmHg, read behind a bed's vessel that ends there: the 90 % interval holds it in nine of ten trials at least,
    four standard errors allowed."""
    trials, offset, random = 60, -5.0, generator(3, "test", "pairs, sizes")
    law, held, found = next(law for law in LAWS if law.terms == ("offset",)), 0, []
    for _ in range(trials):
        one = branch(random, 0.0, noise=0.002)
        one = replace(one, distal3=one.distal3 + offset, outlet3=one.distal3 + offset)
        every = np.ones(len(one.flow0), bool)
        size = sizes(one, fit_law(one, law, every), every)["offset"]
        held += size.low <= offset <= size.high
        found.append(size.value)
    assert np.mean(found) == pytest.approx(offset, rel=0.02)
    assert held >= trials * 0.9 - 4.0 * np.sqrt(trials * 0.9 * 0.1)


def branch(random, loss, count=60, noise=0.004):
    """Simulated runs of a bed and a vessel, and measured ones with a quadratic loss besides, FFR with noise."""
    root, bed, own = random.uniform(80.0, 100.0, count), random.uniform(30.0, 60.0, count), 1.0
    flow0 = root / (bed + own)
    flow3 = 2.0 * root / (bed + own + np.sqrt((bed + own) ** 2 + 4.0 * loss * root))
    distal0, distal3 = root - own * flow0, root - own * flow3 - loss * flow3**2
    read = distal3 + noise * root * random.standard_normal(count)
    return Branch("x", "v:BC", root, root, distal0, read, distal0, distal3, flow0, flow3, 0.0, "measured")


def test_the_interval_of_a_loss_holds_it_as_often_as_said():
    trials, loss, random = 100, 2.0, generator(1, "test", "pairs, sizes")
    held, of_root = 0, 0
    for _ in range(trials):
        one = branch(random, loss)
        every = np.ones(len(one.flow0), bool)
        found = sizes(one, fit_law(one, QUADRATIC, every), every)
        held += found["quadratic"].low <= loss <= found["quadratic"].high
        share = loss * one.flow0.mean() ** 2 / one.root0.mean()
        of_root += found["quadratic_stenosis"].low <= share <= found["quadratic_stenosis"].high
    # Lumped losses are believed to no better than a floor: intervals may be wide, and hold more than nine in ten.
    least = trials * 0.9 - 4.0 * np.sqrt(trials * 0.9 * 0.1)
    assert held == of_root >= least


def test_a_zero_flow_pressure_that_is_not_known_widens_the_interval():
    one = branch(generator(2, "test", "pairs, sizes"), 2.0)
    every = np.ones(len(one.flow0), bool)
    known, unknown = (
        sizes(b, fit_law(b, QUADRATIC, every), every)["quadratic"] for b in (one, replace(one, venous_sd=10.0))
    )
    assert unknown.high / unknown.low > known.high / known.low
