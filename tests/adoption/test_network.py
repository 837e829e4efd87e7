"""A network with adopted effects, kind by kind; what cannot act in it."""

import pytest

from coronaryuq.adoption.network import with_effects
from coronaryuq.case.network.network import UNCERTAIN
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import Theta
from support.adopted_effects import SCALES, adopted, placed
from support.small_loop import loop

FLOWS = ["mean_flow:J0:lca1", "mean_flow:J0:lca2", "mean_pressure:J_heart_outlet:aorta"]


@pytest.mark.parametrize("name", ["side_branch_leak", "collateral", "aortic_stenosis", "diffuse_narrowing"])
def test_an_adopted_effect_changes_the_flow_and_its_absence_does_not(name):
    network = adopted([placed(name, z=1.0)])
    with_it, plain = (Engine(one).run_to_periodic(quantities=FLOWS) for one in (network, loop()))
    absent = Engine(network).run_to_periodic(Theta(network).mixtures.absent, quantities=FLOWS)
    change = max(abs(with_it.values[one][0] / plain.values[one][0] - 1) for one in FLOWS)
    assert change > 0.002
    for one in FLOWS:
        assert absent.values[one][0] == pytest.approx(plain.values[one][0], rel=1e-5)


def test_the_hearts_value_is_that_of_the_loop_that_was_searched():
    searched = loop()
    searched.heart["parameters"]["Rlv_ao"] *= 3.0
    network = with_effects(loop(), searched, [[placed("aortic_stenosis")]], SCALES).network
    rise = Theta(network).mixtures.mixtures[0].members[0]
    assert rise.absent["CLH.Rlv_ao"] == searched.heart["parameters"]["Rlv_ao"]
    assert network.heart["parameters"]["Rlv_ao"] > searched.heart["parameters"]["Rlv_ao"]


@pytest.mark.parametrize(
    ("name", "place", "says"),
    [
        ("pressure_offset", "lca1:BC_lca1", "error of a sensor"),
        ("autoregulation", "all beds", "follow the pressures"),
        ("incomplete_hyperaemia", "all beds", "condition of the case"),
        ("exchanged_outlets", "BC_lca1~BC_lca2", "wiring"),
        ("side_branch", "lca1", "add the branch to the case's anatomy"),
    ],
)
def test_what_cannot_act_leaves_the_network_as_it_is_and_gives_a_reason(name, place, says):
    one = placed(name, measurement=name == "pressure_offset")
    one = type(one)(one.effect, place, *list(vars(one).values())[2:])
    found = with_effects(loop(), loop(), [[one]], SCALES)
    assert found.network == loop() and UNCERTAIN not in found.network
    assert says in found.refused[one.label]


def test_an_element_at_a_place_that_the_case_reads_is_refused():
    found = with_effects(loop(), loop(), [[placed("quadratic_stenosis")]], SCALES, ["J0:lca1"])
    assert "J0:lca1" in found.refused["quadratic stenosis at lca1"] and UNCERTAIN not in found.network


def test_locations_that_the_case_reads_are_known_by_their_new_names():
    """A loss ahead of a vessel, and a leak behind it."""
    network = adopted([placed("quadratic_stenosis")], [placed("side_branch_leak")])
    renamed, known = Theta(network).mixtures.renamed, Engine(network).unknowns
    assert set(renamed) == {"J0:lca1", "lca1:BC_lca1"}
    assert all(f"flow:{new}" in known and f"flow:{old}" not in known for old, new in renamed.items())


def test_nothing_to_adopt_is_the_same_network():
    assert with_effects(loop(), loop(), [], SCALES).network == loop()
