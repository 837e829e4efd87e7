"""The repaired model of a closed loop, with a parameter of ours that its file does not have."""

import numpy as np
import pytest

from coronaryuq.discrepancy.conditions import read_conditions
from coronaryuq.discrepancy.inference import Fit
from coronaryuq.discrepancy.measurements import Measured
from coronaryuq.discrepancy.model import make_problem
from coronaryuq.discrepancy.repair import write_repaired
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.discrepancy.stage import loop_conditions
from coronaryuq.files import read_json
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect


def test_a_leaking_aortic_valve_is_written_and_read_back(shared, tmp_path):
    network = read_json(shared / "data" / "svzerod-cases" / "closedLoopHeart_withCoronaries.json")
    anatomy = Anatomy(network)
    place = anatomy.inlet(anatomy.roots[0])
    conditions = {one.name: one for one in loop_conditions()[:2]}
    measured = [Measured(name, "pressure", place, "mean", None, 1.0, np.ones(1), np.ones(1)) for name in conditions]
    forward = make_problem(network, conditions, measured, Settings(steps_per_cycle=100)).forward
    leak = (effect("aortic_regurgitation"), "aortic valve")
    z = np.append(np.zeros(len(forward.nuisances)), 1.0)
    write_repaired(forward, [leak], Fit(z, np.zeros(1), np.zeros((1, len(z)))), tmp_path)
    assert "CLH.Gao_leak: 0 -> " in (tmp_path / "difference.txt").read_text()
    again = read_json(tmp_path / "repaired.json")
    written = read_conditions(tmp_path / "conditions.yaml")
    read = make_problem(again, written, measured, Settings(steps_per_cycle=100)).forward
    expected = forward.predict(z, [leak])[0]
    assert read.predict(np.zeros(len(read.nuisances)))[0] == pytest.approx(expected, rel=2e-3)
    assert np.abs(expected / forward.predict(z[:-1])[0] - 1.0).max() > 0.005
