"""Tests of effects: sizes do what the formulas say, and a vanishing effect changes nothing."""

import copy

import numpy as np
import pytest
from scipy.optimize import linprog

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.case.network.network import Network
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Series
from coronaryuq.zerod.effects.library import SEARCHED, effect
from coronaryuq.zerod.network.waveforms import sampled
from coronaryuq.zerod.solver.engine import Engine
from support.pullbacks import pulled_through
from support.zerod_networks import closed_loop

pytestmark = pytest.mark.slow

HEART = ("aortic_stenosis", "aortic_regurgitation", "mitral_stenosis", "pulmonary_stenosis", "right_heart_weakness")
NETWORK_SIDE = [one for one in SEARCHED if one.side == "network" and one.name not in HEART]
PROBES = [Series("rest", "flow", f"{vessel}:BC_{vessel}", "mean", None, 1.0) for vessel in ("lad", "lcx")]
PROBES += [pulled_through("lad")]


def anatomy_of(network):
    anatomy = Anatomy(network)
    found = Engine(network).run_to_periodic(
        quantities=[f"mean_flow:{anatomy.inlet(v)}" for v in anatomy.vessels], steps_per_cycle=200
    )
    flows = {v: float(found.values[f"mean_flow:{anatomy.inlet(v)}"][0]) for v in anatomy.vessels}
    return Anatomy(network, 1.2e5, flows, 0.85)


@pytest.fixture(scope="module")
def tree():
    network = left_coronary()
    return network, anatomy_of(network)


def situation(anatomy, resistance_scale=0.5):
    beds = dict.fromkeys(anatomy.beds, 1.1e5)
    felt = {bed: np.array([0.9e5]) for bed in beds}
    return ConditionState(resistance_scale, anatomy.period, felt, beds, {})


def flows(network, anatomy, one=None, place=None, sizes=None):
    """Mean flow into every bed with (or without) an effect."""
    renamed, changes = {}, {}
    if one is not None:
        renamed = one.aliases(place, anatomy)
        network = one.insert(network, place, anatomy)
        changes = one.changes(network, place, sizes, anatomy, situation(anatomy))
        for name, value in list(changes.items()):
            if np.ndim(value) == 2:
                driven, waveform = name.split(".")
                block = next(b for b in network["boundary_conditions"] if b["bc_name"] == driven)
                block["bc_values"]["t"] = np.linspace(0, anatomy.period, value.shape[1]).tolist()
                block["bc_values"][waveform] = value[0].tolist()
                del changes[name]
    names = [renamed.get(f"{v}:{bed}", f"{v}:{bed}") for bed, v in anatomy.beds.items()]
    found = Engine(network).run_to_periodic(changes, [f"mean_flow:{n}" for n in names], steps_per_cycle=200)
    assert found.ok.all(), found.status
    return np.array([found.values[f"mean_flow:{n}"][0] for n in names])


@pytest.mark.parametrize("one", NETWORK_SIDE, ids=lambda one: one.name)
def test_a_vanishing_effect_leaves_all_flows_unchanged(one, tree):
    network, anatomy = tree
    sizes = {p.name: np.array([1e-7]) for p in one.parameters}
    plain = flows(network, anatomy)
    for place in one.places(anatomy, PROBES)[:3]:
        assert flows(network, anatomy, one, place, sizes) == pytest.approx(plain, rel=2e-4)


@pytest.mark.parametrize("one", NETWORK_SIDE, ids=lambda one: one.name)
def test_insertion_does_not_change_the_given_network(one, tree):
    network, anatomy = tree
    before = copy.deepcopy(network)
    one.insert(network, one.places(anatomy, PROBES)[0], anatomy)
    assert network == before


def test_every_effect_is_documented():
    names = [one.name for one in SEARCHED]
    assert len(set(names)) == len(names)
    for one in SEARCHED:
        assert one.formula and one.source and one.signature and one.native and one.parameters
        assert one.formula in type(one).__doc__ and one.source in type(one).__doc__


@pytest.mark.parametrize("one", SEARCHED, ids=lambda one: one.name)
def test_conversions_between_sizes_and_standard_numbers_are_inverse(one):
    z = np.linspace(-2, 2, 5)
    for parameter in one.parameters:
        assert parameter.to_standard(parameter.from_standard(z)) == pytest.approx(z)


def test_a_stenosis_takes_its_share_of_the_pressure_at_the_reference_flow(tree):
    """At the reference flow Q the added drop S Q^2 is the stated share of the mean pressure."""
    network, anatomy = tree
    found = effect("quadratic_stenosis").changes(network, "lcx", {"loss": np.array([0.2])}, anatomy, situation(anatomy))
    drop = found["lcx.stenosis_coefficient"] * anatomy.flow["lcx"] ** 2
    assert drop == pytest.approx(0.2 * anatomy.pressure)


def test_a_stenosis_with_viscous_loss_loses_pressure_to_both(tree):
    """At the reference flow, S Q^2 is the first size times the mean pressure and R Q the second size times that."""
    network, anatomy = tree
    one, flow = effect("stenosis_with_viscous_loss"), anatomy.flow["lcx"]
    network = one.insert(network, "lcx", anatomy)
    sizes = {"loss": np.array([0.02, 0.05]), "viscous": np.array([2.0, 0.5])}
    found = one.changes(network, "lcx", sizes, anatomy, situation(anatomy))
    assert found["lcx_loss.stenosis_coefficient"] * flow**2 == pytest.approx(sizes["loss"] * anatomy.pressure)
    assert found["lcx_loss.R_poiseuille"] * flow == pytest.approx(0.04 * anatomy.pressure * np.array([1.0, 0.625]))
    alone = effect("quadratic_stenosis").changes(network, "lcx", sizes, anatomy, situation(anatomy))
    assert alone == {"lcx_loss.stenosis_coefficient": pytest.approx(found["lcx_loss.stenosis_coefficient"])}


@pytest.mark.parametrize(("name", "place"), [("quadratic_stenosis", "lcx"), ("bifurcation_loss", "lad_proximal")])
def test_a_loss_ahead_of_a_vessel_equals_a_loss_of_the_vessel(name, place, tree):
    """Vessels that store blood get the loss in a vessel ahead, an equivalent network with the same flows."""
    network, anatomy = tree
    one, sizes = effect(name), {"loss": np.array([0.1])}
    assert all(anatomy.vessels[vessel]["zero_d_element_values"]["C"] > 0.0 for vessel in one.vessels(place, anatomy))
    own = copy.deepcopy(network)
    for entry in own["vessels"]:
        added = one.changes(network, place, sizes, anatomy, situation(anatomy))
        if f"{entry['vessel_name']}.stenosis_coefficient" in added:
            loss = float(added[f"{entry['vessel_name']}.stenosis_coefficient"][0])
            entry["zero_d_element_values"]["stenosis_coefficient"] = loss
    assert one.insert(network, place, anatomy)["vessels"][-1]["vessel_name"].endswith("_loss")
    assert flows(network, anatomy, one, place, sizes) == pytest.approx(flows(own, anatomy), rel=1e-4)
    assert flows(own, anatomy) != pytest.approx(flows(network, anatomy), rel=1e-2)


def test_a_narrowing_follows_poiseuille(tree):
    """R ~ r^-4, L ~ r^-2 and C ~ r^3 for one radius."""
    network, anatomy = tree
    old = anatomy.vessels["lad"]["zero_d_element_values"]
    new = effect("diffuse_narrowing").changes(network, "lad", {"loss": np.array([0.1])}, anatomy, situation(anatomy))
    radius = (old["R_poiseuille"] / new["lad.R_poiseuille"]) ** 0.25
    assert new["lad.L"] == pytest.approx(old["L"] / radius**2)
    assert new["lad.C"] == pytest.approx(old["C"] * radius**3)


def test_collateral_feeds_the_bed_with_the_lower_pressure():
    """Behind a tight stenosis of the LAD a collateral from the circumflex raises the LAD bed's flow."""
    network = left_coronary()
    lad = next(v for v in network["vessels"] if v["vessel_name"] == "lad")
    lad["zero_d_element_values"]["R_poiseuille"] = 8e4
    anatomy = anatomy_of(network)
    plain = flows(network, anatomy)
    fed = flows(network, anatomy, effect("collateral"), "lad~lcx", {"conductance": np.array([1.0])})
    lad_bed, lcx_bed = (list(anatomy.beds).index(f"BC_{name}") for name in ("lad", "lcx"))
    assert fed[lad_bed] > 1.1 * plain[lad_bed]
    assert fed[lcx_bed] < plain[lcx_bed]


def test_a_leak_takes_its_share_of_the_flow():
    network = left_coronary()
    anatomy = anatomy_of(network)
    one, sizes = effect("side_branch_leak"), {"share": np.array([0.5])}
    leaking = one.insert(network, "lcx", anatomy)
    changes = one.changes(leaking, "lcx", sizes, anatomy, situation(anatomy))
    names = ["mean_flow:lcx:J_lcx_leak", "mean_flow:lcx_leak:BC_lcx", "mean_flow:leak_lcx:BC_leak_lcx"]
    found = Engine(leaking).run_to_periodic(changes, names, steps_per_cycle=200).values
    above, below, leak = (found[name][0] for name in names)
    assert above == pytest.approx(below + leak, rel=1e-6)
    # The leak is rated at the mean pressure of the root; the drop on the way there takes a little.
    assert leak == pytest.approx(0.5 * anatomy.flow["lcx"], rel=0.2)


@pytest.mark.parametrize("dilated", [1.0, 0.25])
def test_the_bed_of_a_side_branch_is_in_proportion_to_the_others_under_every_condition(dilated):
    """At the same pressure half of a bed has half of its flow, at every moment; so does a bed for two."""
    network = left_coronary()
    anatomy = anatomy_of(network)
    one, sizes = effect("side_branch"), {"share": np.array([0.5])}
    condition = Condition("any", coronary_resistance_scale=dilated)
    branched = one.insert(one.insert(network, "lcx", anatomy), "lad_proximal", anatomy)
    under = apply_condition(branched, condition)
    changes = one.changes(under, "lcx", sizes, anatomy, situation(anatomy, dilated))
    statistics, ends = ("mean", "max", "min"), ("lcx_branch:BC_lcx", "side_branch_lcx:BC_side_branch_lcx")
    names = [[f"{statistic}_flow:{end}" for statistic in statistics] for end in ends]
    found = Engine(under).run_to_periodic(changes, sum(names, []), steps_per_cycle=200).values
    below, branch = (np.array([found[name][0] for name in each]) for each in names)
    assert branch == pytest.approx(0.5 * below, rel=1e-5)
    assert set(one.changes(under, "lad_proximal", sizes, anatomy, situation(anatomy))).isdisjoint(changes)


def test_incomplete_hyperaemia_does_not_act_at_rest(tree):
    network, anatomy = tree
    one = effect("incomplete_hyperaemia")
    assert one.changes(network, "all beds", {"share": np.array([0.3])}, anatomy, situation(anatomy, 1.0)) == {}
    below, found, above = (
        one.changes(network, "all beds", {"share": np.array([share])}, anatomy, situation(anatomy, 0.25))
        for share in (0.9, 1.0, 1.1)
    )
    assert all(above[name] - found[name] == pytest.approx(found[name] - below[name]) for name in found)
    # With the whole dilatation missing, the network under the condition (0.25) is back at rest (1).
    own = anatomy.blocks["BC_lad"]["bc_values"]["Ra1"]
    assert found["BC_lad.Ra1"] == pytest.approx(4.0 * own)


def perfusion_series():
    places = ("BC_a", "BC_b", "BC_c")
    return [Series(c, "perfusion", p, "mean", None, 1.0) for c in ("rest", "stress") for p in places]


def test_underestimated_perfusion_follows_renkin_and_crone():
    """MBF over F is (1 - exp(-PS/F)) over its value at the lowest flow, so rest is correct and stress too low."""
    series = perfusion_series()
    true = [np.array([[value]]) for value in (1.0, 1.1, 1.2, 3.0, 3.3, 4.0)]
    seen = effect("mbf_underestimation").observe("perfusion map", {"saturation": np.array([0.5])}, series, true)
    expected = [f * (1 - np.exp(-2.0 / f)) / (1 - np.exp(-2.0)) for f in (1.0, 1.1, 1.2, 3.0, 3.3, 4.0)]
    assert np.ravel(seen) == pytest.approx(expected)


def test_rotation_by_a_whole_territory_is_a_permutation():
    series = perfusion_series()
    true = [np.array([[value]]) for value in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    seen = effect("rotated_territories").observe("perfusion map", {"share": np.array([1.0])}, series, true)
    assert np.ravel(seen) == pytest.approx([2.0, 3.0, 1.0, 5.0, 6.0, 4.0])


def test_no_rotation_depends_on_the_order_of_the_measurements():
    series = perfusion_series()
    order = [4, 2, 0, 5, 1, 3]
    true = [np.array([[value]]) for value in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    one, size = effect("rotated_territories"), {"share": np.array([-0.3])}
    seen = one.observe("perfusion map", size, series, true)
    mixed = one.observe("perfusion map", size, [series[i] for i in order], [true[i] for i in order])
    assert np.ravel(mixed) == pytest.approx(np.ravel(seen)[order])


@pytest.mark.parametrize(
    ("name", "place"), [("shifted_territory", "BC_a<BC_b"), ("rotated_territories", "perfusion map")]
)
def test_a_share_of_a_territory_has_no_kink_at_one(name, place):
    """A fit that noise takes beyond 1 found no derivative there; the printed share exceeded the one that acts."""
    true = [np.array([[value]]) for value in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    below, at, above = (
        np.ravel(effect(name).observe(place, {"share": np.array([share])}, perfusion_series(), true))
        for share in (0.9, 1.0, 1.1)
    )
    assert above - at == pytest.approx(at - below) and np.abs(above - at).max() > 0.05


def test_an_error_of_the_map_between_flows_needs_two_of_them():
    """Pressures under another condition say nothing of it."""
    rest, stress = perfusion_series()[:3], [Series("stress", "pressure", "a:b", "mean", None, 1.0)]
    one = effect("mbf_underestimation")
    assert one.places(None, rest + stress) == [] and one.places(None, perfusion_series()) == ["perfusion map"]


def test_a_shared_offset_acts_on_all_pressures_of_its_place(tree):
    """It adds the same pressure everywhere; the root pressure stays if only the wire has the error."""
    network, anatomy = tree
    one, root, size = effect("shared_offset"), "AORTA:left_main", {"offset": np.array([0.1])}
    but_root = f"every pressure but {root}"
    at_root, far, farther, flow, ratio = (
        Series("rest", quantity, place, "mean", None, 1.0, scale=scale)
        for quantity, place, scale in (
            ("pressure", root, 100.0),
            ("pressure", "lad:BC_lad", 100.0),
            ("pressure", "lcx:BC_lcx", 100.0),
            ("flow", root, 3.0),
            ("ratio", "lad:BC_lad", 1.0),
        )
    )
    series = [at_root, far, farther, flow]
    assert one.places(anatomy, series) == ["every pressure", but_root]
    predicted = [np.array([[value]]) for value in (100.0, 90.0, 70.0, 3.0)]
    read = {p: np.ravel(one.observe(p, size, series, predicted)) for p in one.places(anatomy, series)}
    assert read[but_root] == pytest.approx([100.0, 100.0, 80.0, 3.0])
    assert read["every pressure"] == pytest.approx([110.0, 100.0, 80.0, 3.0])
    # Neither the offset of a single sensor nor a second name for the same sensors is a place.
    assert one.places(anatomy, [at_root, far]) == ["every pressure"]
    assert one.places(anatomy, [far, farther]) == ["every pressure"]
    assert one.places(anatomy, [far, flow]) == []
    # A ratio of two pressures with the same offset hardly changes, which distinguishes the two places.
    assert one.places(anatomy, [far, farther, ratio]) == ["every pressure", but_root]
    both = [np.ravel(one.observe(p, size, [far, ratio], [np.array([[80.0]]), np.array([[0.8]])])) for p in read]
    assert both[0] == pytest.approx([90.0, 90.0 / 110.0], abs=0.01) and both[1] == pytest.approx([90.0, 0.90])


@pytest.mark.parametrize("name", HEART)
def test_a_vanishing_effect_of_the_heart_leaves_its_parameters_unchanged(name):
    network = closed_loop()
    anatomy, one = Anatomy(network, 1.2e5, {"aorta": 90.0}, 1.0169), effect(name)
    (place,) = one.places(anatomy)
    found = one.changes(network, place, {one.parameters[0].name: np.array([1e-9])}, anatomy, situation(anatomy))
    own = network["closed_loop_blocks"][0]["parameters"]
    assert found == {key: pytest.approx(own.get(key.removeprefix("CLH."), 0.0), rel=1e-6, abs=1e-9) for key in found}
    assert one.places(Anatomy(left_coronary())) == []


@pytest.mark.parametrize(
    ("name", "upstream", "downstream", "valve"),
    [("mitral_stenosis", "P_LA", "P_LV", "Q_LA"), ("pulmonary_stenosis", "P_RV", "P_pul", "Q_RV")],
)
def test_a_stenosed_valve_loses_the_stated_pressure_at_the_cardiac_output(name, upstream, downstream, valve):
    """At the peak of the flow through the valve, inertia takes no pressure, and the drop is that of the resistance."""
    network, size = closed_loop(), 0.1
    anatomy, one = Anatomy(network, 1.2e5, {"aorta": 90.0}, 1.0169), effect(name)
    changes = one.changes(network, one.places(anatomy)[0], {"loss": np.array([size])}, anatomy, situation(anatomy))
    added = size * anatomy.pressure / anatomy.flow["aorta"]
    assert one.physical("", {"loss": size}, anatomy) == {f"{one.element} added": pytest.approx(added)}
    names = [f"{unknown}:CLH" for unknown in (upstream, downstream, valve)]
    found = Engine(network).run_to_periodic(changes, waveforms=names, steps_per_cycle=800)
    above, below, flow = (found.waveforms[key][0] for key in names)
    peak = int(np.argmax(flow))
    resistance = network["closed_loop_blocks"][0]["parameters"][one.element] + added
    assert found.ok.all() and above[peak] - below[peak] == pytest.approx(resistance * flow[peak], rel=0.01)


def test_a_weak_right_ventricle_is_larger_and_pumps_less():
    network = closed_loop()
    anatomy, one = Anatomy(network, 1.2e5, {"aorta": 90.0}, 1.0169), effect("right_heart_weakness")
    weakness = np.array([0.0, 5.0])
    changes = one.changes(network, "right ventricle", {"weakness": weakness}, anatomy, situation(anatomy))
    own = network["closed_loop_blocks"][0]["parameters"]["Erv_s"]
    assert changes["CLH.Erv_s"] == pytest.approx([own, own / 6.0])
    names = ["flow:CLH:J_heart_outlet", "V_RV:CLH", "P_RV:CLH", "V_RA:CLH"]
    output, ventricle, pressure, atrium = Engine(network).run_to_periodic(changes, waveforms=names).waveforms.values()
    assert output[1].mean() < 0.9 * output[0].mean() and ventricle[1].max() > 1.5 * ventricle[0].max()
    assert pressure[1].max() < 0.9 * pressure[0].max() and atrium[1].mean() < 0.9 * atrium[0].mean()


@pytest.mark.parametrize("exponent", [1.25, 1.5, 1.75])
def test_viscous_and_expansion_loss_approximate_any_exponent_between_them(exponent):
    """No effect has a free exponent; minimax by a linear programme over flows from a quarter to four times the mean."""
    flow = np.linspace(0.25, 4.0, 200)
    loss = flow**exponent / 4.0**exponent
    both = np.column_stack([flow, flow**2, np.zeros(200)])
    margin = np.array([0.0, 0.0, 1.0])
    bounds = np.vstack([both - margin, -both - margin]), np.concatenate([loss, -loss])
    assert linprog(margin, *bounds, bounds=[(0.0, None)] * 3).fun < 0.0125


def test_autoregulation_raises_resistance_with_pressure_only(tree):
    """Its gain is positive whatever the size, so that it cannot be named with the wrong sign."""
    network, anatomy = tree
    one = effect("autoregulation")
    (gain,) = one.parameters
    sizes = gain.from_standard(np.linspace(-4.0, 4.0, 9))
    assert (sizes > 0.0).all()
    # The bed has 9/11 of the reference pressure.
    found = one.changes(network, "BC_lad", {"gain": sizes}, anatomy, situation(anatomy))
    own = anatomy.blocks["BC_lad"]["bc_values"]["Ra1"]
    assert found["BC_lad.Ra1"] == pytest.approx(own * (9.0 / 11.0) ** sizes)


def test_a_complete_exchange_swaps_the_values_of_two_beds(tree):
    """Flow into every bed is that of the network with the values of the two beds swapped."""
    network, anatomy = tree
    found = flows(network, anatomy, effect("exchanged_outlets"), "BC_lad~BC_lcx", {"share": np.array([1.0])})
    swapped = copy.deepcopy(network)
    one, other = (next(b for b in swapped["boundary_conditions"] if b["bc_name"] == n) for n in ("BC_lad", "BC_lcx"))
    one["bc_values"], other["bc_values"] = other["bc_values"], one["bc_values"]
    assert found == pytest.approx(flows(swapped, anatomy), rel=1e-6)
    assert abs(found / flows(network, anatomy) - 1.0).max() > 0.1


@pytest.mark.parametrize("pulsation", [-0.3, 0.2])
def test_the_drive_s_pulsation_changes_about_its_mean(tree, pulsation):
    network, anatomy = tree
    one = effect("drive_pulsatility")
    (place,) = one.places(anatomy)
    ((name, waves),) = one.changes(network, place, {"pulsation": np.array([pulsation, 0.0])}, anatomy, None).items()
    own = sampled(network, name)
    assert waves[1] == pytest.approx(own) and np.ptp(own) > 0.0
    assert waves[0, :-1].mean() == pytest.approx(own[:-1].mean())
    assert np.ptp(waves[0]) == pytest.approx((1.0 + pulsation) * np.ptp(own)) and waves[0, 0] == waves[0, -1]


def test_a_gain_of_the_drive_scales_the_driving_waveform(tree):
    """Flow into every bed is that of the network with the scaled waveform; the inlet is the only place."""
    network, anatomy = tree
    one = effect("drive_gain")
    assert one.places(anatomy) == ["AORTA"]
    driven = copy.deepcopy(network)
    aorta = next(b for b in driven["boundary_conditions"] if b["bc_name"] == "AORTA")["bc_values"]
    aorta["P"] = [0.9 * pressure for pressure in aorta["P"]]
    found = flows(network, anatomy, one, "AORTA", {"gain": np.array([-0.1])})
    assert found == pytest.approx(flows(driven, anatomy), rel=1e-4)
    assert (found < 0.95 * flows(network, anatomy)).all()


def test_intramyocardial_pressure_is_described_as_a_factor_in_a_closed_loop(tree):
    network, anatomy = tree
    one = effect("intramyocardial_pressure")
    assert one.describe(one.parameters[0], 0.4, anatomy) == (one.parameters[0].meaning, 0.4)
    assert one.assumption(anatomy, [{"LV": None}, {"LV": None}]) == ""
    assert "its shape is assumed to be the model's intramyocardial pressure" in one.assumption(
        anatomy, [{"LV": None}, {}]
    )
    loop = Anatomy(Network({"vessels": [], "closed_loop_blocks": [{}]}))
    assert (
        one.describe(one.parameters[0], 0.4, loop)[1] == pytest.approx(np.exp(0.4)) and one.assumption(loop, [{}]) == ""
    )
