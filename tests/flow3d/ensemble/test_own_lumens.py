"""Samples with lumens of their own: against the shared geometry, 0D, other batches, and what cannot be meshed."""

import numpy as np
import pytest

from coronaryuq.case.description.lumen import LumenError
from coronaryuq.flow3d.adapter import FlowModel
from coronaryuq.flow3d.ensemble.ensemble import Ensemble
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.settings import Settings
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import theta_changes
from support.loops import DENSITY, VISCOSITY, domain, ensemble, network, uncertain

pytestmark = pytest.mark.slow

COMMON = LumenError(unit="mm", common_sd=0.15, local_sd=0.0)
Z = np.linspace(-1.5, 1.5, 5)
SETTINGS = Settings(steps_per_cycle=200, max_cycles=4, wall_samples_per_cycle=50)


def run(model, z: np.ndarray, settings: Settings = SETTINGS, **options):
    theta = dict.fromkeys(model.lumen.names, z)
    shapes = model.shapes(theta, len(z))
    return Ensemble(model, settings).run(theta_changes(model.network, theta), len(z), shapes=shapes, **options)


@pytest.fixture(scope="module")
def outcomes():
    return run(uncertain(COMMON), Z)


def test_the_pressure_drop_changes_as_0d_says_for_the_drawn_radius(outcomes):
    """Poiseuille's tube: 3D over 0D is the mesh's error, which is the same for every radius."""
    model = uncertain(COMMON)
    changes = theta_changes(model.network, {"lumen_common": Z})
    result = Engine(model.network).run_to_periodic(
        changes, ["mean_flow:B:J1", "mean_pressure:B:J1", "mean_pressure:J0:B"]
    )
    over = []
    for k, outcome in enumerate(outcomes):
        assert outcome.ok and outcome.diagnostics["converged"]
        drop = outcome.values["mean_pressure:J0:B"] - outcome.values["mean_pressure:B:J1"]
        exact = result.values["mean_pressure:J0:B"][k] - result.values["mean_pressure:B:J1"][k]
        assert outcome.values["mean_flow:B:J1"] == pytest.approx(result.values["mean_flow:B:J1"][k], rel=1e-4)
        over.append(drop / exact)
    assert over[0] == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(over, over[0], rtol=0.02)
    drops = [o.values["mean_pressure:J0:B"] - o.values["mean_pressure:B:J1"] for o in outcomes]
    assert drops[0] > 3 * drops[-1]


def test_a_sample_does_not_depend_on_the_lumens_beside_it(outcomes):
    for chosen in ([3], [4, 0, 3]):
        for k, outcome in zip(chosen, run(uncertain(COMMON), Z[chosen]), strict=True):
            assert outcome.values == outcomes[k].values


def test_lanes_with_the_same_nodes_agree_with_shared_geometry():
    model = uncertain(COMMON)
    shapes = model.shapes({"lumen_common": np.zeros(2)}, 2)
    domain = model.domain
    same = shapes.__class__(np.stack([domain.points] * 2), np.full(2, model.viscosity), {}, ["", ""], [{}, {}])
    changes = {"OUT.Rd": np.array([20000.0, 40000.0])}
    own = Ensemble(model, SETTINGS).run(changes, 2, shapes=same)
    shared = ensemble(SETTINGS, shape=domain, loop=model.network).run(changes, 2)
    for one, other in zip(own, shared, strict=True):
        for name, value in other.values.items():
            assert one.values[name] == pytest.approx(value, rel=1e-8, abs=1e-10)


@pytest.mark.long
def test_a_resumed_block_has_the_same_bits_and_one_of_other_lumens_is_not_resumed(outcomes, tmp_path):
    def stop(block, share):
        if block.cycle == 1:
            raise KeyboardInterrupt

    model = uncertain(COMMON)
    with pytest.raises(KeyboardInterrupt):
        run(model, Z[:2], checkpoint=tmp_path / "batch", report=stop)
    steps = []
    again = run(model, Z[:2], checkpoint=tmp_path / "batch", report=lambda block, share: steps.append(block.cycle))
    assert min(steps) == 1
    assert [outcome.values for outcome in again] == [outcome.values for outcome in outcomes[:2]]
    with pytest.raises(KeyboardInterrupt):
        run(model, Z[:1], checkpoint=tmp_path / "batch", report=stop)
    (other,) = run(model, Z[1:2], checkpoint=tmp_path / "batch")
    assert other.values == outcomes[1].values


def test_a_lumen_without_a_valid_mesh_is_an_outcome_with_a_reason_and_the_others_go_on(outcomes):
    model = uncertain(LumenError(unit="mm", common_sd=0.15, local_sd=0.3, narrow=1.0), constant=False)
    z = np.array([0.0] * (LANES - 1) + [-15.0])
    got = run(model, z, Settings(steps_per_cycle=100, max_cycles=2, refinements=0))
    assert all(outcome.ok for outcome in got[:-1])
    assert not got[-1].ok and "drawn lumen" in got[-1].reason
    assert "not made from centrelines" in got[-1].reason


def test_the_viscosity_of_a_sample_changes_its_pressure_drop_and_nothing_of_its_neighbours():
    model = FlowModel(domain(), network(), "A:J0", DENSITY, VISCOSITY)
    factor = np.array([0.8, 1.0, 1.3])
    shapes = model.shapes({"viscosity": factor}, 3)
    outcomes = Ensemble(model, SETTINGS).run({"OUT.Rd": np.full(3, 30000.0)}, 3, shapes=shapes)
    drops = [o.values["mean_pressure:J0:B"] - o.values["mean_pressure:B:J1"] for o in outcomes]
    np.testing.assert_allclose(np.array(drops) / drops[1], factor, rtol=0.01)  # Poiseuille's tube
    (shared,) = ensemble(SETTINGS).run({"OUT.Rd": np.full(1, 30000.0)}, 1)
    assert outcomes[1].values["ffr_lad"] == pytest.approx(shared.values["ffr_lad"], rel=1e-8)
