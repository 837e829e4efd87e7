"""The repaired model reproduces the fit, can be searched as it is, and its changes are listed completely."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.open_loop_tree import PERIOD, left_coronary
from coronaryuq.bench.discrepancy.pullback_cases import PATH, model
from coronaryuq.core import units
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition, read_conditions, write_conditions
from coronaryuq.discrepancy.data.measurements import COLUMNS, PULLBACK_COLUMNS, Measured
from coronaryuq.discrepancy.forward.hypothesis import PlacedEffect
from coronaryuq.discrepancy.hidden.experiment import loop_conditions
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.read_problem import make_problem, read_problem, read_series
from coronaryuq.discrepancy.result.repair import (
    repaired,
    repaired_conditions,
    repaired_measurements,
    repaired_network,
    rewired,
    value_changes,
)
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.period import period_of
from coronaryuq.zerod.network.read import read_network
from support.hypotheses import assume


def test_a_regurgitant_aortic_valve_is_written_and_read(shared, tmp_path):
    network = read_network(shared / "data" / "svzerod-cases" / "closedLoopHeart_withCoronaries.json")
    anatomy = Anatomy(network)
    place = anatomy.inlet(anatomy.roots[0])
    conditions = dict(list(loop_conditions().items())[:2])
    measured = [Measured(name, "pressure", place, "mean", None, 1.0, np.ones(1), np.ones(1)) for name in conditions]
    forward = make_problem(network, conditions, measured, Settings(steps_per_cycle=100)).forward
    leak = ("aortic_regurgitation", "aortic valve")
    z = np.append(np.zeros(len(forward.nuisances)), 1.0)
    repaired(forward, assume(leak), Fit(z, np.zeros(1), np.zeros((1, len(z))))).write(tmp_path)
    assert "CLH.Gao_leak: added, " in (tmp_path / "difference.txt").read_text()
    again = read_network(tmp_path / "repaired.json")
    written = read_conditions(tmp_path / "conditions.yaml")
    read = make_problem(again, written, measured, Settings(steps_per_cycle=100)).forward
    expected = forward.predict(z, assume(leak))[0]
    assert read.predict(np.zeros(len(read.nuisances)))[0] == pytest.approx(expected, rel=2e-3)
    assert np.abs(expected / forward.predict(z[:-1])[0] - 1.0).max() > 0.005


def test_measurements_have_the_locations_of_the_repaired_network(tmp_path):
    """A loss ahead of a vessel that stores blood, and a leak before its bed, rename two locations."""
    experiment = open_loop()
    network, conditions = experiment.network, experiment.conditions
    anatomy = Anatomy(network)
    bed, vessel = next(iter(anatomy.beds.items()))
    values = next(v for v in network["vessels"] if v["vessel_name"] == vessel)["zero_d_element_values"]
    values["C"] = max(values.get("C", 0.0), 1e-7)
    names = {anatomy.inlet(vessel): f"{anatomy.upstream[vessel]}:{vessel}_loss"}
    names |= {f"{vessel}:{bed}": f"{vessel}_leak:{bed}"}
    periods = {name: period_of(apply_condition(network, condition)) for name, condition in conditions.items()}
    phase = (np.arange(20) + 0.3) / 20
    measured = [
        Measured(name, quantity, place, statistic, time, period, np.ones(k), np.full(k, 0.1))
        for name, period in periods.items()
        for place in names
        for quantity, statistic, time, k in (("pressure", "waveform", phase * period, 20), ("flow", "mean", None, 1))
    ]
    measured += [
        Measured(name, "perfusion", bed, "mean", None, t, np.ones(1), np.full(1, 0.1)) for name, t in periods.items()
    ]
    measured.sort(key=lambda one: list(periods).index(one.condition))
    forward = make_problem(network, conditions, measured, Settings()).forward
    acting = assume(("quadratic_stenosis", vessel), ("side_branch_leak", vessel))
    z = np.append(np.zeros(len(forward.nuisances)), [0.5, 0.5])
    expected = forward.predict(z, acting)[0]
    for one, predicted in zip(forward.measured, forward.split(expected[None, :]), strict=True):
        one.value[:] = predicted[0]
    repaired(forward, acting, Fit(z, np.zeros(1), np.zeros((1, len(z))))).write(tmp_path)
    difference = (tmp_path / "difference.txt").read_text()
    assert "the network: dyn/cm2, mL, s)" in difference
    assert all(f"\n  {old} -> {new}\n" in difference for old, new in names.items())
    written = read_conditions(tmp_path / "conditions.yaml")
    files = tmp_path / "measurements.csv", written, tmp_path / "conditions.yaml"
    again = read_problem(read_network(tmp_path / "repaired.json"), *files, Settings())
    series = [(one.condition, one.quantity, names.get(one.location, one.location)) for one in measured]
    assert [(one.condition, one.quantity, one.location) for one in again.forward.measured] == series
    assert again.y == pytest.approx(expected, rel=1e-12)
    assert again.forward.predict(np.zeros(again.count))[0] == pytest.approx(expected, rel=2e-3)


def test_a_side_branch_follows_the_conditions_of_its_bed_in_the_repaired_model(tmp_path):
    """Scaled, set, driven and recalibrated under a condition, as the bed that it copies is."""
    phase = np.linspace(0.0, PERIOD, 51)
    changes = {"scale": {"BC_lcx": {"Ra2": 1.5}}, "set": {"BC_lcx": {"Cc": 2e-6}}}
    drive = {"BC_lcx": (phase, 4e4 * np.sin(np.pi * phase / PERIOD) ** 2)}
    conditions = {"rest": Condition("rest"), "other": Condition("other", 0.5, drive=drive, **changes)}
    times = PERIOD * (np.arange(20) + 0.5) / 20
    measured = [
        Measured(name, "flow", place, "waveform", times, PERIOD, np.ones(20), np.ones(20))
        for name in conditions
        for place in ("J0:lcx", "lcx:BC_lcx")
    ]
    forward = make_problem(left_coronary(), conditions, measured, Settings()).forward
    acting = assume(("side_branch", "lcx"), ("intramyocardial_pressure", "all beds"))
    z = np.append(0.5 * np.random.default_rng(2).normal(size=len(forward.nuisances)), [1.0, 1.0])
    expected = forward.predict(z, acting)[0]
    repaired(forward, acting, Fit(z, np.zeros(1), np.zeros((1, len(z))))).write(tmp_path)
    written = read_conditions(tmp_path / "conditions.yaml")
    again = make_problem(
        read_network(tmp_path / "repaired.json"),
        written,
        [replace(one, location=one.location.replace("lcx:BC", "lcx_branch:BC")) for one in measured],
        Settings(),
    ).forward
    assert again.predict(np.zeros(len(again.nuisances)))[0] == pytest.approx(expected, rel=2e-3, abs=1e-3)


def test_repaired_measurements_keep_the_times_of_a_pullback(tmp_path):
    """Without them, the drift of the wire had another course in the repaired case."""
    pressure, drift = (("hyperaemia", quantity, PATH, "mean") for quantity in ("pressure", "drift"))
    rows = [(*pressure, 60.0 + 30.0 * k, 70.0, 1.0, "mmHg", 120.0 - 40.0 * k, "mm") for k in range(4)]
    rows.append((*drift, 300.0, 1.0, 0.5, "mmHg", np.nan, ""))
    path, conditions = tmp_path / "measurements.csv", {"hyperaemia": Condition("hyperaemia")}
    pd.DataFrame(rows, columns=[*COLUMNS, *PULLBACK_COLUMNS]).to_csv(path, index=False)
    measured = read_series(model(), path, conditions, "conditions.yaml")
    forward = make_problem(model(), conditions, measured, Settings()).forward
    z = np.zeros(len(forward.nuisances))
    repaired(forward, assume(), Fit(z, np.zeros(1), np.zeros((1, len(z))))).write(tmp_path / "repaired")
    again = read_series(model(), tmp_path / "repaired" / "measurements.csv", conditions, "conditions.yaml")
    courses = [[one.pullback.response for one in each] for each in (again, measured)]
    assert all(new == pytest.approx(old) for new, old in zip(*courses, strict=True))
    assert courses[1][0][0] == pytest.approx(units.MMHG * 0.5)


def test_a_rewired_model_is_a_case_that_predicts_what_the_patient_has(tmp_path):
    """The branch arises from the left main there, and all measurements keep their places."""
    patient = open_loop()
    error, place = effect("misattached_branch"), "lcx from lad_proximal"
    wrong, moved = error.corrected(patient.network, place)
    conditions = patient.conditions
    places = {"flow": "J1:lcx", "pressure": "lcx:BC_lcx"}
    assert moved == {"J0:lcx": "J1:lcx"}
    measured = [
        Measured(name, quantity, location, "mean", None, 0.85, np.ones(1), np.full(1, 0.1))
        for name in conditions
        for quantity, location in places.items()
    ]
    true = [replace(one, location={"J1:lcx": "J0:lcx"}.get(one.location, one.location)) for one in measured]
    expected = make_problem(patient.network, conditions, true, Settings())
    start = np.zeros(expected.count)
    for one, value in zip(measured, expected.forward.predict(start)[0], strict=True):
        one.value[:] = value
    forward = make_problem(wrong, conditions, measured, Settings()).forward
    rewired(forward, [PlacedEffect(error, "lcx from left_main")]).write(tmp_path)
    assert "lcx arises from the end of left_main" in (tmp_path / "difference.txt").read_text()
    files = tmp_path / "measurements.csv", read_conditions(tmp_path / "conditions.yaml"), tmp_path / "conditions.yaml"
    again = read_problem(read_network(tmp_path / "rewired.json"), *files, Settings())
    assert [one.location for one in again.forward.measured] == [one.location for one in true]
    np.testing.assert_allclose(again.forward.predict(np.zeros(again.count))[0], again.y, rtol=1e-9)
    assert np.abs(forward.predict(np.zeros(len(forward.nuisances)))[0] / again.y - 1.0).max() > 0.01


def test_a_named_error_of_a_sensor_is_not_in_the_measurements_that_are_written():
    """The corrected table holds what the model predicts without it, and the uncertainty of its size."""
    experiment = open_loop()
    blank = experiment.plan.blank(experiment.network, experiment.conditions, np.random.default_rng(1))
    problem = make_problem(experiment.network, experiment.conditions, blank, Settings())
    forward, hypothesis = problem.forward, assume(("pressure_gain", "lad:BC_lad"))
    z = np.append(np.zeros(len(forward.nuisances)), 1.5)
    read, true = forward.predict(z, hypothesis)[0], forward.predict(z[:-1])[0]
    blocks = zip(forward.measured, forward.split(read[None, :]), strict=True)
    forward.measured = [replace(series, value=values[0]) for series, values in blocks]
    rows = int(problem.train.sum())
    jacobian = np.zeros((rows, len(z)))
    jacobian[0, -1] = 10.0
    fit = Fit(z, np.zeros(rows), jacobian, flexible=problem.flexible)
    table = repaired_measurements(forward, hypothesis, fit)
    factor = table["unit"].map({"mL/s": 1.0, "mmHg": units.MMHG, "mL/min/g": units.MBF_PER_MIN_PER_G})
    np.testing.assert_allclose(table["value"] * factor, true, rtol=1e-12)
    wrong = ((table["quantity"] == "pressure") & (table["location"] == "lad:BC_lad")).to_numpy()
    stated = np.concatenate([series.sd for series in forward.measured])
    sd = np.sqrt(fit.posterior.moments()[1][-1, -1]) * 0.08
    np.testing.assert_allclose((table["sd"] * factor)[~wrong], stated[~wrong], rtol=1e-12)
    np.testing.assert_allclose((table["sd"] * factor)[wrong], np.hypot(stated, sd * true)[wrong], rtol=1e-6)


def test_added_and_removed_values_are_listed():
    """As when CORONARY_VAR_RES replaces CORONARY."""
    old = {"Ra1": 1.0, "Ra2": 3.0, "Pim": [0.0, 1.0], "t": [0.0, 1.0]}
    new = {"Ra1": 2.0, "Ra2_min": 4.0, "Pim": [0.0, 1.5, 2.0], "t": [0.0, 1.0], "e": [1.0, 1.0]}
    assert value_changes("BC", old, new) == [
        "  BC.Ra1: 1 -> 2",
        "  BC.Ra2_min: added, 4",
        "  BC.Pim: waveform replaced",
        "  BC.e: added, a waveform",
        "  BC.Ra2: removed, was 3",
    ]
    assert value_changes("BC", old, dict(old)) == []


@pytest.mark.slow
def test_repaired_files_reproduce_the_fitted_predictions(stenosis_case, tmp_path):
    """The repaired network under the repaired conditions, without effects, predicts what the fit predicts."""
    folder, truth = stenosis_case
    conditions = read_conditions(folder / "conditions.yaml")
    table = folder / "measurements.csv"
    problem = read_problem(read_network(folder / "model.json"), table, conditions, "c", Settings())
    forward = problem.forward
    for acting in (
        truth.hypothesis,
        assume(("intramyocardial_pressure", "all beds")),
        assume(("autoregulation", "all beds")),
    ):
        z = np.full(problem.count + 1, 0.4)
        z[[i for i, n in enumerate(forward.nuisances) if n.mass]] = 0.0
        wanted = forward.predict(z, acting)[0]
        network = repaired_network(forward, acting, z)
        write_conditions(tmp_path, *repaired_conditions(forward, acting, z))
        again = read_conditions(tmp_path / "conditions.yaml")
        repaired = read_problem(network, table, again, "c", Settings())
        repaired.forward.masses = forward.masses
        # The fit is linear in the errors of vessels and of parts of beds, the network is not.
        differing = (repaired.forward.predict(np.zeros(repaired.count))[0] - wanted) / problem.sd
        assert np.abs(differing).max() < 0.5 and np.sqrt(np.mean(differing**2)) < 0.15
