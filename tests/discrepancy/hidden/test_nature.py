"""Truths of hidden cases: how far they are off from the model, and which program runs them."""

import copy

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.case.network.network import Network
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.hidden.experiment import Experiment, Plan, loop_conditions
from coronaryuq.discrepancy.hidden.make_case import Noise, draw_subject, hide
from coronaryuq.discrepancy.hidden.nature import Nature, Outside
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.svzerodsolver.program import expressible, last_cycle
from support.hypotheses import assume

EXACT = {"vessels": 0.0, "beds": 0.0, "states": 0.0}
TREE = Anatomy(left_coronary())


def both(experiment, *effects, **spreads):
    """Noise-free data by svZeroDSolver and by our engine, and the program that made the first."""
    z = np.full(sum(len(placed.effect.parameters) for placed in assume(*effects)), 0.5)
    natures = [Nature(program, **EXACT | spreads) for program in ("svzerod", "own")]
    theirs, ours = (draw_subject(experiment, nature, 1).simulate(assume(*effects), z) for nature in natures)
    return theirs.values, ours.values, theirs.made_by


def series_close(experiment, theirs, ours, within):
    """Compare the data series by series, over the largest value of each."""
    split = draw_subject(experiment, Nature(**EXACT), 1).problem.forward.split
    for a, b in zip(split(theirs[None, :]), split(ours[None, :]), strict=True):
        assert np.abs(a - b).max() <= within * np.abs(b).max()


def test_both_programs_make_the_same_data_of_the_open_loop():
    """With equal time steps they differ by what the first cycles leave: our engine stops at a cycle error of 1e-4."""
    experiment = open_loop()
    theirs, ours, made_by = both(experiment)
    assert made_by == "svzerod"
    series_close(experiment, theirs, ours, 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "effect",
    [
        ("diffuse_narrowing", "lad"),
        ("collateral", "lad~lcx"),
        ("side_branch_leak", "lad"),
        ("compressed_resistance", "all beds"),
        ("autoregulation", "all beds"),
        ("flow_delay", "lcx:BC_lcx"),
    ],
    ids=lambda effect: effect[0],
)
def test_effects_on_network_and_sensors_are_the_same_in_both_programs(effect):
    experiment = open_loop()
    theirs, ours, made_by = both(experiment, effect, vessels=0.08)
    assert made_by == "svzerod"
    series_close(experiment, theirs, ours, 1e-4)


@pytest.fixture(scope="module")
def loop(shared):
    network = read_network(shared / "data" / "svzerod-cases" / "closedLoopHeart_withCoronaries.json")
    anatomy = Anatomy(network)
    entries = [("pressure", anatomy.inlet(anatomy.roots[0]), "waveform", 0.02)]
    entries += [("flow", anatomy.inlet(vessel), "waveform", 0.05) for vessel in anatomy.ostia]
    conditions = {name: loop_conditions()[name] for name in ("rest", "pacing")}
    return Experiment(network, conditions, Plan(tuple(entries)))


@pytest.mark.slow
def test_a_closed_loop_has_the_same_blood_volume_in_both_programs(loop):
    """Its time steps are longer in svZeroDSolver, so that waveforms differ at the valves; means do not."""
    theirs, ours, made_by = both(loop)
    assert made_by == "svzerod"
    split = draw_subject(loop, Nature(**EXACT), 1).problem.forward.split
    for a, b in zip(split(theirs[None, :]), split(ours[None, :]), strict=True):
        assert a.mean() == pytest.approx(b.mean(), rel=2e-3)


@pytest.mark.slow
def test_our_engine_runs_what_svzerodsolver_cannot_express(loop):
    leaking = Network(copy.deepcopy(dict(loop.network)))
    assert expressible(leaking)
    leaking.heart["parameters"]["Gao_leak"] = 1e-4
    assert not expressible(leaking)
    theirs, ours, made_by = both(loop, ("aortic_regurgitation", "aortic valve"))
    assert made_by == "own"
    assert theirs.mean() == pytest.approx(ours.mean(), rel=5e-3)


def test_the_last_cycle_of_both_programs_after_as_many_cycles_is_the_same():
    names = ["pressure:lad:BC_lad", "flow:lcx:BC_lcx"]
    theirs = last_cycle(left_coronary(), names)
    ours = Engine(left_coronary()).run_cycles(waveforms=names, cycles=10).waveforms
    for name in names:
        assert len(theirs[name]) == 401
        assert np.abs(theirs[name] - ours[name][0]).max() < 1e-6 * np.abs(ours[name]).max()


def test_vessels_are_off_by_the_stated_standard_deviation():
    """500 draws of 15 values: the standard deviation of the logarithm has a relative error of 0.8 %, five of which."""
    nature, network = Nature(vessels=0.08), left_coronary()
    logs = []
    for seed in range(500):
        body = nature.body(network, seed)
        for vessel, own in zip(body.vessels, network.vessels, strict=True):
            values, before = vessel["zero_d_element_values"], own["zero_d_element_values"]
            logs += [float(np.log(values[name] / before[name])) for name in ("R_poiseuille", "L", "C")]
    assert np.std(logs) == pytest.approx(0.08, rel=5 / np.sqrt(2 * len(logs)))
    assert abs(np.mean(logs)) < 5 * 0.08 / np.sqrt(len(logs))
    assert nature.body(network, 3) == nature.body(network, 3) != nature.body(network, 4)
    assert Nature(vessels=0.0).body(network, 3) == network


def test_parts_of_beds_are_off_and_their_sums_are_not():
    nature, network, logs = Nature(parts=0.15), left_coronary(), []
    for seed in range(200):
        body = nature.body(network, seed)
        for bed, own in zip(body.boundary_conditions, network.boundary_conditions, strict=True):
            values, before = bed["bc_values"], own["bc_values"]
            for names in (("Ra1", "Ra2", "Rv1"), ("Ca", "Cc")) if bed["bc_type"] == "CORONARY" else ():
                assert sum(values[n] for n in names) == pytest.approx(sum(before[n] for n in names))
                first, second = (np.log(values[name] / before[name]) for name in names[:2])
                logs.append(float(first - second))
    # The ratio of two parts: the common factor that keeps the sum drops out.
    assert np.std(logs) == pytest.approx(np.sqrt(2.0) * 0.15, rel=5 / np.sqrt(2 * len(logs)))


def test_nuisance_parameters_are_off_by_the_stated_standard_deviations():
    """2000 draws of each: five times their relative error of 1.6 %."""
    nature, prior = Nature(beds=0.2, states=0.05), Settings()
    bed = Nuisance("resistance of BC_lad", prior.sd_bed, ("BC_lad.Ra1",))
    every = Nuisance("coronary resistance", prior.sd_coronary, ("BC_lad.Ra1",))
    state = Nuisance("coronary state of pacing", prior.sd_condition, ("BC_lad.Ra1",), ("pacing",))
    for parameter, sd in ((bed, 0.2), (every, 0.2 / prior.sd_bed * prior.sd_coronary), (state, 0.05)):
        drawn = [parameter.sd * nature.nuisance(parameter, TREE, seed) for seed in range(2000)]
        assert np.std(drawn) == pytest.approx(sd, rel=5 / np.sqrt(2 * 2000)), parameter.name


def test_the_truth_of_vessels_is_not_drawn_twice():
    """A search that scales vessels leaves them to the draw of their values; the beds stay as they are."""
    nature = Nature(vessels=0.1)
    assert nature.nuisance(Nuisance("radius of lad", 0.1, ("lad.R_poiseuille", "lad.L")), TREE, 1) == 0.0
    assert nature.nuisance(Nuisance("stenosis a of lad", 2.0, ("lad.stenosis_coefficient",), ("mild",)), TREE, 1) != 0.0


@pytest.mark.slow
def test_a_law_of_the_recordings_changes_their_waveforms_only(tmp_path):
    """Every waveform doubled: perfusion stays, and the doubled noise-free data are exact between the grid's points."""
    experiment = open_loop()
    subject = draw_subject(experiment, Nature(vessels=0.08), 2)
    plain = subject.simulate(assume(), np.zeros(0))
    doubled = Outside(
        records=lambda records, periods: {n: {k: 2.0 * w for k, w in waves.items()} for n, waves in records.items()}
    )
    read = subject.simulate(assume(), np.zeros(0), doubled)
    waveform = np.array([s.time is not None for s in subject.problem.forward.measured])[subject.problem.owner]
    assert read.values[~waveform] == pytest.approx(plain.values[~waveform], rel=1e-12)
    assert read.values[waveform] == pytest.approx(2.0 * plain.values[waveform], rel=1e-9)
    truth = hide(experiment, assume(), np.zeros(0), Noise(), 2, tmp_path, doubled)
    assert truth.visible > 100.0
