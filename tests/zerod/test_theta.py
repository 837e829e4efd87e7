"""Uncertain parameters of a network: their law, what they change, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.case.network.network import UNCERTAIN
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.beds import resistance_changes
from coronaryuq.zerod.network.read import check_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.svzerodsolver import program
from coronaryuq.zerod.theta import Laws, Theta, UncertainParameter, read_theta, theta_changes
from support.zerod_networks import closed_loop

LOSS = {
    "name": "loss", "distribution": "lognormal", "centre": 2.0, "spread": 0.3, "kind": "factor",
    "targets": {"left.R_poiseuille": -4.0, "BC_left.Ra": 1.0},
}  # fmt: skip
PRESSURE = {
    "name": "shift", "distribution": "normal", "centre": -1.0, "spread": 5.0, "kind": "add",
    "targets": {"left.stenosis_coefficient": 2.0}, "loadings": {"loss": 3.0}, "unit": "1", "meaning": "a shift",
}  # fmt: skip


def network(*entries):
    loop = closed_loop(steps=200)
    loop[UNCERTAIN] = [dict(entry) for entry in entries]
    return check_network(loop)


def test_values_change_their_targets_and_those_of_the_beds():
    loop = network(LOSS, PRESSURE)
    theta = {"BC_left": np.array([1.5]), "R_cor_scaling": np.array([0.8]), "loss": np.array([3.0]), "shift": np.ones(1)}
    changes = theta_changes(loop, theta)
    own = Engine(loop).parameters
    assert changes["left.R_poiseuille"] == pytest.approx(own["left.R_poiseuille"] * 1.5**-4)
    assert changes["BC_left.Ra"] == pytest.approx(own["BC_left.Ra"] * 1.5 * 0.8 * 1.5)
    assert changes["left.stenosis_coefficient"] == pytest.approx(own["left.stenosis_coefficient"] + 4.0)


def test_wanted_parameters_change_as_they_do_among_all():
    theta, columns = Theta(network(LOSS, PRESSURE)), {"BC_left": np.ones(2), "loss": np.array([3.0, 2.0])}
    columns |= {"shift": np.array([1.0, -1.0])}
    every, some = theta.changes(columns), theta.changes(columns, {"left.stenosis_coefficient"})
    assert np.array_equal(every["left.stenosis_coefficient"], some["left.stenosis_coefficient"])
    assert "left.R_poiseuille" in every and "left.R_poiseuille" not in some


@given(st.lists(st.floats(-6, 6), min_size=2, max_size=2), st.floats(0.5, 2.0))
def test_without_spread_nothing_changes_to_the_bit(z, multiplier):
    loop = network(LOSS | {"spread": 0.0}, PRESSURE | {"spread": 0.0, "loadings": {}})
    theta = Theta(loop)
    values = theta.laws.values(np.array([z]))
    columns = {"BC_left": np.array([multiplier]), **dict(zip(theta.laws.names, values.T, strict=True))}
    changes, own = theta.changes(columns), Engine(loop).parameters
    for name, value in resistance_changes(loop, {"BC_left": np.array([multiplier])}).items():
        assert np.array_equal(changes.pop(name), value), name
    assert {name: float(value[0]) for name, value in changes.items()} == {name: own[name] for name in changes}


@given(st.lists(st.lists(st.floats(-4, 4), min_size=3, max_size=3), min_size=1, max_size=4))
def test_coordinates_are_those_of_the_values(z):
    entries = [
        UncertainParameter("a", "lognormal", 2.0, 0.5, "factor", {}),
        UncertainParameter("b", "normal", -3.0, 2.0, "add", {}, {"a": -0.7}),
        UncertainParameter("c", "lognormal", 0.1, 0.2, "factor", {}, {"a": 0.3, "b": 0.4}),
    ]
    laws = Laws(entries)
    values = laws.values(np.array(z))
    assert np.allclose(laws.coordinates(values), z, atol=1e-9)
    assert np.array_equal(laws.values(np.array(z[:1])), values[:1])


def test_loadings_correlate():
    laws = Laws([UncertainParameter(**LOSS), UncertainParameter(**PRESSURE)])
    z = np.random.default_rng(0).standard_normal((20_000, 2))
    logged = np.log(laws.values(z)[:, 0]), laws.values(z)[:, 1]
    expected = 0.3 * 3.0 / (0.3 * np.hypot(5.0, 3.0))
    assert np.corrcoef(logged)[0, 1] == pytest.approx(expected, abs=4 / np.sqrt(20_000))
    assert np.median(laws.values(z), axis=0) == pytest.approx([2.0, -1.0], abs=0.2)


def test_a_table_may_lack_a_parameter_and_may_not_have_another(tmp_path):
    loop = network(LOSS)
    (tmp_path / "samples.csv").write_text("sample,chain,draw,BC_left,loss\ns0,0,1,1.5,2.5\n")
    assert list(read_theta(tmp_path / "samples.csv", 0, 1, loop).columns) == ["sample", "BC_left", "loss"]
    assert theta_changes(loop, {"BC_left": np.ones(1)}) == resistance_changes(loop, {"BC_left": np.ones(1)})
    with pytest.raises(InputError, match="loss"):
        read_theta(tmp_path / "samples.csv", 0, 1, network())


def test_svzerodsolver_gets_a_network_without_them():
    loop = network(LOSS)
    assert UNCERTAIN in loop.deep_copy() and UNCERTAIN not in loop.for_svzerodsolver()
    program.last_cycle(loop, ["flow:left:BC_left"])


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("loss", "expected a list of objects"),
        (LOSS | {"name": "BC_left"}, "uncertain_parameters[0].name = 'BC_left': expected a name that is no bed's"),
        (LOSS | {"name": "draw"}, "uncertain_parameters[0].name = 'draw'"),
        (LOSS | {"sd": 1.0}, "uncertain_parameters[0].sd: unknown key"),
        ({"name": "loss"}, "uncertain_parameters[0].distribution: missing"),
        (LOSS | {"distribution": "uniform"}, "expected lognormal or normal"),
        (LOSS | {"kind": "wish"}, "uncertain_parameters[0].kind = 'wish': expected factor or add"),
        (LOSS | {"distribution": "normal"}, "factor needs lognormal"),
        (LOSS | {"centre": 0.0}, "uncertain_parameters[0].centre = 0.0: expected a positive number"),
        (LOSS | {"spread": -1.0}, "uncertain_parameters[0].spread = -1.0"),
        (LOSS | {"targets": {"left": "all"}}, "expected an object of names and numbers"),
        (LOSS | {"targets": {"lost.R_poiseuille": 1.0}}, "'lost.R_poiseuille': no such scalar parameter"),
        (LOSS | {"loadings": {"other": 1.0}}, "uncertain_parameters[0].loadings = 'other': not an earlier entry"),
    ],
)
def test_entries_that_are_none_are_refused_in_one_line(entry, says):
    loop = closed_loop(steps=200)
    loop[UNCERTAIN] = [entry]
    with pytest.raises(InputError) as error:
        Theta(check_network(loop), "network.json")
    assert says in str(error.value) and "\n" not in str(error.value)


def test_two_of_one_name_are_refused():
    with pytest.raises(InputError, match="loss"):
        Theta(network(LOSS, LOSS))
