"""Errors of the vessels: their shapes are the changes of the predictions, in full."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.forward.nuisance import Nuisance
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.inference.vessel_errors import SD_RESISTANCE, vessel_errors
from coronaryuq.discrepancy.settings import Settings


@pytest.mark.slow
def test_shapes_and_rest_hold_the_change_by_a_narrower_vessel():
    experiment = open_loop()
    blank = experiment.plan.blank(experiment.network, experiment.conditions, generator(1, "test", "vessels"))
    forward = make_problem(experiment.network, experiment.conditions, blank, Settings()).forward
    (plain,) = forward.predict(np.zeros(len(forward.nuisances)))
    noise = 0.01 * np.abs(plain) + 1e-3 * np.abs(plain).min()
    _, shapes, rest = vessel_errors(forward).shapes(noise)
    targets = ("lad_proximal.R_poiseuille", "lad_proximal.L")
    forward.nuisances = [*forward.nuisances, Nuisance("lad", SD_RESISTANCE, targets)]
    (narrower,) = forward.predict(np.eye(len(forward.nuisances))[-1])
    change = (narrower - plain) / noise
    weights, *_ = np.linalg.lstsq((shapes / noise).T, change, rcond=None)
    left = change - weights @ (shapes / noise)
    assert np.linalg.norm(left) <= np.linalg.norm(rest / noise) + 1e-9
    assert np.linalg.norm(weights) <= 1.0 + 1e-6, "within one standard deviation"
