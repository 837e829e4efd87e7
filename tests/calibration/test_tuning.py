"""Tuning finds a loop that it can know: targets made by the model itself, then the real ones."""

import json

import numpy as np
import pandas as pd
import pytest

from coronaryuq.calibration import parameters
from coronaryuq.calibration.hyperaemic_flow import HyperaemicTarget, hyperaemic_flow, meet_hyperaemic_flow
from coronaryuq.calibration.initial_scaling import scaled
from coronaryuq.calibration.loop import Loop
from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.stage import tune, tune_files
from coronaryuq.calibration.targets import BY_NAME, TUNED, in_own_units
from coronaryuq.case.network.units import rescaled
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.core.units import MMHG
from coronaryuq.zerod.cardiac_function import measure, waveform_names
from coronaryuq.zerod.network.beds import beds, distal_resistances
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.svzerodsolver import program
from support.case_files import write_case_json, write_perfusion_targets

pytestmark = pytest.mark.slow

QUICK = Settings(
    candidates=16, starts=2, least_squares_steps=5, rounds=1, evaluations_per_parameter=4, final_steps_per_cycle=500
)
LV = ("BC_lca1", "BC_lca2")


@pytest.fixture
def loop(small_loop, adult):
    return Loop(scaled(small_loop, adult, 1.0), 250)


@pytest.fixture(scope="module")
def patient(loop_network, adult, tmp_path_factory):
    """A patient who is the loop itself with moved parameters: files for the stage, and true flows."""
    folder = tmp_path_factory.mktemp("patient")
    network = scaled(loop_network, adult, 1.0)
    loop = Loop(network, 500)
    width = 0.4 * (parameters.UPPER - parameters.LOWER)
    shift = np.random.default_rng(5).uniform(-0.5, 0.5, len(parameters.NAMES))
    point = np.clip(parameters.INITIAL + width * shift, parameters.LOWER, parameters.UPPER)
    truth = loop.evaluate(point, tolerance=1e-5)
    target = HyperaemicTarget(1.0, LV, 0.24)
    stress = float(hyperaemic_flow(loop, point[None], truth.state, target, None)[0])
    targets = {name: {"value": float(truth.measures[name][0]), "unit": BY_NAME[name].unit} for name in TUNED}
    radii = {"BC_lca1": 0.08, "BC_lca2": 0.08 * 0.5 ** (1 / 2.6), "BC_rca1": 0.08}
    outlets = [
        {"name": bc, "bc": bc, "perfuses": "LV" if bc in LV else "RV", "radius": radius} for bc, radius in radii.items()
    ]
    write_case_json(folder / "case.json", targets=targets, outlets=outlets)
    write_json(folder / "network.json", loop_network)
    write_perfusion_targets(folder / "targets.json", list(LV), [stress * 2 / 3, stress / 3])
    return folder, targets, stress


def tuned(folder, out, settings=QUICK, seed=1, **options):
    files = (folder / name for name in ("case.json", "network.json", "targets.json"))
    tune(*files, settings, seed, folder / out, report=lambda line: None, **options)
    return folder / out


@pytest.fixture(scope="module")
def out(patient):
    return tuned(patient[0], "out")


def test_tuning_recovers_what_a_known_loop_showed(patient, out):
    _, targets, stress = patient
    fit = pd.read_csv(out / "fit.csv").set_index("target")
    for name in ("PaoMin", "PaoMax", "PaoMean", "AbsQin", "EFLV", "ESV", "EDV", "AorCorSplit"):
        assert fit.relative[name] == pytest.approx(0.0, abs=0.05), name
        assert fit.measured[name] == pytest.approx(targets[name]["value"])
    assert fit.simulated["QLVHyper"] * (1 / 60) == pytest.approx(stress, rel=0.05)
    assert (fit.misfit**2).mean() < 2.0


def test_written_loops_are_periodic_and_hyperaemia_is_rest_with_wider_arterioles(out):
    rest, stress = (read_network(out / f"{name}.json") for name in ("rest", "hyperaemia"))
    values = {name: {bc["bc_name"]: bc["bc_values"] for bc in n["boundary_conditions"]}
              for name, n in (("rest", rest), ("stress", stress))}  # fmt: skip
    for bed in beds(rest):
        assert values["stress"][bed]["Ra"] == pytest.approx(0.24 * values["rest"][bed]["Ra"])
        assert values["stress"][bed]["Ram"] == pytest.approx(0.24 * values["rest"][bed]["Ram"])
        assert values["stress"][bed]["Rv"] == values["rest"][bed]["Rv"]
    fit = pd.read_csv(out / "fit.csv").set_index("target")
    for network in (rest, stress):
        result = Engine(network).run_cycles(
            quantities=["mean_pressure:J_heart_outlet:aorta"], cycles=3, steps_per_cycle=500
        )
        assert result.cycle_error[0] < 1e-3
    mean = Engine(rest).run_cycles(quantities=["mean_pressure:J_heart_outlet:aorta"], cycles=1, steps_per_cycle=500)
    mean = mean.values["mean_pressure:J_heart_outlet:aorta"][0] / 1333.22
    assert mean == pytest.approx(fit.simulated["PaoMean"], rel=1e-3)


def test_beds_come_out_shared_by_perfusion(out):
    resistance = distal_resistances(read_network(out / "rest.json"))
    assert resistance["BC_lca2"] / resistance["BC_lca1"] == pytest.approx(2.0)
    assert resistance["BC_rca1"] == pytest.approx(resistance["BC_lca1"], rel=1e-6)


def test_the_tables_say_what_the_parameters_are(out):
    table = read_csv(out / "parameters.csv", ("name", "unit", "value", "initial", "lower", "upper"))
    assert list(table.name) == list(parameters.NAMES)
    assert ((table.value >= table.lower * (1 - 1e-9) - 1e-9) | (table.lower < 0)).all()
    assert (table.value <= table.upper * (1 + 1e-9) + 1e-9).all()


def test_flow_reserve_fixes_the_venous_share(loop):
    state = loop.evaluate(parameters.INITIAL, cycles=12).state[0]
    split = float(loop.evaluate(parameters.INITIAL, state[None], 4).measures["AorCorSplit"][0])
    target = HyperaemicTarget(1.0, LV, 0.24)
    now = float(hyperaemic_flow(loop, parameters.INITIAL[None], state[None], target, 8)[0])
    for wanted in (0.85 * now, 1.15 * now):
        point = meet_hyperaemic_flow(loop, parameters.INITIAL, state, split, HyperaemicTarget(wanted, LV, 0.24), 6)
        after = loop.evaluate(point, state[None], 10)
        assert after.measures["AorCorSplit"][0] == pytest.approx(split, rel=0.01)
        assert hyperaemic_flow(loop, point[None], after.state, target, 10)[0] == pytest.approx(wanted, rel=0.01)


def test_a_reserve_out_of_reach_leaves_the_resting_split_met(loop):
    state = loop.evaluate(parameters.INITIAL, cycles=12).state[0]
    split = float(loop.evaluate(parameters.INITIAL, state[None], 4).measures["AorCorSplit"][0])
    point = meet_hyperaemic_flow(loop, parameters.INITIAL, state, split, HyperaemicTarget(50.0, LV, 0.24), 6)
    venous = parameters.NAMES.index("Rv_cor")
    assert point[venous] == parameters.LOWER[venous]
    assert loop.evaluate(point, state[None], 10).measures["AorCorSplit"][0] == pytest.approx(split, rel=0.05)


def test_missing_targets_and_unknown_beds_are_reported(patient, tmp_path):
    folder, targets, _ = patient
    case = json.loads((folder / "case.json").read_text())
    for name in ("network.json", "targets.json"):
        (tmp_path / name).write_text((folder / name).read_text())
    folder = tmp_path
    write_json(folder / "case.json", case | {"targets": {"PaoMean": targets["PaoMean"]}})
    with pytest.raises(InputError, match="AbsQin"):
        tuned(folder, "out")
    write_json(folder / "case.json", case)
    write_perfusion_targets(folder / "targets.json", ["BC_lca1", "BC_lca9"], [1.0, 1.0])
    with pytest.raises(InputError, match="BC_lca9"):
        tuned(folder, "out")
    assert not (folder / "out").exists()


@pytest.mark.long
@pytest.mark.parametrize(("seed", "pressure"), [(1, 1.0), (2, 1.0), (3, MMHG)])
def test_the_real_network_meets_its_clinical_targets(shared, tmp_path, seed, pressure):
    """Within 5 %, where the published fit of this network misses by up to 18 % (pressures) and 14 % (stroke volume).

    In CGS and in mmHg; where svZeroDSolver is installed, the tuned network gives the same measures there.
    """
    data = shared / "data/closed-loop-22"
    write_json(tmp_path / "in.json", rescaled(read_network(data / "svzerod_tuning_cgs.json"), 1.0 / pressure))
    tuned = tune_files(tmp_path / "in.json", data / "coronary_cgs.csv", Settings(), seed, tmp_path, report=print)
    fit = tuned.fit.set_index("target")
    assert (fit.relative[fit.clinical].abs() < 0.05).all(), fit.to_string()
    if program.installed():
        network = read_network(tmp_path / "rest.json")
        roles = waveform_names(network)
        names = sorted({name for members in roles.values() for name in members})
        result = program.SvZeroD(network).run_cycles(waveforms=names, cycles=3)
        waves = {role: sum(result.waveforms[name] for name in members) for role, members in roles.items()}
        theirs = in_own_units(measure(result.time, waves))
        for name in ("PaoMin", "PaoMax", "PaoMean", "AbsQin", "ESV", "EFLV", "AorCorSplit"):
            assert theirs[name][0] == pytest.approx(fit.simulated[name], rel=1e-3), name


@pytest.mark.long
def test_a_network_of_22_outlets_in_mmhg_is_tuned_and_runs(shared, tmp_path):
    """Briefly: near its pressures and stroke volume, and what is written is periodic."""
    data = shared / "data/closed-loop-22"
    write_json(tmp_path / "mmhg.json", rescaled(read_network(data / "svzerod_tuning_cgs.json"), 1.0 / MMHG))
    brief = Settings(candidates=8, starts=1, least_squares_steps=3, rounds=1, evaluations_per_parameter=2)
    said = []
    tuned = tune_files(
        tmp_path / "mmhg.json", data / "coronary_cgs.csv", brief, 1, tmp_path / "out", report=said.append
    )
    assert "read as mmHg" in said[0]
    fit = tuned.fit.set_index("target")
    assert (fit.relative[fit.clinical].abs() < 0.25).all(), fit.to_string()
    result = Engine(read_network(tmp_path / "out/rest.json")).run_cycles(cycles=2)
    assert result.ok[0] and result.cycle_error[0] < 1e-3


def test_a_network_in_mmhg_tunes_as_the_same_network_in_cgs(loop_network, adult, tmp_path):
    """Only the first few evaluations: their costs agree, so the network, the table and the parameters mean the same."""
    brief = Settings(
        candidates=8, starts=1, least_squares_steps=2, rounds=1, evaluations_per_parameter=2, final_steps_per_cycle=250
    )
    table = "".join(f"{name},text,{value}\n" for name, value in adult.items())
    (tmp_path / "targets.csv").write_text(table)
    write_json(tmp_path / "cgs.json", loop_network)
    write_json(tmp_path / "mmhg.json", rescaled(loop_network, 1.0 / MMHG))
    lines = {}
    for unit in ("cgs", "mmhg"):
        said = []
        tuned = tune_files(
            tmp_path / f"{unit}.json", tmp_path / "targets.csv", brief, 1, tmp_path / unit, report=said.append
        )
        lines[unit] = said[1:3]
        assert "read as " + {"cgs": "cgs", "mmhg": "mmHg"}[unit] in said[0]
        assert tuned.rest["closed_loop_blocks"][0]["parameters"]["Elv_s"] > 1000.0  # what is written is CGS
    assert lines["cgs"] == lines["mmhg"]
