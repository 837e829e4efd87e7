"""Exchanged outlets: corrected as the complete exchange, and the exchange of the exchanged is the original."""

import copy

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.effects.library import effect

ONE, PLACE = effect("exchanged_outlets"), "BC_lad~BC_diagonal"


def test_the_corrected_network_has_the_values_of_a_complete_exchange():
    network = left_coronary()
    before = copy.deepcopy(network)
    right, renamed = ONE.corrected(network, PLACE)
    assert renamed == {} and network == before
    state = ConditionState(1.0, 0.85, {}, {}, {})
    changes = ONE.changes(network, PLACE, {"share": np.ones(1)}, Anatomy(network), state)
    assert {name.split(".")[0] for name in changes} == {"BC_lad", "BC_diagonal"}
    for name, (value,) in changes.items():
        bed, parameter = name.split(".")
        assert right.bed_values(bed)[parameter] == pytest.approx(value)
    assert ONE.corrected(right, PLACE)[0] == network
