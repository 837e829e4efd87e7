"""What lasts of a disturbance is foreseen after one cycle, and runs settle where they would have settled without."""

import numpy as np
import pytest

from coronaryuq.zerod.solver.blood_volume import BloodVolume
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.slow_modes import SlowModes, slow_modes
from support.zerod_networks import closed_loop

STEPS = 1000


def engine(compliance: float) -> Engine:
    """A loop one of whose coronary beds empties in 0.04 s times `compliance`; a cycle takes 1 s."""
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


def test_a_bed_that_holds_blood_for_many_cycles_is_foreseen(slow, state, modes):
    volume, size = BloodVolume(slow.model), 2 * slow.model.size
    start, bed = np.repeat(state[None, :], 2, axis=0), slow.unknowns.index("volume_im:BC_left")
    start[:, bed] *= [0.98, 1.02]
    start = volume.with_blood_added(start, volume.evaluate(state[None, :]) - volume.evaluate(start))
    end = slow.run_cycles(start=start, cycles=1).state
    ranges = np.ptp(slow.run_cycles(start=state, cycles=1, waveforms=slow.unknowns).waveforms["volume_im:BC_left"])
    left = np.abs(end - state)[:, bed] / ranges
    foreseen = np.abs(modes.extrapolate(start[:, :size], end[:, :size]) - state[:size])[:, bed] / ranges
    assert (left > 0.2).all()
    assert (foreseen < 0.1 * left).all()


def test_runs_settle_in_fewer_cycles_to_the_same_state(slow, state, modes):
    values = slow.parameters["BC_left.Rv"] * np.array([0.8, 0.95, 1.1, 1.3])
    changes, names = {"BC_left.Rv": values}, ["pressure:J0:left", "flow:left:BC_left"]
    volume = BloodVolume(slow.model)

    def ahead(who, start, end):
        found, mine = modes.extrapolate(start, end), {"BC_left.Rv": values[who]}
        return volume.with_blood_added(found, volume.evaluate(end, mine) - volume.evaluate(found, mine))

    options = {"waveforms": names, "start": np.repeat(state[None, :], 4, axis=0)}
    without = slow.run_to_periodic(changes, **options)
    led = slow.run_to_periodic(changes, **options, periodicity=Periodicity(extrapolate=ahead))
    assert without.ok.all() and led.ok.all()
    assert led.cycles.sum() < without.cycles.sum()
    for name in names:
        change = np.abs(led.waveforms[name] - without.waveforms[name]).max(axis=1)
        # Both end with a cycle error of 1e-4 at most; what is left of a mode that decays by a fifth is five times that.
        assert (change < 2e-3 * np.ptp(without.waveforms[name], axis=1)).all()
    held = volume.evaluate(led.state, changes) / volume.evaluate(options["start"], changes)
    assert held == pytest.approx(1.0, rel=1e-6)


def test_a_loop_that_forgets_within_a_cycle_has_none():
    quick = engine(1.0)
    assert slow_modes(quick, quick.run_to_periodic().state[0], own(quick), STEPS) is None


def test_the_modes_of_a_network_serve_one_with_added_unknowns(modes):
    size = modes.along.shape[1]
    origin = np.concatenate([np.arange(size), [-1, 3]])
    moved, start = modes.for_extended_network(origin), np.zeros((1, size + 2))
    end = np.concatenate([np.linspace(1.0, 2.0, size), [5.0, 2.5]])[None, :]
    found, before = moved.extrapolate(start, end), modes.extrapolate(start[:, :size], end[:, :size])
    assert found[0, :size] == pytest.approx(before[0])
    assert found[0, size] == 5.0
    assert found[0, size + 1] - 2.5 == pytest.approx(before[0, 3] - end[0, 3])
