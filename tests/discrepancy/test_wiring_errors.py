"""Wiring errors of the model: seen, said, not named as an effect, and corrected in a model that explains the data."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import analyse
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.nature import Outside
from coronaryuq.discrepancy.result.summary_text import paragraph
from coronaryuq.discrepancy.result.write import write
from coronaryuq.discrepancy.search_case import searched
from coronaryuq.discrepancy.selection.answer import NOTHING
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import assume


def exchanged(network, condition):
    one, other = (next(b for b in network["boundary_conditions"] if b["bc_name"] == n) for n in ("BC_lad", "BC_lcx"))
    for name in ("Ra1", "Ra2", "Rv1", "Ca", "Cc"):
        values, others = one["bc_values"], other["bc_values"]
        values[name], others[name] = others[name], values[name]
    return network


def reattached(network, condition):
    """The diagonal arises at the end of the left main."""
    first, second = network["junctions"]
    first["outlet_vessels"].append(3)
    second["outlet_vessels"].remove(3)
    return network


@pytest.mark.long
@pytest.mark.parametrize(
    ("wired", "error", "place", "told"),
    [
        (exchanged, "exchanged_outlets", "BC_lad~BC_lcx", "the outlets BC_lad and BC_lcx are exchanged"),
        (reattached, "misattached_branch", "diagonal from left_main", "diagonal arises from the end of left_main"),
    ],
    ids=["exchanged outlets", "misattached branch"],
)
def test_a_wiring_error_is_reported_as_such(wired, error, place, told, tmp_path):
    make_case.hide(open_loop(), assume(), np.zeros(0), make_case.Noise(), 11, tmp_path, Outside(network=wired))
    found = analyse(tmp_path)
    assert found.outside_library and not found.named
    answer, out = write(found, tmp_path / "out"), tmp_path / "out"
    (said,) = answer["wiring_errors"]
    assert (said["error"], said["place"], said["statement"]) == (error, place, told)
    assert f": {told}" in paragraph(answer) and "No effect is named; rewired.json" in paragraph(answer)
    assert not (out / "repaired.json").exists()
    files = (out / name for name in ("rewired.json", "measurements.csv", "conditions.yaml"))
    again = searched(*files, Settings(), 1)
    assert again.consistent and again.answer.probabilities[NOTHING] > 0.9
    write(again, out)
    assert (out / "repaired.json").exists() and not (out / "rewired.json").exists()
