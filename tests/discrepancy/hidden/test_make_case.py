"""Cases with hidden effects."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.open_loop_tree import pressures
from coronaryuq.discrepancy.data.conditions import Condition, read_conditions
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.experiment import Experiment
from support.hypotheses import assume


def test_a_hidden_case_keeps_all_keys_of_its_conditions(tmp_path):
    """Including drives and free parameters."""
    time, aortic, _ = pressures()
    driven = Condition("low", drive={"AORTA": (time, 0.8 * aortic)}, free=("coronary_resistance_scale",), held_out=True)
    conditions = {"rest": Condition("rest"), "low": driven}
    made = open_loop()
    experiment = Experiment(made.network, conditions, made.plan)
    make_case.hide(experiment, assume(), np.zeros(0), make_case.Noise(), 3, tmp_path)
    read = read_conditions(tmp_path / "conditions.yaml")
    assert read["low"].free == driven.free and read["low"].held_out
    assert read["low"].drive["AORTA"][1] == pytest.approx(0.8 * aortic)
