"""The ensemble in a loop: against 0D alone, batches, interruptions, blow-ups."""

import numpy as np
import pytest

from coronaryuq.flow3d.settings import Settings
from coronaryuq.zerod.solver.engine import Engine
from support.loops import RADIUS, ensemble, network

RESISTANCES = np.linspace(20000.0, 45000.0, 10)


@pytest.fixture(scope="module")
def outcomes():
    return ensemble().run({"OUT.Rd": RESISTANCES}, len(RESISTANCES), waveforms=["flow:B:J1", "pressure:A:J0"])


def test_the_coupled_loop_agrees_with_0d_alone(outcomes):
    result = Engine(network()).run_to_periodic(
        {"OUT.Rd": RESISTANCES}, ["mean_flow:B:J1", "mean_pressure:B:J1", "mean_pressure:J0:B"]
    )
    for k, outcome in enumerate(outcomes):
        assert outcome.ok and outcome.diagnostics["converged"]
        for name in ("mean_flow:B:J1", "mean_pressure:B:J1"):
            assert outcome.values[name] == pytest.approx(result.values[name][k], rel=1e-4)
        drop = outcome.values["mean_pressure:J0:B"] - outcome.values["mean_pressure:B:J1"]
        exact = result.values["mean_pressure:J0:B"][k] - result.values["mean_pressure:B:J1"][k]
        # Three cells over the radius: the 0D vessel is Poiseuille's.
        assert drop == pytest.approx(exact, rel=0.1)


def test_waveforms_agree_with_0d_from_the_beginning_of_the_cycle(outcomes):
    """Flow behind the tube and pressure before it; a ramp of a quarter of a cycle went before the first whole one."""
    names = ["flow:B:J1", "pressure:A:J0"]
    result = Engine(network()).run_to_periodic({"OUT.Rd": RESISTANCES}, waveforms=names, steps_per_cycle=200)
    for k, outcome in enumerate(outcomes):
        flow = outcome.waveforms["flow:B:J1"]
        assert flow[:-1].mean() == pytest.approx(outcome.values["mean_flow:B:J1"], rel=1e-10)
        for name in names:
            assert outcome.waveforms[name] == pytest.approx(result.waveforms[name][k], rel=0.02)


def test_flows_balance(outcomes):
    for outcome in outcomes:
        assert outcome.diagnostics["mass_balance"] < 1e-6
        flow_in, flow_out = outcome.values["mean_flow:J0:B"], outcome.values["mean_flow:B:J1"]
        assert flow_out == pytest.approx(flow_in, rel=1e-10)


def test_ffr_and_wall_shear_agree_with_poiseuille_flow(outcomes):
    for outcome in outcomes:
        values = outcome.values
        assert 0.97 < values["ffr_lad"] < 1.0
        exact = 4 * 0.04 * values["mean_flow:B:J1"] / (np.pi * RADIUS**3)
        assert values["tawss_mean_lad"] == pytest.approx(exact, rel=0.1)
        assert values["tawss_min_lad"] <= values["tawss_q01_lad"] <= values["tawss_mean_lad"]
        assert values["osi_max_lad"] < 1e-3  # the flow never turns round


@pytest.mark.slow
def test_a_sample_does_not_depend_on_its_batch(outcomes):
    for chosen in ([3], [9, 0, 3]):
        again = ensemble().run({"OUT.Rd": RESISTANCES[chosen]}, len(chosen))
        for k, outcome in zip(chosen, again, strict=True):
            assert outcome.values == outcomes[k].values


@pytest.mark.slow
def test_resuming_after_an_interruption_gives_the_same_bits(outcomes, tmp_path):
    class Interrupted(Exception):
        pass

    def stop(block, share):
        if block.cycle == 1 and share > 0.5:
            raise Interrupted

    changes = {"OUT.Rd": RESISTANCES[:2]}
    with pytest.raises(Interrupted):
        ensemble().run(changes, 2, checkpoint=tmp_path / "batch", report=stop)
    assert list(tmp_path.glob("*.npz"))
    steps = []
    again = ensemble().run(changes, 2, tmp_path / "batch", report=lambda block, share: steps.append(block.cycle))
    assert min(steps) == 1
    assert [outcome.values for outcome in again] == [outcome.values for outcome in outcomes[:2]]
    assert not list(tmp_path.glob("*.npz"))


@pytest.mark.slow
def test_a_checkpoint_of_other_samples_is_not_used(outcomes, tmp_path):
    def stop(block, share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ensemble().run({"OUT.Rd": RESISTANCES[5:6]}, 1, checkpoint=tmp_path / "batch", report=stop)
    (again,) = ensemble().run({"OUT.Rd": RESISTANCES[:1]}, 1, checkpoint=tmp_path / "batch")
    assert again.values == outcomes[0].values


@pytest.mark.slow
def test_a_sample_that_blows_up_is_run_again_and_its_neighbours_go_on(outcomes):
    def poison(block, share):
        if block.cycle == 1 and block.steps == 200:
            block.stepper.u[..., 0] = np.nan

    got = ensemble().run({"OUT.Rd": RESISTANCES[:3]}, 3, report=poison)
    assert [outcome.values for outcome in got[1:]] == [outcome.values for outcome in outcomes[1:3]]
    assert got[0].ok
    assert got[0].diagnostics["steps_per_cycle"] == 400
    assert "diverged" in got[0].earlier_failures[0]
    assert got[0].values["ffr_lad"] == pytest.approx(outcomes[0].values["ffr_lad"], abs=1e-4)


def test_a_sample_that_always_blows_up_is_an_outcome_with_a_reason():
    settings = Settings(steps_per_cycle=200, max_cycles=4, speed_limit=20.0, refinements=1)
    (outcome,) = ensemble(settings).run({"OUT.Rd": RESISTANCES[:1]}, 1)
    assert not outcome.ok and not outcome.values
    assert "400 steps per cycle" in outcome.reason
    assert len(outcome.earlier_failures) == 1


def test_a_network_runs_without_changes(outcomes):
    (outcome,) = ensemble().run({}, 1)
    assert outcome.ok
    assert outcomes[0].values["mean_pressure:B:J1"] < outcome.values["mean_pressure:B:J1"]


def test_all_samples_may_lack_a_periodic_start():
    loop = network()
    loop["simulation_parameters"]["maximum_nonlinear_iterations"] = 1
    (outcome,) = ensemble(loop=loop).run({"OUT.Rd": RESISTANCES[:1]}, 1)
    assert not outcome.ok and outcome.reason.startswith("0D start")
