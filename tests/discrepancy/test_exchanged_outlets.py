"""Outlets exchanged in the model: seen, said, and not named as an effect."""

from types import SimpleNamespace

import numpy as np

from coronaryuq.bench.discrepancy import analyse
from coronaryuq.bench.hidden_cases import open_loop
from coronaryuq.discrepancy import hidden
from coronaryuq.discrepancy.candidates import Candidate, preferred
from coronaryuq.discrepancy.inference import Fit
from coronaryuq.discrepancy.output import summary
from coronaryuq.discrepancy.words import paragraph


def exchanged(network, condition):
    one, other = (next(b for b in network["boundary_conditions"] if b["bc_name"] == n) for n in ("BC_lad", "BC_lcx"))
    for name in ("Ra1", "Ra2", "Rv1", "Ca", "Cc"):
        values, others = one["bc_values"], other["bc_values"]
        values[name], others[name] = others[name], values[name]
    return network


def test_two_exchanged_outlets_are_said_and_not_named(tmp_path):
    network, conditions, plan = open_loop()
    hidden.hide(network, conditions, plan, [], np.zeros(0), 1.0, 11, tmp_path, exchanged)
    found = analyse(tmp_path)
    assert [place for _, place in found.verdict.mistaken] == ["BC_lad~BC_lcx"]
    assert found.outside_library and not found.named
    assert summary(found)["mistakes"] == [{"mistake": "exchanged_outlets", "place": "BC_lad~BC_lcx"}]
    assert "outlets had been exchanged in the model: BC_lad and BC_lcx." in paragraph(found, ["half dilated"])


def candidate(evidence: float, nameable: bool) -> Candidate:
    """One whose log weight is that evidence."""
    residual = np.array([np.sqrt(-2.0 * evidence)])
    found = Candidate(SimpleNamespace(nameable=nameable), "here", 0.0)
    found.fit = Fit(np.zeros(0), residual, np.zeros((1, 0)))
    return found


def test_an_effect_goes_before_a_mistake_that_the_data_cannot_tell_from_it():
    mistake, close, far = candidate(-10.0, False), candidate(-12.0, True), candidate(-15.0, True)
    assert preferred([far, mistake, close]) is close
    assert preferred([far, mistake]) is mistake
