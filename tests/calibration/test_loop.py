"""The loop under its 36 parameters: where they stand, blood that stays, results that do not depend on company."""

import numpy as np
import pytest

from coronaryuq.calibration import parameters
from coronaryuq.calibration.conductance_shares import share_out, shares
from coronaryuq.calibration.initial_scaling import scaled
from coronaryuq.calibration.loop import Loop
from coronaryuq.case.case_json import CaseOutlet
from coronaryuq.core.units import MMHG
from coronaryuq.zerod.network.beds import distal_resistances

STEPS = 250


@pytest.fixture
def loop(small_loop, adult):
    return Loop(scaled(small_loop, adult, 1.0), STEPS)


def some_points(count, seed=3, spread=0.2):
    width = spread * (parameters.UPPER - parameters.LOWER)
    shifts = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, len(parameters.NAMES)))
    return np.clip(parameters.INITIAL + width * shifts, parameters.LOWER, parameters.UPPER)


def test_there_are_36_and_all_have_a_range_about_their_start():
    assert len(parameters.PARAMETERS) == len(set(parameters.NAMES)) == 36
    for parameter in parameters.PARAMETERS:
        assert parameter.lower < parameter.initial < parameter.upper, parameter.name
        assert parameter.unit in parameters.FACTORS
    owned = np.concatenate([parameters.columns(block) for block in parameters.BLOCKS])
    assert sorted(owned) == list(range(36))


def test_the_heart_block_has_no_parameter_left_out(loop):
    written = set(parameters.changes(parameters.INITIAL[None], loop.network))
    heart = loop.network["closed_loop_blocks"][0]["parameters"]
    assert {f"CLH.{name}" for name in heart} <= written
    assert written <= set(loop.engine.parameters)


def test_initial_scaling_comes_near_before_any_search(loop, adult):
    measures = loop.evaluate(parameters.INITIAL, cycles=15).measures
    for name in ("PaoMean", "AbsQin", "AorCorSplit"):
        assert measures[name][0] == pytest.approx(adult[name], rel=0.3), name


def test_blood_volume_is_conserved_and_is_the_parameter_that_it_is_called(loop):
    points = some_points(6)
    after = loop.evaluate(points, cycles=5)
    held = loop.blood.evaluate(after.state, parameters.changes(points, loop.network))
    wanted = loop.reference_volume * parameters.values(points)[:, parameters.NAMES.index("V_blood")]
    assert held == pytest.approx(wanted, rel=1e-5)


def test_a_periodic_state_does_not_depend_on_where_the_run_began(loop):
    points = some_points(2)
    cold = loop.evaluate(points, tolerance=1e-6)
    warm = loop.evaluate(points, cold.state[::-1], tolerance=1e-6)
    assert cold.ok.all() and warm.ok.all()
    for name in ("PaoMean", "AbsQin", "EDV", "LThirdFF"):
        assert warm.measures[name] == pytest.approx(cold.measures[name], rel=1e-3), name


def test_more_blood_fills_the_heart(loop):
    points = np.tile(parameters.INITIAL, (2, 1))
    points[1, parameters.NAMES.index("V_blood")] = np.log(1.15)
    measures = loop.evaluate(points, cycles=15).measures
    assert measures["EDV"][1] > measures["EDV"][0] + 3.0
    assert measures["AbsQin"][1] > measures["AbsQin"][0]


def test_measures_do_not_depend_on_the_batch(loop):
    points = some_points(5)
    together = loop.evaluate(points, cycles=4)
    for row in range(5):
        alone = loop.evaluate(points[row], cycles=4)
        for name, value in together.measures.items():
            assert np.array_equal(alone.measures[name][0], value[row], equal_nan=True), name


def outlet(bed, tissue, radius):
    name = bed.removeprefix("BC_")
    branch = "RCA" if name.startswith("rca") else "LAD"
    return CaseOutlet(
        name=name, label=name, bc=bed, vessel=name, block=name, perfuses=tissue, branch=branch, point=(0, 0, 0),
        radius=radius,
    )  # fmt: skip


@pytest.mark.parametrize("exponent", [2.6, 3.0])
def test_beds_share_as_perfusion_and_murray_say(small_loop, exponent):
    outlets = [
        outlet("BC_lca1", "LV", 0.08),
        outlet("BC_lca2", "LV", 0.06),
        outlet("BC_rca1", "RV", 0.07),
    ]
    wanted = shares(outlets, [0.08, 0.06, 0.07], {"BC_lca1": 1.5, "BC_lca2": 0.5}, exponent)
    weights = np.array([0.08, 0.06, 0.07]) ** exponent
    assert wanted["BC_rca1"] == pytest.approx(weights[2] / weights.sum())
    assert wanted["BC_lca1"] / wanted["BC_lca2"] == pytest.approx(3.0)
    assert sum(wanted.values()) == pytest.approx(1.0)
    before = distal_resistances(small_loop)
    share_out(small_loop, wanted)
    after = distal_resistances(small_loop)
    assert sum(1 / r for r in after.values()) == pytest.approx(sum(1 / r for r in before.values()))
    for name, share in wanted.items():
        assert (1 / after[name]) / sum(1 / r for r in after.values()) == pytest.approx(share)


def test_initial_totals_are_the_hand_calculation(small_loop, adult):
    network = scaled(small_loop, adult | {"PraMean": 5.0}, 1.0)
    rcr = next(b["bc_values"] for b in network["boundary_conditions"] if b["bc_type"] == "ClosedLoopRCR")
    assert rcr["Rp"] + rcr["Rd"] == pytest.approx(90.0 * MMHG / (70.0 * 0.965))
    coronary = sum(1 / r for r in distal_resistances(network).values())
    assert 90.0 * MMHG * coronary == pytest.approx(70.0 * 0.035)
