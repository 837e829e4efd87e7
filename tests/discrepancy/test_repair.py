"""The repaired model is what was fitted and can be examined as it is, and what it changed is told in full."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.discrepancy.data.conditions import period_of, read_conditions, under
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.inference.gauss_newton import Fit
from coronaryuq.discrepancy.inference.read_problem import make_problem, read_problem
from coronaryuq.discrepancy.result.repair import _changed, repaired
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.stage import loop_conditions
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import read_network
from support.hypotheses import assume


def test_a_leaking_aortic_valve_is_written_and_read_back(shared, tmp_path):
    network = read_network(shared / "data" / "svzerod-cases" / "closedLoopHeart_withCoronaries.json")
    anatomy = Anatomy(network)
    place = anatomy.inlet(anatomy.roots[0])
    conditions = {one.name: one for one in loop_conditions()[:2]}
    measured = [Measured(name, "pressure", place, "mean", None, 1.0, np.ones(1), np.ones(1)) for name in conditions]
    forward = make_problem(network, conditions, measured, Settings(steps_per_cycle=100)).forward
    leak = (effect("aortic_regurgitation"), "aortic valve")
    z = np.append(np.zeros(len(forward.nuisances)), 1.0)
    repaired(forward, assume(leak), Fit(z, np.zeros(1), np.zeros((1, len(z))))).write(tmp_path)
    assert "CLH.Gao_leak: added, " in (tmp_path / "difference.txt").read_text()
    again = read_network(tmp_path / "repaired.json")
    written = read_conditions(tmp_path / "conditions.yaml")
    read = make_problem(again, written, measured, Settings(steps_per_cycle=100)).forward
    expected = forward.predict(z, assume(leak))[0]
    assert read.predict(np.zeros(len(read.nuisances)))[0] == pytest.approx(expected, rel=2e-3)
    assert np.abs(expected / forward.predict(z[:-1])[0] - 1.0).max() > 0.005


def test_measurements_go_with_the_repaired_network(tmp_path):
    """A loss ahead of a vessel that stores blood, and a leak before its bed, give two locations other names."""
    network, conditions, _ = open_loop()
    anatomy = Anatomy(network)
    bed, vessel = next(iter(anatomy.beds.items()))
    values = next(v for v in network["vessels"] if v["vessel_name"] == vessel)["zero_d_element_values"]
    values["C"] = max(values.get("C", 0.0), 1e-7)
    names = {anatomy.inlet(vessel): f"{anatomy.upstream[vessel]}:{vessel}_loss"}
    names |= {f"{vessel}:{bed}": f"{vessel}_leak:{bed}"}
    periods = {name: period_of(under(network, condition)) for name, condition in conditions.items()}
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
    forward = make_problem(network, conditions, measured, Settings()).forward
    acting = assume(("quadratic_stenosis", vessel), ("side_branch_leak", vessel))
    z = np.append(np.zeros(len(forward.nuisances)), [0.5, 0.5])
    expected = forward.predict(z, acting)[0]
    for one, predicted in zip(forward.measured, forward.split(expected[None, :]), strict=True):
        one.value[:] = predicted[0]
    repaired(forward, acting, Fit(z, np.zeros(1), np.zeros((1, len(z))))).write(tmp_path)
    told = (tmp_path / "difference.txt").read_text()
    assert "the network's: dyn/cm2, mL, s)" in told
    assert all(f"\n  {old} -> {new}\n" in told for old, new in names.items())
    written = read_conditions(tmp_path / "conditions.yaml")
    files = tmp_path / "measurements.csv", written, tmp_path / "conditions.yaml"
    again = read_problem(read_network(tmp_path / "repaired.json"), *files, Settings())
    series = [(one.condition, one.quantity, names.get(one.location, one.location)) for one in measured]
    assert [(one.condition, one.quantity, one.location) for one in again.forward.measured] == series
    assert again.y == pytest.approx(expected, rel=1e-12)
    assert again.forward.predict(np.zeros(again.count))[0] == pytest.approx(expected, rel=2e-3)


def test_what_is_added_and_what_goes_is_told():
    """As where CORONARY_VAR_RES takes the place of CORONARY."""
    old = {"Ra1": 1.0, "Ra2": 3.0, "Pim": [0.0, 1.0], "t": [0.0, 1.0]}
    new = {"Ra1": 2.0, "Ra2_min": 4.0, "Pim": [0.0, 1.5, 2.0], "t": [0.0, 1.0], "e": [1.0, 1.0]}
    assert _changed("BC", old, new) == [
        "  BC.Ra1: 1 -> 2",
        "  BC.Ra2_min: added, 4",
        "  BC.Pim: waveform replaced",
        "  BC.e: added, a waveform",
        "  BC.Ra2: removed, was 3",
    ]
    assert _changed("BC", old, dict(old)) == []
