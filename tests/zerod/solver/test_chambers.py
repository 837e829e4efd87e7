"""Chambers and valves as blocks of their own: laws that hold for any parameters, and an independent integration."""

import copy

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.parameters import ACTIVATIONS
from coronaryuq.zerod.solver.activation import ACTIVATION
from coronaryuq.zerod.solver.assembly import Context
from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.engine import Engine
from support.zerod_networks import boundary, built_heart, chamber, network, valve

FEW = settings(max_examples=15, deadline=None, derandomize=True)


def _between(upstream: float, downstream: float, **flap):
    """A valve between a pressure and a resistance of 10."""
    found = network(
        [],
        [
            boundary("IN", "PRESSURE", t=[0.0, 1.0], P=[upstream, upstream]),
            boundary("OUT", "RESISTANCE", R=10.0, Pd=downstream),
        ],
        steps=20,
        cycles=1,
    )
    return found | {"valves": [valve("flap", "IN", "OUT", **flap)]}


def _flow(content) -> float:
    name = "mean_flow:IN:flap"
    result = Engine(content).run_cycles(quantities=[name])
    assert result.ok.all(), result.status
    return float(result.values[name][0])


pressures = st.floats(-100.0, 100.0)


@FEW
@given(pressures, pressures, st.floats(0.1, 10.0), st.floats(1e3, 1e8))
def test_an_open_valve_has_its_least_and_a_shut_one_its_largest_resistance(upstream, downstream, rmin, rmax):
    assume(abs(upstream - downstream) > 1e-3)
    flow = _flow(_between(upstream, downstream, Rmin=rmin, Rmax=rmax))
    resistance = rmin if upstream > downstream else rmax
    assert flow == pytest.approx((upstream - downstream) / (10.0 + resistance), rel=1e-6, abs=1e-9)


@FEW
@given(pressures, pressures)
def test_a_shut_valve_lets_nothing_pass_as_its_resistance_grows(upstream, downstream):
    assume(upstream < downstream - 1e-3)
    for kind in ({}, {"kind": "ValveTanh", "Steepness": 1e4}):
        assert abs(_flow(_between(upstream, downstream, Rmin=1.0, Rmax=1e12, **kind))) < 1e-9


@FEW
@given(pressures, pressures)
def test_a_steep_smooth_valve_is_the_piecewise_one(upstream, downstream):
    assume(abs(upstream - downstream) > 1.0)
    step = _flow(_between(upstream, downstream, Rmin=2.0, Rmax=1e4))
    smooth = _flow(_between(upstream, downstream, Rmin=2.0, Rmax=1e4, kind="ValveTanh", Steepness=1e3))
    assert smooth == pytest.approx(step, rel=1e-6)


@FEW
@given(pressures, pressures, st.floats(0.01, 1.0))
def test_a_smooth_valve_satisfies_its_equation(upstream, downstream, steepness):
    """Also between open and shut, where the Newton iteration needs the derivatives with respect to both pressures."""
    names = ["flow:IN:flap", "pressure:flap:OUT", "valve_status:flap"]
    content = _between(upstream, downstream, Rmin=2.0, Rmax=50.0, kind="ValveTanh", Steepness=steepness)
    result = Engine(content).run_cycles(waveforms=names)
    assert result.ok.all(), result.status
    flow, behind, status = (result.waveforms[name][0, -1] for name in names)
    shut = 0.5 * (1.0 + np.tanh(steepness * (behind - upstream)))
    assert status == pytest.approx(shut, abs=1e-7)
    assert upstream - behind == pytest.approx((2.0 + 48.0 * shut) * flow, abs=1e-6)


@pytest.mark.parametrize("smooth", [False, True])
@settings(max_examples=5, deadline=None, derandomize=True)
@given(elastance=st.floats(0.6, 1.6), resistance=st.floats(0.5, 2.0))
def test_a_loop_of_chambers_keeps_its_blood(smooth, elastance, resistance):
    loop = built_heart(smooth=smooth)
    changes = {"LV.Emax": 2.5 * elastance, "artery.R_poiseuille": 1.1 * resistance}
    engine = Engine(loop)
    first = engine.run_cycles(changes, cycles=1)
    last = engine.run_cycles(changes, cycles=4, start=first.state)
    assert last.ok.all(), last.status
    of = BloodVolume(engine.model).evaluate
    before, after = (of(result.state[:, : len(engine.unknowns)], changes)[0] for result in (first, last))
    assert after == pytest.approx(before, rel=1e-6)


def test_a_left_heart_of_chambers_ejects():
    names = ["pressure:AV:artery", "Vc:LV", "flow:AV:artery"]
    result = Engine(built_heart()).run_cycles(waveforms=names, cycles=12)
    pressure, volume, flow = (result.waveforms[name][0] for name in names)
    assert 60.0 < pressure.min() < 90.0 < pressure.max() < 160.0
    assert 0.3 < np.ptp(volume) / volume.max() < 0.8
    assert flow.min() > -0.02 * flow.max()


@pytest.mark.parametrize("smooth", [False, True])
def test_a_samples_numbers_do_not_depend_on_its_batch(smooth):
    engine = Engine(built_heart(smooth=smooth, cycles=1))
    emax, steep = np.linspace(1.5, 3.5, 19), np.linspace(5e3, 2e4, 19)
    changes = {"LV.Emax": emax, "LV.tau_1": 0.1 * emax} | ({"MV.Steepness": steep} if smooth else {})
    whole = engine.run_cycles(changes)
    assert whole.ok.all(), whole.status
    for k in (0, 7, 18):
        alone = engine.run_cycles({name: value[k : k + 1] for name, value in changes.items()})
        assert np.array_equal(alone.state[0], whole.state[k])


def test_changes_are_those_of_the_network_written_with_them():
    changes = {"LV.Emax": 3.0, "LV.tau_1": 0.15, "AV.Rmin": 0.02}
    written = built_heart(cycles=1)
    written["chambers"][1]["values"]["Emax"] = 3.0
    written["chambers"][1]["activation_function"]["tau_1"] = 0.15
    written["valves"][1]["params"]["Rmin"] = 0.02
    changed = Engine(built_heart(cycles=1)).run_cycles(changes)
    assert np.array_equal(changed.state, Engine(written).run_cycles().state)


def test_a_chamber_with_an_inertance_between_a_valve_and_a_resistance():
    """Against scipy, with the chamber's volume and its outflow as states."""
    active = {"type": "half_cosine", "t_active": 0.2, "t_twitch": 0.4}
    values = {"Emax": 2.0, "Emin": 0.1, "Vrd": 20.0, "Vrs": 15.0, "Impedance": 5e-3}
    source, sink, rmin, rmax, steepness, load = 12.0, 3.0, 0.05, 20.0, 2.0, 0.5
    content = network(
        [],
        [boundary("IN", "PRESSURE", t=[0.0, 1.0], P=[source, source]), boundary("OUT", "RESISTANCE", R=load, Pd=sink)],
        [{"junction_name": "J", "junction_type": "NORMAL_JUNCTION", "inlet_blocks": ["C"], "outlet_blocks": ["OUT"]}],
        steps=4000,
        cycles=1,
        steady_initial=False,
    )
    content["valves"] = [valve("V", "IN", "C", kind="ValveTanh", Rmin=rmin, Rmax=rmax, Steepness=steepness)]
    content["chambers"] = [chamber("C", "ChamberElastanceInductor", active, **values)]
    content["initial_condition"] = {"Vc:C": 80.0}
    names = ["Vc:C", "flow:C:J"]
    result = Engine(content).run_cycles(waveforms=names)

    def rates(time, state):
        volume, outflow = state
        twitch = time - 0.2
        a = 0.5 * (1.0 - np.cos(2.0 * np.pi * twitch / 0.4)) if 0.0 <= twitch <= 0.4 else 0.0
        pressure = (0.1 + 1.9 * a) * (volume - 15.0 - 5.0 * (1.0 - a))
        shut = 0.5 * (1.0 + np.tanh(steepness * (pressure - source)))
        inflow = (source - pressure) / (rmin + (rmax - rmin) * shut)
        return [inflow - outflow, (pressure - sink - load * outflow) / 5e-3]

    exact = solve_ivp(rates, (0.0, 1.0), [80.0, 0.0], "LSODA", rtol=1e-8, atol=1e-8, max_step=1e-3, t_eval=result.time)
    for name, expected in zip(names, exact.y, strict=True):
        assert np.abs(result.waveforms[name][0] - expected).max() < 2e-3 * np.abs(expected).max(), name


_PARAMETERS = {
    "half_cosine": {"t_active": 0.1, "t_twitch": 0.4},
    "piecewise_cosine": {"contract_start": 0.6, "relax_start": 0.75, "contract_duration": 0.15, "relax_duration": 0.2},
    "two_hill": {"t_shift": 0.3, "tau_1": 0.15, "tau_2": 0.3, "m1": 1.5, "m2": 15.0},
    "fourier": {},
    "wrapping_cosine": {"Tsa": 0.4, "tpwave": 9.0},
}


@pytest.mark.parametrize("kind", ACTIVATIONS)
def test_activation_goes_from_zero_to_one_and_is_continuous_around_the_cycle(kind):
    content = built_heart()
    content["chambers"][1]["activation_function"] = {"type": kind, **_PARAMETERS[kind]}
    model = Model(content)
    at = Context(model, {}, 1, np.linspace(0.0, 1.0, 4001))
    active = ACTIVATION[kind](model.blocks["LV"], at)[0]
    assert active.min() == pytest.approx(0.0, abs=1e-4) and active.max() == pytest.approx(1.0, abs=1e-4)
    assert np.abs(np.diff(active)).max() < 0.01 and active[-1] == pytest.approx(active[0], abs=1e-9)


def test_the_network_is_left_as_it_was():
    content = built_heart()
    before = copy.deepcopy(content)
    Engine(content).run_cycles({"LV.Emax": 3.0}, cycles=1)
    assert content == before
