"""Outlets exchanged in the model: seen, said, and not named as an effect."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import analyse
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.nature import Outside
from coronaryuq.discrepancy.result.summary_text import paragraph
from coronaryuq.discrepancy.result.write import summary
from support.hypotheses import assume


def exchanged(network, condition):
    one, other = (next(b for b in network["boundary_conditions"] if b["bc_name"] == n) for n in ("BC_lad", "BC_lcx"))
    for name in ("Ra1", "Ra2", "Rv1", "Ca", "Cc"):
        values, others = one["bc_values"], other["bc_values"]
        values[name], others[name] = others[name], values[name]
    return network


@pytest.mark.long
def test_two_exchanged_outlets_are_reported_as_a_wiring_error(tmp_path):
    make_case.hide(open_loop(), assume(), np.zeros(0), make_case.Noise(), 11, tmp_path, Outside(network=exchanged))
    found = analyse(tmp_path)
    assert [place for _, place in found.answer.wiring_errors] == ["BC_lad~BC_lcx"]
    assert found.outside_library and not found.named
    assert summary(found)["wiring_errors"] == [{"error": "exchanged_outlets", "place": "BC_lad~BC_lcx"}]
    assert "a wiring error of the model, exchanged outlets: BC_lad and BC_lcx." in paragraph(summary(found))
