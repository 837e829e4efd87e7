"""Runs conserve mass, are linear where they should be, and do not depend on the rest of the batch."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity
from support.zerod_networks import (
    LOOP_PARAMETERS,
    bifurcation,
    boundary,
    closed_loop,
    grafted,
    network,
    pulse,
    varied,
    vessel,
)


def _same_bits(left, right) -> bool:
    return np.array_equal(left, right, equal_nan=True)


@pytest.mark.parametrize("periodic", [False, True])
def test_a_sample_does_not_depend_on_the_rest_of_its_batch(loop, periodic):
    samples = 64
    changes = varied(loop, samples, LOOP_PARAMETERS)
    options = {"quantities": ["mean_flow:left:BC_left", "max_V_LV:CLH"], "waveforms": ["pressure:J0:left"]}
    run = partial(loop.run_cycles, cycles=2, **options)
    if periodic:
        run = partial(loop.run_to_periodic, periodicity=Periodicity(cycles=8), **options)
    whole = run(changes)
    for size in (1, 7):
        for first in (0, 21, 63 - 63 % size):
            part = {name: value[first : first + size] for name, value in changes.items()}
            result = run(part)
            rows = slice(first, first + size)
            assert _same_bits(result.state, whole.state[rows])
            assert _same_bits(result.waveforms["pressure:J0:left"], whole.waveforms["pressure:J0:left"][rows])
            assert all(_same_bits(result.values[name], whole.values[name][rows]) for name in options["quantities"])
            assert list(result.status) == list(whole.status[rows])
            assert _same_bits(result.cycles, whole.cycles[rows])


def test_a_sample_approached_on_coarse_steps_does_not_depend_on_the_rest_of_its_batch():
    """Samples need different numbers of cycles, so that groups are rearranged."""
    engine, name = Engine(closed_loop(steps=400)), "mean_flow:left:BC_left"
    start = engine.run_to_periodic(periodicity=Periodicity(tolerance=1e-3)).state[0]
    changes = varied(engine, 40, LOOP_PARAMETERS)
    options = {"quantities": [name], "periodicity": Periodicity(1e-3, cycles=20), "start": start}
    whole = engine.run_to_periodic(changes, **options, threads=2)
    assert len(set(whole.cycles)) > 2
    fresh = Engine(closed_loop(steps=400))
    for size, firsts in ((1, (0, 17, 39)), (7, (0, 14, 33))):
        for first in firsts:
            result = fresh.run_to_periodic({k: v[first : first + size] for k, v in changes.items()}, **options)
            rows = slice(first, first + size)
            assert _same_bits(result.state, whole.state[rows])
            assert _same_bits(result.values[name], whole.values[name][rows])
            assert list(result.status) == list(whole.status[rows])


def test_any_start_leads_to_the_same_periodic_state(fine_loop):
    """The start may belong to other parameters, and need not be periodic."""
    changes, name = {"BC_left.Ra": fine_loop.parameters["BC_left.Ra"] * np.array([1.0, 1.3])}, "mean_flow:left:BC_left"
    near = fine_loop.run_to_periodic(changes, [name], start=fine_loop.run_to_periodic().state[0])
    elsewhere = fine_loop.run_cycles({"CLH.Elv_s": 2.0 * fine_loop.parameters["CLH.Elv_s"]}, cycles=3).state[0]
    far = fine_loop.run_to_periodic(changes, [name], start=elsewhere)
    assert list(near.status) == list(far.status) == ["ok"] * 2
    assert np.allclose(near.values[name], far.values[name], rtol=1e-3)


def test_threads_do_not_change_a_bit(loop):
    changes = varied(loop, 40, LOOP_PARAMETERS)
    results = [loop.run_cycles(changes, ["mean_flow:left:BC_left"], cycles=2, threads=threads) for threads in (1, 2, 3)]
    for other in results[1:]:
        assert _same_bits(other.state, results[0].state)
        assert _same_bits(other.values["mean_flow:left:BC_left"], results[0].values["mean_flow:left:BC_left"])


@pytest.mark.slow
def test_changes_act_as_the_same_values_in_the_network_file(loop):
    """Every scalar of every block is changed, zeros and the period included."""
    random = np.random.default_rng(3)
    # In later steps, rounding may shift the opening of a valve by one step.
    steps, names = 25, ["pressure:J0:left", "flow:CLH:J_heart_outlet", "V_LA:CLH"]
    for engine in (loop, Engine(bifurcation())):
        recorded = names if engine is loop else ["pressure:INFLOW:trunk", "flow:right:RCR_right"]
        for name, nominal in engine.parameters.items():
            value = nominal * random.uniform(0.9, 1.1) if nominal else 1e-6
            expected = Engine(with_changes(engine.model.network, {name: value})).run_cycles(
                waveforms=recorded, cycles=1
            )
            changed = engine.run_cycles({name: value}, waveforms=recorded, cycles=1)
            for wave in recorded:
                in_file, in_run = expected.waveforms[wave][0, :steps], changed.waveforms[wave][0, :steps]
                assert np.allclose(in_run, in_file, rtol=1e-7, atol=1e-9 * np.abs(in_file).max()), name


def test_waveforms_of_an_open_loop_stretch_with_the_period():
    engine = Engine(bifurcation())
    slow = {"CLH.cardiac_cycle_period": 1.3}
    expected = Engine(with_changes(bifurcation(), slow)).run_cycles(cycles=2).state
    assert np.allclose(engine.run_cycles(slow, cycles=2).state, expected, rtol=1e-9)


def test_mass_is_conserved_at_every_junction(fine_loop):
    """At a junction at every step; along a compliant vessel over a periodic cycle."""
    names = [f"flow:{location}" for location in ("aorta:J0", "J0:systemic", "J0:left", "J0:right", "left:BC_left")]
    result = fine_loop.run_to_periodic(varied(fine_loop, 5, LOOP_PARAMETERS), waveforms=names)
    assert list(result.status) == ["ok"] * 5
    into, *out, end = (result.waveforms[name] for name in names)
    assert np.abs(into - sum(out)).max() < 1e-9 * np.abs(into).max()
    means = [np.trapezoid(wave, axis=1) for wave in (out[1], end)]
    assert np.allclose(means[0], means[1], rtol=1e-3)


@settings(max_examples=10, deadline=None)
@given(
    factors=st.lists(st.floats(0.2, 5.0), min_size=8, max_size=8),
    a=st.floats(-3.0, 3.0),
    b=st.floats(-3.0, 3.0),
)
def test_rc_networks_are_linear_in_their_inflow(factors, a, b):
    first, second = pulse(5.0, 2.0)["Q"], pulse(-1.0, 6.0)["Q"]

    def pressures(inflow):
        tree = bifurcation(steps=50)
        tree["boundary_conditions"][0]["bc_values"]["Q"] = inflow
        engine = Engine(tree)
        names = [name for name in engine.parameters if name.endswith(("R_poiseuille", ".C", ".Rd", ".Rp", ".L"))][:8]
        changes = {name: engine.parameters[name] * factor for name, factor in zip(names, factors, strict=False)}
        return engine.run_cycles(changes, waveforms=["pressure:INFLOW:trunk"], cycles=3).waveforms[
            "pressure:INFLOW:trunk"
        ]

    combined = pressures([a * x + b * y for x, y in zip(first, second, strict=True)])
    of_first, of_second = pressures(first), pressures(second)
    # Newton's tolerance is absolute, so a small inflow is not resolved to its last digit.
    size = np.abs(of_first).max() + np.abs(of_second).max()
    assert np.allclose(combined, a * of_first + b * of_second, rtol=1e-9, atol=1e-9 * size)


def test_steady_flow_through_a_stenosis_agrees_with_the_closed_form():
    """ΔP = (R + S Q) Q, and P = Rd Q behind it."""
    q, r, s, rd = 4.0, 30.0, 25.0, 900.0
    tube = network(
        [vessel(0, "tube", inlet="INFLOW", outlet="OUT", R_poiseuille=r, stenosis_coefficient=s)],
        [boundary("INFLOW", "FLOW", t=[0.0, 1.0], Q=[q, q]), boundary("OUT", "RESISTANCE", R=rd, Pd=0.0)],
    )
    result = Engine(tube).run_cycles({"tube.stenosis_coefficient": np.array([s, 2 * s])}, ["mean_pressure:INFLOW:tube"])
    assert np.allclose(result.values["mean_pressure:INFLOW:tube"], [(r + f * s * q) * q + rd * q for f in (1, 2)])


def test_a_sample_that_fails_has_a_reason_and_does_not_change_the_others(loop):
    changes = varied(loop, 20, LOOP_PARAMETERS)
    alone = loop.run_cycles({name: np.delete(value, 5) for name, value in changes.items()}, ["mean_flow:left:BC_left"])
    changes["CLH.Elv_s"][5] = 1e300
    result = loop.run_cycles(changes, ["mean_flow:left:BC_left"])
    assert "did not converge at step" in result.status[5]
    assert np.isnan(result.values["mean_flow:left:BC_left"][5])
    assert _same_bits(np.delete(result.state, 5, axis=0), alone.state)
    assert set(np.delete(result.status, 5)) == {"ok"}


def test_a_step_too_large_for_newton_is_refined_for_that_sample_only():
    wave = pulse(0.0, 1.0)
    tube = network(
        [vessel(0, "tube", inlet="IN", outlet="OUT", R_poiseuille=10.0, L=5.0, stenosis_coefficient=1.0)],
        [
            boundary("IN", "PRESSURE", t=wave["t"], P=[5e4 * (1.0 - value) for value in wave["Q"]]),
            boundary("OUT", "RESISTANCE", R=10.0, Pd=0.0),
        ],
        steps=20,
        maximum_nonlinear_iterations=6,
        absolute_tolerance=1e-3,
        steady_initial=False,
    )
    engine, name = Engine(tube), "max_flow:IN:tube"
    stenosis = np.array([0.0, 300.0, 1e-3])
    result = engine.run_cycles({"tube.stenosis_coefficient": stenosis}, [name], cycles=1)
    without_stenosis = engine.run_cycles({"tube.stenosis_coefficient": stenosis[:1]}, [name], cycles=1)
    tube["simulation_parameters"]["maximum_nonlinear_iterations"] = 30
    more_iterations = Engine(tube).run_cycles(
        {"tube.stenosis_coefficient": stenosis}, [name], cycles=1, steps_per_cycle=320
    )
    assert list(result.status) == ["ok"] * 3
    assert result.refinement[0] == result.refinement[2] == 1 and result.refinement[1] > 1
    assert result.values[name][0] == without_stenosis.values[name][0]
    assert np.isclose(result.values[name][1], more_iterations.values[name][1], rtol=0.02)


def test_a_run_continues_from_a_state_as_if_it_had_not_stopped():
    coronary = network(
        [vessel(0, "tube", inlet="INFLOW", outlet="BED", R_poiseuille=10.0)],
        [
            boundary("INFLOW", "FLOW", **pulse(1.0, 0.5)),
            boundary(
                "BED", "CORONARY", Ra1=1e4, Ra2=2e4, Rv1=1e4, Ca=1e-6, Cc=1e-5, P_v=5e3, t=[0, 0.5, 1], Pim=[0, 1e5, 0]
            ),
        ],
    )
    for engine in (Engine(coronary), Engine(closed_loop())):
        first = engine.run_cycles(cycles=2)
        assert _same_bits(engine.run_cycles(cycles=3, start=first.state).state, engine.run_cycles(cycles=5).state)


def test_time_steps_converge_at_second_order():
    """On a linear network, generalised-α is second-order accurate."""

    def wave(steps: int) -> np.ndarray:
        tree = bifurcation(steps=steps)
        tree["boundary_conditions"][0]["bc_values"] |= pulse(points=2561)
        name = "pressure:INFLOW:trunk"
        return Engine(tree).run_cycles(waveforms=[name], cycles=15).waveforms[name][0, :: steps // 40]

    exact = wave(1280)
    errors = [np.abs(wave(steps) - exact).max() for steps in (40, 80, 160)]
    assert 3.0 < errors[0] / errors[1] < 5.0 and 3.0 < errors[1] / errors[2] < 5.0


def test_unknown_names_and_wrong_values_are_errors(loop):
    with pytest.raises(InputError, match="BC_left.Rx"):
        loop.run_cycles({"BC_left.Rx": 1.0})
    with pytest.raises(InputError, match="flow:left:nowhere"):
        loop.run_cycles(quantities=["mean_flow:left:nowhere"])
    with pytest.raises(InputError, match="median_flow"):
        loop.run_cycles(quantities=["median_flow:left:BC_left"])
    with pytest.raises(InputError, match="one length"):
        loop.run_cycles({"BC_left.Ra": np.ones(2), "BC_left.Rv": np.ones(3)})
    with pytest.raises(InputError, match="finite"):
        loop.run_cycles({"BC_left.Ra": np.nan})


def test_a_singular_network_names_the_block():
    tube = network(
        [vessel(0, "tube", inlet="A", outlet="B", R_poiseuille=10.0)],
        [boundary("A", "FLOW", **pulse()), boundary("B", "FLOW", **pulse())],
    )
    with pytest.raises(InputError, match="singular"):
        Engine(tube).run_cycles()


def test_a_changed_waveform_acts_as_the_same_waveform_in_the_network_file():
    """Each sample has its own waveform, which does not change the other sample."""
    plain, grid = bifurcation(), np.linspace(0.0, 1.0, 201)
    inflow = plain["boundary_conditions"][0]["bc_values"]
    own = np.interp(grid, np.asarray(inflow["t"]) / inflow["t"][-1], inflow["Q"])
    other = 1.0 + 0.5 * np.sin(2 * np.pi * grid)
    written = bifurcation()
    written["boundary_conditions"][0]["bc_values"] = {"t": (grid * inflow["t"][-1]).tolist(), "Q": other.tolist()}
    wave = "pressure:INFLOW:trunk"
    expected = Engine(written).run_to_periodic(waveforms=[wave]).waveforms[wave][0]
    changed = Engine(plain).run_to_periodic({"INFLOW.Q": np.array([own, other])}, waveforms=[wave]).waveforms[wave]
    assert np.allclose(changed[1], expected, rtol=1e-4)
    assert np.allclose(changed[0], Engine(plain).run_to_periodic(waveforms=[wave]).waveforms[wave][0], rtol=1e-2)
    with pytest.raises(InputError, match="waveform per sample"):
        Engine(plain).run_cycles({"INFLOW.Q": np.ones(3)})


def test_a_leaking_aortic_valve_passes_backflow_in_proportion_to_pressure(fine_loop):
    """Over a periodic cycle, the ventricle ejects the flow into the aorta plus the backflow."""
    leak = 0.1 / 1333.2
    names = ["flow:CLH:J_heart_outlet", "Q_LV:CLH", "pressure:CLH:J_heart_outlet", "P_LV:CLH"]
    start = fine_loop.run_to_periodic(periodicity=Periodicity(tolerance=1e-4)).state[0]
    changes = {"CLH.Gao_leak": np.array([0.0, leak])}
    run = fine_loop.run_to_periodic(
        changes, waveforms=names, periodicity=Periodicity(tolerance=5e-4), start=np.tile(start, (2, 1))
    )
    out, valve, aorta, ventricle = (run.waveforms[name][:, :-1].mean(axis=1) for name in names)
    assert valve[0] == pytest.approx(out[0], rel=5e-3)
    assert valve[1] - out[1] == pytest.approx(leak * (aorta[1] - ventricle[1]), rel=2e-2)
    diastolic = run.waveforms[names[2]].min(axis=1)
    assert diastolic[1] < 0.97 * diastolic[0]


def test_elements_that_some_samples_lack_do_not_change_the_others():
    """Each sample has one loss or compliance that the network lacks: a pivot must be nonzero in every sample."""
    bare = closed_loop(stenosis=0.0)
    for entry in bare["vessels"]:
        entry["zero_d_element_values"].pop("C", None)
    engine, names = Engine(bare), []
    sizes = {"stenosis_coefficient": 2000.0, "C": 1e-6}
    names = [(f"{entry['vessel_name']}.{key}", size) for entry in bare["vessels"] for key, size in sizes.items()]
    changes = {name: size * np.eye(len(names))[k] for k, (name, size) in enumerate(names)}
    options = {"quantities": ["mean_flow:left:BC_left"], "cycles": 2}
    together = engine.run_cycles(changes, **options)
    assert together.ok.all(), together.status
    for k, (name, size) in enumerate(names):
        alone = engine.run_cycles({name: size}, **options).values["mean_flow:left:BC_left"][0]
        assert together.values["mean_flow:left:BC_left"][k] == pytest.approx(alone, rel=1e-6)


def test_a_strong_quadratic_loss_converges():
    """With a dominant loss, slopes change from iteration to iteration of one step."""
    engine = Engine(closed_loop(stenosis=0.0))
    losses = 10.0 ** np.arange(2.0, 8.0)
    result = engine.run_cycles({"right.stenosis_coefficient": losses}, ["mean_flow:right:BC_right"], cycles=3)
    assert result.ok.all(), result.status
    assert (np.diff(result.values["mean_flow:right:BC_right"]) < 0).all()


def test_a_strong_quadratic_loss_beside_a_graft_converges():
    """The flow changes its direction, and iterations with the factors of an earlier one would diverge."""
    losses = 10.0 ** np.arange(3.0, 7.25, 0.25)
    engine = Engine(grafted(0.0))
    result = engine.run_cycles({"proximal.stenosis_coefficient": losses}, ["mean_flow:proximal:J1"])
    assert result.ok.all(), result.status
    assert (np.diff(result.values["mean_flow:proximal:J1"]) < 0.0).all()
