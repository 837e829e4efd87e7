"""Effects as uncertain parameters: which one acts, how large it is, and that the file's values are the centre."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.case.network.network import UNCERTAIN
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.read import check_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import Theta
from support.adopted_effects import KINDS, adopted, placed
from support.small_loop import loop


def rows(network, z):
    theta = Theta(network)
    values = theta.laws.values(np.atleast_2d(z))
    return theta.changes(dict(zip(theta.laws.names, values.T, strict=True)))


@pytest.mark.parametrize("name", KINDS)
def test_the_files_values_are_those_at_the_centre_and_the_size_has_its_law(name):
    network = adopted([placed(name)])
    own, sizes = Engine(network).parameters, KINDS[name][1]
    still = rows(network, np.zeros(sizes))
    assert {target: float(np.ravel(value)[0]) for target, value in still.items()} == pytest.approx(
        {target: own[target] for target in still}
    )
    law, moved = effect(name), rows(network, np.eye(sizes)[0])
    size = float(law.parameters[0].from_standard(0.3 + 0.2))
    if name == "quadratic_stenosis":
        assert moved["lca1_loss.stenosis_coefficient"] == pytest.approx(size * 1.2e5 / 2.4**2)
    if name == "side_branch_leak":
        assert moved["BC_leak_lca1.Rp"] == pytest.approx(0.1 * 1.2e5 / (size * 2.4))
    if name == "haematocrit":
        before = loop().bed_values("BC_lca1")["Ra"]
        centre = float(law.parameters[0].from_standard(0.3))
        assert moved["BC_lca1.Ra"] == pytest.approx(before * np.exp(size - centre)), "tuned with the mean in it"
        assert moved["lca1.R_poiseuille"] == pytest.approx(500.0 * np.exp(size))


@given(st.floats(-3, 3), st.sampled_from([0, 1, 2]))
def test_one_member_acts_in_each_sample(z, number):
    """Its targets are those that it would have alone; without an effect that acts, those of no effect."""
    acting, silent = ("quadratic_stenosis", "diffuse_narrowing"), placed("pressure_offset", 0.2, True)
    network = adopted([placed(acting[0], 0.5), placed(acting[1], 0.3), silent])
    assert Theta(network).laws.names == ["missing_1_size", "missing_1_member"]
    own = Theta(network).laws.coordinates(np.array([[z, float(number)]]))
    changes = rows(network, own)
    alone = [rows(adopted([placed(one)]), [[z]]) for one in acting]
    plain = Engine(loop()).parameters
    for target, value in changes.items():
        expected = plain.get(target, 0.0)
        if number < 2:
            expected = alone[number].get(target, expected)
        assert float(np.ravel(value)[0]) == pytest.approx(float(np.ravel(expected)[0]), rel=1e-9, abs=1e-9), target


def test_members_are_drawn_by_their_probabilities():
    network = adopted([placed("quadratic_stenosis", 0.7), placed("diffuse_narrowing", 0.3)])
    laws = Theta(network).laws
    drawn = laws.values(np.random.default_rng(0).standard_normal((20_000, 2)))[:, 1]
    assert set(drawn) == {0.0, 1.0} and np.mean(drawn) == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / 20_000))


def test_effects_of_two_classes_on_one_vessel_add_up():
    network = adopted([placed("diffuse_narrowing")], [placed("stenosis_with_viscous_loss")])
    narrow, loss = adopted([placed("diffuse_narrowing")]), adopted([placed("stenosis_with_viscous_loss")])
    both = rows(network, [1.0, -1.0, 0.5])
    assert both["lca2.R_poiseuille"] == pytest.approx(rows(narrow, [1.0])["lca2.R_poiseuille"])
    for target, value in rows(loss, [-1.0, 0.5]).items():
        assert both[target] == pytest.approx(value)


def test_what_an_effect_sets_is_held_in_calibration():
    network = adopted([placed("side_branch_leak")], [placed("aortic_stenosis")])
    assert {"BC_leak_lca1.Rp", "BC_leak_lca1.Rd", "CLH.Rlv_ao"} == network.held
    assert adopted([placed("haematocrit")]).held == {
        f"{name}.R_poiseuille" for name in ("aorta", "outlet", "lca1", "lca2")
    }


@pytest.mark.parametrize("break_it", [{"members": []}, {"members": [{"effect": "wish"}]}, {"scales": 1, "members": 2}])
def test_an_entry_that_is_none_is_refused_in_one_line(break_it):
    network = adopted([placed("quadratic_stenosis")])
    network[UNCERTAIN][0] |= break_it
    with pytest.raises(InputError, match="uncertain_parameters"):
        Theta(check_network(network), "network.json")
