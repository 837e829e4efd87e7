"""Effects act on the network as the others left it, and on what is measured: by their formulas, in any order."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import PERIOD, left_coronary, pressures
from coronaryuq.core import units
from coronaryuq.discrepancy.data.apply_condition import apply_condition, period_of
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.effects.flow_source import FlowSource
from coronaryuq.zerod.effects.intramyocardial import ventricular_pressure
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.changes import with_changes
from support.hypotheses import assume

REST = Condition("rest")
HYPERAEMIA = Condition("hyperaemia", coronary_resistance_scale=0.3)
PIM, DELAY = (effect("intramyocardial_pressure"), "all beds"), (effect("intramyocardial_delay"), "all beds")


def waveform(condition, quantity, place, points=40):
    time = (np.arange(points) + 0.5) / points * PERIOD
    return Measured(condition.name, quantity, place, "waveform", time, PERIOD, np.ones(points), np.ones(points))


def mean(condition, quantity, place, value=1.0):
    return Measured(condition.name, quantity, place, "mean", None, PERIOD, np.array([value]), np.ones(1))


def model(network=None, measured=None, second=HYPERAEMIA) -> Forward:
    measured = measured or [waveform(one, "flow", "lad:BC_lad") for one in (REST, second)]
    conditions = {one.name: one for one in (REST, second)}
    return make_problem(network or left_coronary(), conditions, measured, Settings()).forward


def predicted(forward, effects=(), *sizes):
    return forward.predict(np.array([0.0] * len(forward.nuisances) + list(sizes)), assume(*effects))[0]


def test_two_effects_on_one_waveform_both_act():
    forward = model()
    both = predicted(forward, [PIM, DELAY], -1.0, 1.0)
    alone = predicted(forward, [PIM], -1.0), predicted(forward, [DELAY], 1.0)
    assert all(np.abs(both - one).max() > 0.1 for one in alone)
    assert predicted(forward, [DELAY, PIM], 1.0, -1.0) == pytest.approx(both, abs=1e-12)


def test_the_second_effect_acts_on_the_network_changed_by_the_first():
    forward = model()
    table, network = forward.condition_changes("rest", np.array([0.0] * len(forward.nuisances) + [1.0]), assume(DELAY))
    written = model(with_changes(network, table))
    both = predicted(forward, [PIM, DELAY], -1.0, 1.0)[:40]
    assert both == pytest.approx(predicted(written, [PIM], -1.0)[:40], abs=2e-3)


def test_two_additions_to_one_parameter_are_summed():
    """Back pressure at all beds and at one bed; viscous loss of a stenosis and of a narrowing."""
    forward = model()

    def change(effects, name, present):
        z = np.zeros(len(forward.nuisances) + sum(len(one.parameters) for one, _ in effects))
        return forward.condition_changes("rest", z, assume(*effects))[0].get(name, present) - present

    back = [(effect("back_pressure"), place) for place in ("all beds", "BC_lad")]
    viscous = [(effect(name), "lad_proximal") for name in ("stenosis_with_viscous_loss", "diffuse_narrowing")]
    vessel = next(v for v in forward.network["vessels"] if v["vessel_name"] == "lad_proximal")
    vessel["zero_d_element_values"].pop("C", None)
    forward = model(forward.network)
    linear = vessel["zero_d_element_values"]["R_poiseuille"]
    for both, name, present in (
        (back, "BC_lad.P_v", 5.0 * units.MMHG),
        (viscous, "lad_proximal.R_poiseuille", linear),
    ):
        each = [change([one], name, present) for one in both]
        assert min(each) > 0.0 and change(both, name, present) == pytest.approx(sum(each))


def test_intramyocardial_pressure_does_not_depend_on_the_time_grid():
    uneven = copy.deepcopy(left_coronary())
    for block in uneven["boundary_conditions"]:
        if block["bc_type"] == "CORONARY":
            values = block["bc_values"]
            time = np.asarray(values["t"])
            other = time[-1] * np.linspace(0.0, 1.0, 400) ** 2
            values["Pim"], values["t"] = np.interp(other, time, values["Pim"]).tolist(), other.tolist()
    for size in (1e-6, 0.5):
        even = predicted(model(), [PIM], size)
        assert predicted(model(uneven), [PIM], size) == pytest.approx(even, abs=0.01 * np.abs(even).max())


@pytest.mark.parametrize("recorded_over", [1.0, 0.7])
def test_ventricular_pressure_is_stretched_to_the_period_of_the_condition(recorded_over):
    """Whether the drives beside a `period_scale` are of the network's beat or, already, of the condition's."""
    time, aortic, ventricular = pressures()
    own = recorded_over * time
    faster = Condition("pacing", period_scale=0.7, drive={"AORTA": (own, aortic), "LV": (own, ventricular)})
    network = left_coronary()
    period = period_of(apply_condition(network, faster))
    situation = ConditionState(1.0, period, {}, {}, faster.covariates)
    at = np.linspace(0.0, period, 50, endpoint=False)
    assert period == pytest.approx(0.7 * PERIOD)
    expected = np.interp(at / 0.7, time, ventricular)
    assert ventricular_pressure(at, Anatomy(network), situation, np.zeros(50)) == pytest.approx(expected)


@pytest.mark.parametrize(("name", "quantity"), [("pressure_delay", "pressure"), ("flow_delay", "flow")])
def test_a_delay_shifts_the_simulated_waveform_and_not_the_readings(name, quantity):
    few = waveform(REST, quantity, "lad:BC_lad", 8)
    late = replace(few, time=few.time - 0.05)
    size = effect(name).parameters[0].to_standard(0.05)
    delayed = predicted(model(measured=[few]), [(effect(name), "lad:BC_lad")], size)
    assert delayed == pytest.approx(predicted(model(measured=[late])), rel=1e-9)
    assert np.abs(delayed - predicted(model(measured=[few]))).max() > 0.02 * np.abs(delayed).max()


def test_a_delay_in_seconds_does_not_depend_on_the_heart_rate():
    pacing, shorter = Condition("pacing", period_scale=0.6), 0.6 * PERIOD
    slow = waveform(REST, "flow", "lad:BC_lad")
    fast = replace(slow, condition="pacing", time=0.6 * slow.time, period=shorter)
    both = model(measured=[slow, fast], second=pacing)
    late = [replace(one, time=(one.time - 0.05) % one.period) for one in (slow, fast)]
    size = effect("flow_delay").parameters[0].to_standard(0.05)
    delayed = predicted(both, [(effect("flow_delay"), "lad:BC_lad")], size)
    assert delayed == pytest.approx(predicted(replace(both, measured=late)), rel=1e-9)


def test_a_low_pass_does_not_depend_on_how_the_beat_is_sampled():
    """Every second point, points in another order of the beat, and the extremes see the same filtered waveform."""
    many = waveform(REST, "pressure", "lad:BC_lad", 40)
    few = replace(many, time=many.time[::2], value=np.ones(20), sd=np.ones(20))
    most = [Measured("rest", "pressure", "lad:BC_lad", s, None, PERIOD, np.ones(1), np.ones(1)) for s in ("max", "min")]
    low_pass, size = [(effect("pressure_low_pass"), "lad:BC_lad")], 1.0
    filtered = predicted(model(measured=[many, *most]), low_pass, size)
    assert predicted(model(measured=[few]), low_pass, size) == pytest.approx(filtered[:40:2], rel=1e-12)
    plain = predicted(model(measured=[many, *most]))
    assert filtered[:40].max() <= filtered[40] < plain[40] and filtered[:40].min() >= filtered[41] > plain[41]


def test_the_order_of_two_instruments_in_a_hypothesis_does_not_matter():
    forward = model(measured=[waveform(REST, "flow", place) for place in ("lad:BC_lad", "lcx:BC_lcx")])
    low_pass = (effect("flow_low_pass"), "every flow")
    exchange = (effect("exchanged_flows"), "lad:BC_lad and lcx:BC_lcx")
    both = predicted(forward, [low_pass, exchange], 0.5, -0.5)
    assert np.array_equal(predicted(forward, [exchange, low_pass], -0.5, 0.5), both)
    assert np.abs(both - predicted(forward, [exchange], -0.5)).max() > 0.02


def test_the_order_of_an_offset_and_a_gain_in_a_hypothesis_does_not_matter():
    forward = model(measured=[waveform(REST, "flow", "lad:BC_lad")])
    gain, offset = (effect("flow_gain"), "lad:BC_lad"), (effect("flow_offset"), "lad:BC_lad")
    both = predicted(forward, [gain, offset], 1.0, 2.0)
    assert np.array_equal(predicted(forward, [offset, gain], 2.0, 1.0), both)


def test_the_zero_of_a_transducer_is_wrong_by_as_much_at_a_low_pressure():
    """It was wrong by a fraction of the mean of its own readings."""
    time, aortic, _ = pressures()
    low = Condition("low", drive={"AORTA": (time, 0.2 * aortic)})
    forward = model(measured=[mean(low, "pressure", "lad:BC_lad")], second=low)
    plain, read = predicted(forward), predicted(forward, [(effect("pressure_offset"), "lad:BC_lad")], 1.0)
    assert plain[0] < 20.0 * units.MMHG
    assert read - plain == pytest.approx(0.08 * aortic.mean(), rel=0.02)


@pytest.mark.parametrize(
    ("scale", "held_out", "possible"), [(0.3, False, True), (0.3, True, False), (1.0, False, False)]
)
def test_hyperaemia_is_incomplete_only_where_a_fitted_condition_dilates(scale, held_out, possible):
    """As a candidate that acts nowhere, it took some of the prior from the others."""
    second = Condition("second", coronary_resistance_scale=scale, held_out=held_out)
    assert bool(effect("incomplete_hyperaemia").places(model(second=second).anatomy)) == possible


def test_a_delay_of_a_compression_that_a_condition_gives_is_possible():
    """In the network, the intramyocardial pressure is constant."""
    network, phase = left_coronary(compressed=False), np.linspace(0.0, PERIOD, 41)
    given = {"BC_lad": (phase, 5e4 * np.sin(np.pi * phase / PERIOD) ** 2)}
    delay = effect("intramyocardial_delay")
    assert delay.places(model(network).anatomy) == []
    driven = model(network, second=Condition("hyperaemia", coronary_resistance_scale=0.3, drive=given))
    assert delay.places(driven.anatomy) == ["all beds"]
    assert np.abs(predicted(driven, [DELAY], 1.0) - predicted(driven)).max() > 0.01


@pytest.mark.parametrize(("name", "quantity"), [("exchanged_flows", "flow"), ("exchanged_pressures", "pressure")])
def test_exchanged_channels_read_each_other_although_sampled_at_other_times(name, quantity):
    places = "J1:diagonal", "lcx:BC_lcx"
    one, other = (waveform(REST, quantity, place, points) for place, points in zip(places, (40, 30), strict=True))
    crossed = [replace(one, location=places[1]), replace(other, location=places[0])]
    whole = effect(name).parameters[0].to_standard(1.0)
    read = predicted(model(measured=[one, other]), [(effect(name), " and ".join(places))], whole)
    assert read == pytest.approx(predicted(model(measured=crossed)), rel=1e-12)


def test_crosstalk_adds_a_fraction_of_the_other_flow_at_the_same_times():
    one, other = (waveform(REST, "flow", place, 40) for place in ("lad:BC_lad", "lcx:BC_lcx"))
    own, added = np.split(predicted(model(measured=[one, other])), 2)
    share = effect("flow_crosstalk").parameters[0].to_standard(0.3)
    read = predicted(model(measured=[one, other]), [(effect("flow_crosstalk"), "lad:BC_lad with lcx:BC_lcx")], share)
    assert read == pytest.approx(np.concatenate([own + 0.3 * added, added]), rel=1e-9)


@pytest.mark.parametrize(
    ("name", "quantity", "place", "vessel", "far"),
    [
        ("misplaced_flow", "flow", "lcx:BC_lcx", "left_main", "left_main:J0"),
        ("misplaced_flow", "flow", "lcx:BC_lcx", "lad_proximal", "J0:lad_proximal"),
        ("misplaced_pressure", "pressure", "lad:BC_lad", "lad", "J1:lad"),
        ("misplaced_pressure", "pressure", "J0:lad_proximal", "left_main", "AORTA:left_main"),
    ],
)
def test_a_misplaced_probe_reads_between_its_place_and_that_of_the_neighbour(name, quantity, place, vessel, far):
    forward = model(measured=[waveform(REST, quantity, place)])
    own, there = predicted(forward), predicted(model(measured=[waveform(REST, quantity, far)]))
    misplaced = [(effect(name), f"{place} towards {vessel}")]
    share = effect(name).parameters[0]
    for fraction in (0.3, 1.0, 1.1):
        read = predicted(forward, misplaced, float(share.to_standard(fraction)))
        assert read == pytest.approx((1.0 - fraction) * own + fraction * there, rel=1e-9)
    assert np.abs(own - there).max() > 1e-3 * np.abs(own).max()


def test_a_leak_beyond_a_flow_probe_is_in_its_reading_and_not_in_the_perfusion():
    """The sum of what a probe ahead of the leak and one behind it read differs by the leak."""
    flow, perfused = mean(REST, "flow", "lcx:BC_lcx"), mean(REST, "perfusion", "BC_lcx", 1.0 / 60.0)
    forward = model(measured=[flow, perfused])
    plain = predicted(forward)
    ahead = predicted(forward, [(effect("side_branch_leak"), "lcx")], 0.0)
    beyond = predicted(forward, [(effect("distal_leak"), "lcx")], 0.0)
    assert ahead[0] == pytest.approx(plain[0], rel=0.01) and beyond[0] == pytest.approx(1.2 * plain[0], rel=0.03)
    assert beyond[1] == pytest.approx(ahead[1], rel=1e-6)


@pytest.mark.parametrize(
    ("ahead", "beyond"),
    [
        (("side_branch_leak", "lcx"), ("distal_leak", "lcx")),
        (("side_branch", "lcx"), ("distal_collateral", "lad~lcx")),
        (("collateral", "lad~lcx"), ("distal_leak", "lcx")),
        (("unknown_source", "lcx"), ("distal_leak", "lcx")),
    ],
    ids=lambda pair: pair[0],
)
def test_paths_on_both_sides_of_a_probe_keep_their_side_in_any_order(ahead, beyond):
    """Their effects on small flows add up; the one inserted second was on the side of the first."""
    forward = model(measured=[mean(REST, quantity, "lcx:BC_lcx") for quantity in ("flow", "pressure")])
    pairs = [(FlowSource() if name == "unknown_source" else effect(name), place) for name, place in (ahead, beyond)]
    sizes = [[-1.0 if one.name != "unknown_source" else 0.05] + [0.0] * (len(one.parameters) - 1) for one, _ in pairs]
    plain = predicted(forward)
    each = [predicted(forward, [pair], *size) - plain for pair, size in zip(pairs, sizes, strict=True)]
    both = predicted(forward, pairs, *sizes[0], *sizes[1]) - plain
    assert predicted(forward, pairs[::-1], *sizes[1], *sizes[0]) - plain == pytest.approx(both, rel=1e-9)
    assert np.abs(both - sum(each)).max() < 0.1 * min(np.abs(one).max() for one in each)


TIMES = np.linspace(0.0, PERIOD, 101)
OTHER_BEDS = {
    "nothing": {},
    "a scaled resistance": {"scale": {"BC_lcx": {"Ra2": 2.0}}},
    "a compliance as given": {"set": {"BC_lcx": {"Cc": 1e-6}}},
    "another compression": {"drive": {"BC_lcx": (TIMES, 4e4 * np.sin(np.pi * TIMES / PERIOD) ** 2)}},
}


@pytest.mark.parametrize("beside", ["bed_resistance", "back_pressure", "intramyocardial_pressure"])
@pytest.mark.parametrize("changed", OTHER_BEDS)
def test_a_side_branch_carries_a_share_of_what_the_bed_beside_it_carries(changed, beside):
    """Whatever conditions, recalibration and other effects change in that bed: the branch's did not follow."""
    other = Condition("other", coronary_resistance_scale=0.5, **OTHER_BEDS[changed])
    measured = [mean(one, "flow", place) for one in (REST, other) for place in ("J0:lcx", "lcx:BC_lcx")]
    forward = model(measured=measured, second=other)
    place = "BC_lcx" if beside == "bed_resistance" else "all beds"
    z = [*np.random.default_rng(1).normal(size=len(forward.nuisances)), 1.0, 1.0]
    hypothesis = assume((effect("side_branch"), "lcx"), (effect(beside), place))
    carried, left = forward.predict(np.array(z), hypothesis)[0].reshape(2, 2).T
    share = float(effect("side_branch").parameters[0].from_standard(1.0))
    assert carried == pytest.approx((1.0 + share) * left, rel=1e-4)


def test_leaks_and_collaterals_on_both_sides_of_the_probes_do_not_share_a_network():
    """Predictions with many effects grafted into few networks are those with each alone."""
    forward = model(measured=[mean(REST, "flow", place) for place in ("lad:BC_lad", "lcx:BC_lcx")])
    pairs = [
        ("side_branch_leak", "lcx"),
        ("distal_leak", "lcx"),
        ("collateral", "lad~lcx"),
        ("distal_collateral", "lad~lcx"),
    ]
    hypotheses = [assume(pair) for pair in pairs]
    z = np.array([0.0] * len(forward.nuisances) + [1.0])
    grafts = [placed for hypothesis in hypotheses for placed in hypothesis]
    together = forward.predict_rows([(z, hypothesis) for hypothesis in hypotheses], grafts=grafts)
    alone = np.array([forward.predict(z, hypothesis)[0] for hypothesis in hypotheses])
    assert together == pytest.approx(alone, rel=1e-6)
    assert abs(alone[0, 1] / alone[1, 1] - 1.0) > 0.1


def test_a_ratio_uses_the_root_pressure_after_the_root_was_renamed():
    """A loss at the root, which stores blood, is put ahead of it: FFR is over the pressure before that loss."""
    forward = model(measured=[mean(REST, "ratio", "lad:BC_lad")])
    loss = (effect("ostial_loss"), "left_main")
    plain, lost = predicted(forward), predicted(forward, [loss], 1.0)
    share = float(effect("ostial_loss").parameters[0].from_standard(1.0))
    assert 0.9 < plain[0] < 1.0 and plain[0] - lost[0] == pytest.approx(share, rel=0.6)


def test_errors_of_a_pressure_wire_act_on_its_ratio():
    forward = model(measured=[mean(one, "ratio", "lad:BC_lad") for one in (REST, HYPERAEMIA)])
    plain = predicted(forward)
    gain = effect("pressure_gain").parameters[0].to_standard(0.05)
    assert predicted(forward, [(effect("pressure_gain"), "lad:BC_lad")], gain) == pytest.approx(1.05 * plain)
    offset = predicted(forward, [(effect("pressure_offset"), "lad:BC_lad")], 1.0) - plain
    assert offset[0] == pytest.approx(offset[1]) and offset[0] > 0.05


def test_tissue_masses_do_not_depend_on_held_out_data():
    hidden = Condition("hyperaemia", coronary_resistance_scale=0.3, held_out=True)
    masses = []
    for first in (2.0, 4.0):
        measured = [mean(hidden, "perfusion", "BC_lad", first), mean(REST, "perfusion", "BC_lad", 1.0)]
        problem = make_problem(left_coronary(), {"hyperaemia": hidden, "rest": REST}, measured, Settings())
        masses.append(problem.forward.masses["BC_lad"])
    assert masses[0] == masses[1]
