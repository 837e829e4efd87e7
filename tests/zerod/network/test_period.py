"""The cardiac period: reading it, and stretching a network to another one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.zerod.network.period import period_of, set_period
from support.small_loop import loop

NETWORKS = {"open loop": left_coronary, "closed loop": loop}


@pytest.mark.parametrize("kind", NETWORKS)
@given(period=st.floats(0.2, 3.0))
def test_a_period_that_is_set_is_read_and_keeps_phases(kind, period):
    network = NETWORKS[kind]()
    before, own = network.deep_copy(), period_of(network)
    set_period(network, period)
    assert period_of(network) == pytest.approx(period, rel=1e-12)
    for old, new in zip(before.elements(), network.elements(), strict=True):
        times = np.array(old.values.get("t", []))
        if len(times) > 1:
            assert np.array(new.values["t"]) / period == pytest.approx(times / own, abs=1e-12)


@pytest.mark.parametrize("kind", NETWORKS)
def test_setting_the_own_period_changes_nothing_but_its_statement(kind):
    network = NETWORKS[kind]()
    before = network.deep_copy()
    set_period(network, period_of(network))
    for old, new in zip(before.elements(), network.elements(), strict=True):
        if "t" in old.values:
            assert new.values["t"] == pytest.approx(old.values["t"], abs=1e-15)


def test_a_constant_waveform_does_not_set_the_period():
    network = left_coronary()
    for block in network["boundary_conditions"]:
        for name in ("P", "Pim"):
            if name in block["bc_values"]:
                block["bc_values"] |= {name: block["bc_values"][name][:1], "t": [0.0]}
    assert period_of(network) == 1.0
    network["simulation_parameters"]["cardiac_period"] = 0.7
    assert period_of(network) == 0.7
    set_period(network, 0.8)
    assert period_of(network) == 0.8
