"""A branch that arises elsewhere: as a network whose junctions were written so, and none as long as it does not."""

import copy

import numpy as np
import pytest

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.solver.carry_over import carry_over
from coronaryuq.zerod.solver.engine import Engine
from support.random_trees import network_of, random_tree

ONE = effect("misattached_branch")
PLACE = "diagonal from left_main"
WANTED = {"diagonal": "J1:diagonal", "lad_proximal": "J0:lad_proximal", "end": "lad_proximal:J1", "lcx": "J0:lcx"}
QUANTITIES = ("mean_flow", "min_flow", "max_flow", "mean_pressure", "max_pressure")


def anatomy_of(network):
    vessels = Anatomy(network).vessels
    return Anatomy(network, 1.2e5, dict.fromkeys(vessels, 0.5), 0.85)


def found(network, renamed, changes):
    """All quantities at all places, by the names that these have in the original network."""
    names = [f"{quantity}:{renamed.get(place, place)}" for place in WANTED.values() for quantity in QUANTITIES]
    run = Engine(network).run_to_periodic(changes, quantities=names, steps_per_cycle=200)
    return np.array([run.values[name][0] for name in names])


def with_effect(network, share, places=(PLACE,)):
    """The network with several places inserted, of which the first has the share."""
    renamed, changed = {}, network
    for place in places:
        fresh = ONE.aliases(place, anatomy_of(changed))
        changed = ONE.insert(changed, place, anatomy_of(changed))
        renamed = {old: fresh.get(new, new) for old, new in renamed.items()} | {
            old: new for old, new in fresh.items() if old not in renamed.values()
        }
    state = ConditionState(1.0, 0.85, {}, {}, {})
    changes = ONE.changes(changed, places[0], {"share": np.array([share])}, anatomy_of(network), state)
    return found(changed, renamed, changes)


def rewired(network):
    changed = copy.deepcopy(network)
    first, second = changed["junctions"]
    first["outlet_vessels"].append(3)
    second["outlet_vessels"].remove(3)
    return found(changed, {"J1:diagonal": "J0:diagonal"}, {})


def test_the_corrected_network_is_the_rewired_one():
    network = left_coronary()
    before = copy.deepcopy(network)
    right, renamed = ONE.corrected(network, PLACE)
    assert renamed == {"J1:diagonal": "J0:diagonal"} and network == before
    np.testing.assert_array_equal(found(right, renamed, {}), rewired(network))


def test_junctions_written_by_names_or_with_values_of_their_own_are_corrected():
    """A new outlet has no value at a junction with values, so it gets a plain junction ahead of it."""
    network = left_coronary()
    plain, _ = ONE.corrected(network, PLACE)
    first, second = network["junctions"]
    for junction in (first, second):
        count = len(junction["outlet_vessels"])
        zeros = {key: [0.0] * count for key in ("R_poiseuille", "L", "stenosis_coefficient")}
        junction |= {"junction_type": "BloodVesselJunction", "junction_values": zeros}
    second["junction_values"]["R_poiseuille"] = [7.0, 8.0]
    names = network.vessel_names
    for side in ("inlet", "outlet"):
        second[f"{side}_blocks"] = [names[number] for number in second.pop(f"{side}_vessels")]
    right, renamed = ONE.corrected(network, PLACE)
    assert right.junction("J1")["outlet_blocks"] == ["lad"]
    assert right.junction("J1")["junction_values"]["R_poiseuille"] == [7.0]
    assert right.junction("J0") == first | {"inlet_vessels": right.junction("J0")["inlet_vessels"]}
    right.junction("J1")["junction_values"]["R_poiseuille"] = [0.0]
    expected = found(plain, {"J1:diagonal": "J0:diagonal"}, {})
    assert found(right, renamed, {}) == pytest.approx(expected, rel=1e-6)


def test_places_are_ends_that_branch_and_are_not_beyond_the_branch():
    assert ONE.places(Anatomy(left_coronary())) == [
        "lad from left_main",
        "diagonal from left_main",
        "lcx from lad_proximal",
    ]


def test_a_branch_attached_elsewhere_equals_the_rewired_network():
    network = left_coronary()
    assert with_effect(network, 1.0) == pytest.approx(rewired(network), rel=3e-5)
    assert abs(rewired(network) / found(network, {}, {}) - 1.0).max() > 0.1


def test_a_branch_that_is_not_moved_changes_nothing():
    network = left_coronary()
    assert with_effect(network, 0.0) == pytest.approx(found(network, {}, {}), rel=3e-5)


def test_several_origins_fit_into_one_network():
    network = left_coronary()
    several = (PLACE, "lad from left_main", "lcx from lad_proximal")
    assert with_effect(network, 1.0, several) == pytest.approx(rewired(network), rel=3e-5)


def test_newtons_method_converges_wherever_a_branch_moves_to():
    """Connections of other branches stay closed, and that of the branch in the model closes."""
    network = network_of(*random_tree(0))
    plain = Engine(network)
    start = plain.run_cycles(cycles=6, steps_per_cycle=300).state[0]
    places = ONE.places(anatomy_of(network))
    assert len(places) > 20
    for group in np.array_split(places, 3):
        changed = network
        for place in group:
            changed = ONE.insert(changed, place, anatomy_of(changed))
        engine = Engine(changed)
        moved = {name: np.full(len(group), value) for name, value in engine.parameters.items()}
        for number, place in enumerate(group):
            state = ConditionState(1.0, 0.85, {}, {}, {})
            for name, value in ONE.changes(changed, place, {"share": 1.0}, anatomy_of(network), state).items():
                moved[name][number] = value
        own = np.tile(carry_over(plain.state_names, start, engine.state_names, {}), (len(group), 1))
        run = engine.run_cycles(moved, cycles=1, steps_per_cycle=300, start=own)
        assert run.ok.all() and (run.refinement == 1).all()
