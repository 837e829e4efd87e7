"""The pressure at a distance lies between those at the ends of its vessel, as its loss is spread."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.bench.discrepancy.pullback_cases import VESSELS, model
from coronaryuq.case.anatomy.tree import Vessel
from coronaryuq.case.network.build import Physics, elements
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.units import MMHG
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.data.measurements import Measured
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.forward.pullbacks import pressures, read, shares, vessels_of_readings, vessels_on
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.result.repair import repaired_network
from coronaryuq.discrepancy.settings import Settings
from support.hypotheses import assume, placed
from support.pullbacks import pulled_through

PATH = tuple(VESSELS)
LENGTHS = [length for length, _ in VESSELS.values()]
ENDS = np.cumsum(LENGTHS)
TOPOLOGY = Topology(model())
CONDITIONS = {
    name: Condition(name, coronary_resistance_scale=scale) for name, scale in (("rest", 1.0), ("stress", 0.3))
}


def pulled(distance, **kind):
    return pulled_through(*PATH, distance=distance, length=float(ENDS[-1]), **kind)


def forward(*series, network=None):
    return make_problem(network or model(), CONDITIONS, list(series), Settings(steps_per_cycle=200)).forward


def probe(location, statistic="mean", quantity="pressure"):
    return Measured("stress", quantity, location, statistic, None, 0.85, np.ones(1), np.ones(1))


@pytest.mark.slow
@pytest.mark.parametrize("statistic", ["mean", "min", "max"])
def test_at_the_ends_of_vessels_a_wire_reads_what_a_probe_reads(statistic):
    places = [TOPOLOGY.inlet("left_main"), *(TOPOLOGY.outlet(vessel) for vessel in PATH)]
    probes = [probe(place, statistic) for place in places]
    model_of = forward(pulled([0.0, *ENDS], condition="stress", statistic=statistic), *probes)
    values = model_of.predict(np.zeros(len(model_of.nuisances)))[0]
    assert values[: len(places)] == pytest.approx(values[len(places) :], rel=1e-12)


@pytest.mark.slow
def test_a_ratio_is_that_of_mean_pressures_over_the_root():
    outlet = TOPOLOGY.outlet("lad")
    wire = pulled([0.0, 1.0, ENDS[-1]], condition="stress", quantity="pullback ratio")
    model_of = forward(wire, probe(outlet, quantity="ratio"), probe(model_of_root := TOPOLOGY.inlet("left_main")))
    values = model_of.predict(np.zeros(len(model_of.nuisances)))[0]
    assert values[0] == pytest.approx(1.0, rel=1e-12) and values[2] == pytest.approx(values[3], rel=1e-12)
    # A drift of a millimetre of mercury changes the ratio by its share of the pressure at the root.
    assert model_of.measured[0].pullback.response[0] == pytest.approx(MMHG / values[4]), model_of_root


@pytest.mark.slow
def test_within_a_vessel_a_wire_reads_what_a_finer_network_has():
    """A vessel cut in two, with half of each element, has the same mean pressure at the cut."""
    network = model()
    halves = [{**network.vessel("lad_seg1"), "vessel_name": name, "vessel_length": 1.5} for name in ("first", "second")]
    for half in halves:
        values = network.vessel_values("lad_seg1")
        half["zero_d_element_values"] = {name: 0.5 * value for name, value in values.items()}
    number = network.vessel("lad_seg1")["vessel_id"]
    halves[0]["vessel_id"], halves[1]["vessel_id"] = number, 99
    fine = model()
    fine["vessels"] = [vessel for vessel in fine.vessels if vessel["vessel_id"] != number] + halves
    for junction in fine.junctions:
        junction["inlet_vessels"] = [99 if one == number else one for one in junction["inlet_vessels"]]
    fine.junctions.append(
        {
            "junction_name": "cut",
            "junction_type": "NORMAL_JUNCTION",
            "inlet_vessels": [number],
            "outlet_vessels": [99],
        }
    )
    wire = forward(pulled([0.0, ENDS[1] + 1.5, ENDS[-1]], condition="stress"))
    probes = forward(probe("first:cut"), network=fine)
    assert wire.predict(np.zeros(len(wire.nuisances)))[0, 1] == pytest.approx(
        probes.predict(np.zeros(len(probes.nuisances)))[0, 0], rel=1e-4
    )


@given(st.lists(st.floats(0.05, 0.4), min_size=2, max_size=9))
def test_the_loss_of_a_tapering_vessel_is_spread_as_its_resistance(radii):
    """The fraction of the resistance ahead of a point is that of Poiseuille's law with these radii."""
    count = len(radii)
    x = np.linspace(0.0, 3.0, count)
    vessel = Vessel("v", x[:, None] * [1.0, 0.0, 0.0], np.array(radii), None, "LAD")
    network = model()
    network.vessel("left_main").update(vessel_length=3.0, radii=radii)
    found = shares(Topology(network), pulled_through("left_main", distance=x).pullback, {})[:, 0]
    ahead = [elements(vessel.between(0.0, end), Physics())["R_poiseuille"] for end in x[1:]]
    assert found == pytest.approx([0.0, *(np.array(ahead) / ahead[-1])], rel=1e-6)


def test_the_loss_of_a_focal_stenosis_falls_at_its_place():
    """In the network with its vessel added ahead, which has no length of its own."""
    focal = placed("focal_stenosis", "lad_seg1")
    problem = forward(pulled([0.0, 6.0, 12.0]))
    structure, _ = problem.simulation.structure([focal])
    topology = Topology(structure)
    wire = pulled([0.0, *(ENDS[1] + np.array([0.5, 1.0, 1.5, 2.0])), 12.5])
    assert vessels_on(topology, wire.pullback) == [*PATH[:2], "lad_seg1_focal", *PATH[2:]]
    _, start, end = focal.effect.extent("lad_seg1", {"position": 0.5, "length": 1.0}, Topology(model()))
    assert (start, end) == pytest.approx((2.0 / 3.0, 5.0 / 3.0))
    found = shares(topology, wire.pullback, {"lad_seg1_focal": (1.0, 2.0)})[:, 2]
    assert found == pytest.approx([0.0, 0.0, 0.0, 0.5, 1.0, 1.0])


@given(st.lists(st.floats(-50.0, 150.0), min_size=6, max_size=6), st.integers(0, 40))
def test_readings_lie_between_the_pressures_at_the_ends_of_their_vessel(ends, number):
    wire = pulled(np.linspace(0.0, 12.5, 41))
    names = pressures(TOPOLOGY, wire.pullback)
    waves = {name: np.full((1, 4), value) for name, value in zip(names, ends, strict=True)}
    value = read(wire, waves, TOPOLOGY, [{}], "", 1.0)[0, number]
    vessel = PATH.index(vessels_of_readings(TOPOLOGY, wire.pullback)[number])
    low, high = sorted(ends[vessel : vessel + 2])
    assert low - 1e-9 <= value <= high + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("vessel", ["left_main", "lad_seg1"])
def test_the_repaired_network_has_the_loss_at_its_place(vessel):
    """Without the effect, its network reproduces the readings of the model with it."""
    wire = pulled(np.linspace(0.0, 12.5, 26), condition="stress")
    hypothesis = assume(("focal_stenosis", vessel))
    before = forward(wire)
    z = np.concatenate([np.zeros(len(before.nuisances)), [0.5, 0.2, -0.4, -0.3]])
    network = repaired_network(before, hypothesis, z)
    assert network.vessel(f"{vessel}_focal")["vessel_length"] == 0.0 and network.vessel(f"{vessel}_focal")["placed_in"]
    after = forward(wire, network=network)
    expected = before.predict(z, hypothesis)[0]
    assert after.predict(np.zeros(len(after.nuisances)), PLAIN)[0] == pytest.approx(expected, rel=1e-6)
    plain = before.predict(np.zeros(len(before.nuisances)))[0]
    assert np.abs(plain - expected).max() > MMHG


def test_other_sensors_do_not_act_on_a_wire():
    """It was equalised: offsets, gains and filters of other pressures leave its readings unchanged."""
    from coronaryuq.zerod.effects.library import SEARCHED

    wires = [pulled([0.0, 6.0, 12.0]), pulled([0.0, 6.0, 12.0], condition="stress", quantity="pullback ratio")]
    anatomy = forward(*wires).anatomy
    sensors = [one for one in SEARCHED if one.side == "measurement" and one.name not in ("wire_drift", "drive_gain")]
    assert {one.name for one in sensors if one.places(anatomy, wires)} == set()
    drift = next(one for one in SEARCHED if one.name == "wire_drift")
    assert drift.places(anatomy, wires) == [f"{wires[0].location} under rest", f"{wires[0].location} under stress"]
    zeros = [np.zeros((1, 3)), np.zeros((1, 3))]
    (off, same) = drift.observe(f"{wires[0].location} under rest", {"drift": np.array([2.0])}, wires, zeros)
    assert off[0] == pytest.approx(2.0 * wires[0].pullback.response) and not same.any()


@pytest.mark.slow
def test_one_wire_does_not_move_another():
    first, second = pulled([0.0, 6.0, 12.0]), pulled([0.0, 6.0, 12.0], condition="stress")
    both = forward(first, second)
    alone = forward(replace(second))
    values = both.predict(np.zeros(len(both.nuisances)))[0]
    assert values[3:] == pytest.approx(alone.predict(np.zeros(len(alone.nuisances)))[0], rel=1e-9)
