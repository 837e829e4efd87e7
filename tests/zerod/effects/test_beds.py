"""Effects of the beds."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.solver.engine import Engine

COMPLIANCE = effect("bed_compliance")
STATE = ConditionState(1.0, 0.85, {}, {}, {})


def test_a_beds_compliance_changes_the_pulse_of_its_flow_and_not_its_mean():
    network = left_coronary()
    changes = COMPLIANCE.changes(network, "BC_lcx", {"log_factor": np.log([1.0, 3.0])}, Anatomy(network), STATE)
    own = network.bed_values("BC_lcx")
    assert {name: value.tolist() for name, value in changes.items()} == {
        "BC_lcx.Ca": pytest.approx([own["Ca"], 3.0 * own["Ca"]]),
        "BC_lcx.Cc": pytest.approx([own["Cc"], 3.0 * own["Cc"]]),
    }
    names = [f"{quantity}_flow:lcx:BC_lcx" for quantity in ("mean", "min", "max")]
    found = Engine(network).run_to_periodic(changes, quantities=names, steps_per_cycle=300)
    mean, least, greatest = (found.values[name] for name in names)
    # The vessels' compliances and inertances see the other pulse, too.
    assert mean[1] == pytest.approx(mean[0], rel=2e-3)
    assert (greatest - least)[1] > 1.3 * (greatest - least)[0]


def test_beds_without_a_compliance_are_no_places():
    network = left_coronary()
    network.bed_values("BC_lad").update(Ca=0.0, Cc=0.0)
    assert COMPLIANCE.places(Anatomy(network)) == ["BC_diagonal", "BC_lcx"]


def test_the_size_is_told_as_a_factor():
    (size,) = COMPLIANCE.parameters
    assert COMPLIANCE.describe(size, np.log(5.0), Anatomy(left_coronary()))[1] == pytest.approx(5.0)
