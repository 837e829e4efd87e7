"""Slow modes predict the decay of a disturbance, and runs settle to the same state in fewer cycles."""

import numpy as np
import pytest

from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.slow_modes import SlowModes, slow_modes
from support.zerod_networks import closed_loop

STEPS = 1000


def engine(compliance: float) -> Engine:
    """Return a loop with a coronary bed that empties in 0.04 s times `compliance`; a cycle takes 1 s."""
    network = closed_loop(steps=STEPS)
    network["boundary_conditions"][1]["bc_values"]["Cim"] *= compliance
    return Engine(network)


def own(engine: Engine) -> dict[str, np.ndarray]:
    return {"BC_left.Ra": np.array([engine.parameters["BC_left.Ra"]])}


@pytest.fixture(scope="module")
def slow() -> Engine:
    return engine(100.0)


@pytest.fixture(scope="module")
def state(slow) -> np.ndarray:
    return slow.run_to_periodic(periodicity=Periodicity(tolerance=1e-5, cycles=100)).state[0]


@pytest.fixture(scope="module")
def modes(slow, state) -> SlowModes:
    return slow_modes(slow, state, own(slow), STEPS)


def test_the_slow_emptying_of_a_bed_is_predicted_from_one_cycle(slow, state, modes):
    volume, size = BloodVolume(slow.model), 2 * slow.model.size
    start, bed = np.repeat(state[None, :], 2, axis=0), slow.unknowns.index("volume_im:BC_left")
    start[:, bed] *= [0.98, 1.02]
    start = volume.with_blood_added(start, volume.evaluate(state[None, :]) - volume.evaluate(start))
    end = slow.run_cycles(start=start, cycles=1).state
    ranges = np.ptp(slow.run_cycles(start=state, cycles=1, waveforms=slow.unknowns).waveforms["volume_im:BC_left"])
    left = np.abs(end - state)[:, bed] / ranges
    predicted = np.abs(modes.extrapolate(start[:, :size], end[:, :size]) - state[:size])[:, bed] / ranges
    assert (left > 0.2).all()
    assert (predicted < 0.1 * left).all()


def test_runs_settle_in_fewer_cycles_to_the_same_state(slow, state, modes):
    values = slow.parameters["BC_left.Rv"] * np.array([0.8, 0.95, 1.1, 1.3])
    changes, names = {"BC_left.Rv": values}, ["pressure:J0:left", "flow:left:BC_left"]
    volume = BloodVolume(slow.model)

    def ahead(who, start, end):
        state, changed = modes.extrapolate(start, end), {"BC_left.Rv": values[who]}
        missing = volume.evaluate(end, changed) - volume.evaluate(state, changed)
        return volume.with_blood_added(state, missing)

    options = {"waveforms": names, "start": np.repeat(state[None, :], 4, axis=0)}
    without = slow.run_to_periodic(changes, **options)
    extrapolated = slow.run_to_periodic(changes, **options, periodicity=Periodicity(extrapolate=ahead))
    assert without.ok.all() and extrapolated.ok.all()
    assert extrapolated.cycles.sum() < without.cycles.sum()
    for name in names:
        change = np.abs(extrapolated.waveforms[name] - without.waveforms[name]).max(axis=1)
        # Both end with a cycle error of at most 1e-4; a mode that decays by a fifth per cycle is five times as far off.
        assert (change < 2e-3 * np.ptp(without.waveforms[name], axis=1)).all()
    ratio = volume.evaluate(extrapolated.state, changes) / volume.evaluate(options["start"], changes)
    assert ratio == pytest.approx(1.0, rel=1e-6)


def test_a_loop_without_slow_modes_has_none():
    quick = engine(1.0)
    assert slow_modes(quick, quick.run_to_periodic().state[0], own(quick), STEPS) is None


def test_modes_apply_to_a_network_with_added_unknowns(modes):
    size = modes.along.shape[1]
    origin = np.concatenate([np.arange(size), [-1, 3]])
    extended, start = modes.for_extended_network(origin), np.zeros((1, size + 2))
    end = np.concatenate([np.linspace(1.0, 2.0, size), [5.0, 2.5]])[None, :]
    ahead, before = extended.extrapolate(start, end), modes.extrapolate(start[:, :size], end[:, :size])
    assert ahead[0, :size] == pytest.approx(before[0])
    assert ahead[0, size] == 5.0
    assert ahead[0, size + 1] - 2.5 == pytest.approx(before[0, 3] - end[0, 3])
