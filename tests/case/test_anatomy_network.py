"""The 0D network of a tree: the published rules, number by number."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.case.anatomy.read import labelled
from coronaryuq.case.anatomy.tree import Stenosis, Tree, area_ratio
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.build import (
    CORONARY_CAPACITANCE,
    HEART,
    Bed,
    Physics,
    elements,
    network_from_tree,
    segments,
    stenosis_coefficient,
)
from coronaryuq.case.network.topology import closed_loop_tree
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import MMHG
from coronaryuq.synthetic.anatomy import narrowed
from coronaryuq.zerod.network.read import check_network
from support.case_files import straight

BEDS = [Bed("BC_lca1", "lca1", False), Bed("BC_lca2", "lca2", False), Bed("BC_rca1", "rca1", True)]


def test_a_straight_vessel_has_poiseuille_resistance_inertance_and_thin_wall_compliance():
    physics = Physics(elastic=True, young=4e6, thickness_ratio=0.1)
    values = elements(straight("v", (0, 0, 0), (0, 0, 1), 5.0, (0.2, 0.2)), physics)
    assert values["R_poiseuille"] == pytest.approx(8 * 0.04 * 5.0 / (np.pi * 0.2**4), rel=1e-12)
    assert values["L"] == pytest.approx(1.06 * 5.0 / (np.pi * 0.2**2), rel=1e-12)
    # dV/dp of a thin tube, ν = 1/2: 3 π r³ l / (2 E h).
    assert values["C"] == pytest.approx(3 * np.pi * 0.2**3 * 5.0 / (2 * 4e6 * 0.02), rel=1e-12)
    assert elements(straight("v", (0, 0, 0), (0, 0, 1), 5.0, (0.2, 0.2)), Physics())["C"] == 0.0


def test_a_cone_has_the_integral_of_its_local_resistance():
    from scipy.integrate import quad

    values = elements(straight("v", (0, 0, 0), (0, 0, 1), 5.0, (0.2, 0.08), points=3), Physics())
    radius = lambda s: 0.2 - 0.024 * s  # noqa: E731 (reads as the formula)
    assert values["R_poiseuille"] == pytest.approx(
        8 * 0.04 / np.pi * quad(lambda s: radius(s) ** -4, 0, 5)[0], rel=1e-9
    )
    assert values["L"] == pytest.approx(1.06 / np.pi * quad(lambda s: radius(s) ** -2, 0, 5)[0], rel=1e-9)


def test_the_stenosis_coefficient_is_that_of_pfaller_2022():
    expected = 1.52 * 1.06 / (2 * (np.pi * 0.15**2) ** 2) * (1 / 0.25 - 1) ** 2
    assert stenosis_coefficient(0.25, 0.15, Physics()) == pytest.approx(expected, rel=1e-12)
    assert stenosis_coefficient(1.0, 0.15, Physics()) == 0.0
    half = stenosis_coefficient(0.25, 0.15, Physics(stenosis_loss=0.76))
    assert half == pytest.approx(expected / 2, rel=1e-12)


def test_vessels_are_cut_at_both_ends_of_a_stenosis_and_nothing_is_lost(small_tree, small_stenoses):
    parts = segments(small_tree, small_stenoses)
    assert [p.name for p in parts if p.vessel == "lca1"] == ["lca1_seg0", "lca1_seg1", "lca1"]
    assert [p.name for p in parts if p.vessel == "branch1"] == ["branch1_seg0"]
    assert [p.stenosis for p in parts if p.vessel == "rca1"] == [None, "RCA", None]
    for vessel in small_tree:
        own = [p for p in parts if p.vessel == vessel.name]
        covered = sum(p.end - p.start for p in own)
        assert covered == pytest.approx(vessel.length - small_tree.emergence(vessel.name), abs=1e-12)
        assert all(a.end == b.start for a, b in zip(own, own[1:], strict=False))


@pytest.mark.parametrize(
    "wrong",
    [
        [Stenosis("LAD", "lca1", 3.5, 4.5)],
        [Stenosis("RCA", "rca1", 0.5, 1.5)],
        [Stenosis("LAD", "lca1", 1.0, 2.0), Stenosis("LCx", "lca1", 1.5, 2.5)],
    ],
)
def test_a_stenosis_off_its_vessel_in_the_aorta_or_over_another_is_refused(small_tree, wrong):
    with pytest.raises(ValueError, match="does not fit"):
        segments(small_tree, wrong)


def test_the_network_is_one_tree_from_the_heart_to_every_bed(small_tree, small_stenoses):
    network = network_from_tree(small_tree, BEDS, {"BC_RCR1": "aorta_outlet"}, small_stenoses)
    graph = closed_loop_tree(network, "network.json")
    assert graph.roots == ["aorta"]
    assert graph.inlet("aorta") == "J_heart_outlet:aorta"
    assert graph.outlet("lca1") == "lca1:BC_lca1"
    assert set(graph.outlets_below("aorta")) == {"BC_lca1", "BC_lca2", "BC_rca1", "BC_RCR1"}
    assert graph.outlets_below("branch1_seg0") == ["BC_lca1", "BC_lca2"] or set(
        graph.outlets_below("branch1_seg0")
    ) == {
        "BC_lca1",
        "BC_lca2",
    }


@pytest.mark.parametrize("vessel", ["aorta", "lca1", "rca1"])
@pytest.mark.parametrize(
    "name", ["J0", "J1", "BC_lca2", "BC_RCR1", "CLH", "J_heart_inlet", "J_heart_outlet", "branch1_seg0"]
)
def test_a_vessel_may_have_the_name_of_a_block_that_the_network_adds(small_tree, small_stenoses, vessel, name):
    """Such cases were refused: `junctions.J0: name already taken by vessels.J0`."""

    def renamed(old):
        return name if old == vessel else old

    tree = Tree([replace(v, name=renamed(v.name), parent=renamed(v.parent)) for v in small_tree])
    stenoses = [replace(s, vessel=renamed(s.vessel)) for s in small_stenoses]
    beds = [replace(bed, vessel=renamed(bed.vessel)) for bed in BEDS]
    network = check_network(network_from_tree(tree, beds, {"BC_RCR1": "aorta_outlet"}, stenoses))
    plain = network_from_tree(small_tree, BEDS, {"BC_RCR1": "aorta_outlet"}, small_stenoses)
    assert [v["zero_d_element_values"] for v in network.vessels] == [v["zero_d_element_values"] for v in plain.vessels]
    assert network.boundary_conditions == plain.boundary_conditions
    for part, usual in zip(vessels_along(tree, stenoses, network), plain.vessel_names.values(), strict=True):
        assert part.name == usual or part.vessel in (name, "branch1"), "names that nothing else has stay"


def test_resistances_share_the_resting_flow_by_murray_and_add_up(small_tree):
    physics = Physics(pressure=90 * MMHG, cardiac_output=80.0, coronary_share=0.05)
    network = network_from_tree(small_tree, BEDS, {"BC_RCR1": "aorta_outlet"}, (), physics)
    values = {b["bc_name"]: b["bc_values"] for b in network["boundary_conditions"]}
    total = {name: sum(v[k] for k in ("Ra", "Ram", "Rv")) for name, v in values.items() if "Ra" in v}
    assert sum(90 * MMHG / r for r in total.values()) == pytest.approx(0.05 * 80.0, rel=1e-12)
    assert total["BC_lca2"] / total["BC_lca1"] == pytest.approx((0.12 / 0.10) ** 2.6, rel=1e-12)
    assert 90 * MMHG / (values["BC_RCR1"]["Rp"] + values["BC_RCR1"]["Rd"]) == pytest.approx(0.95 * 80.0, rel=1e-12)
    for kind in ("Ca", "Cim"):
        left = values["BC_lca1"][kind] + values["BC_lca2"][kind]
        assert left == pytest.approx(CORONARY_CAPACITANCE["ClosedLoopCoronaryLeft"][kind], rel=1e-12)


def test_the_split_vessels_resistance_is_that_of_the_narrow_lumen(small_tree):
    stenosis = Stenosis("RCA", "rca1", 3.0, 4.0)
    tree = small_tree.with_vessels({"rca1": narrowed(small_tree["rca1"], stenosis, 0.5)})
    network = network_from_tree(tree, BEDS, {"BC_RCR1": "aorta_outlet"}, [stenosis])
    values = {v["vessel_name"]: v["zero_d_element_values"] for v in network["vessels"]}
    healthy = network_from_tree(small_tree, BEDS, {"BC_RCR1": "aorta_outlet"}, [stenosis])
    without = {v["vessel_name"]: v["zero_d_element_values"] for v in healthy["vessels"]}
    # Mean of (1 − D (1 + cos)/2)⁻⁴ over a cosine of depth one half: (1 + 3/2 e²) / ... done by quadrature.
    angle = np.linspace(0, 2 * np.pi, 20001)
    factor = np.trapezoid((1 - 0.25 * (1 + np.cos(angle))) ** -4.0, angle) / (2 * np.pi)
    assert values["rca1_seg1"]["R_poiseuille"] / without["rca1_seg1"]["R_poiseuille"] == pytest.approx(factor, rel=0.02)
    expected = stenosis_coefficient(area_ratio(tree, stenosis), float(tree["rca1"].radius_at(3.0)), Physics())
    assert values["rca1_seg1"]["stenosis_coefficient"] == expected > 0
    assert without["rca1_seg1"]["stenosis_coefficient"] == pytest.approx(0.0, abs=1e-9)


def test_a_vessel_that_feeds_several_arteries_is_named_after_the_branches_behind_it(small_tree):
    """Also in a heart with a single coronary artery, whose trunk feeds LAD, LCx and RCA."""

    def branches(tree, **ends):
        return {vessel.name: vessel.branch for vessel in labelled(tree, ends)}

    assert branches(small_tree, lca1="LAD", lca2="LCx", rca1="RCA") == {
        "aorta": "aorta", "branch1": "LM", "lca1": "LAD", "lca2": "LCx", "rca1": "RCA", "aorta_outlet": "aorta",
    }  # fmt: skip
    single = Tree([vessel for vessel in small_tree if vessel.name != "rca1"])
    third = straight("rca1", (3.2, 0, 2), (1, -1, 0), 6.0, (0.18, 0.12), "branch1")
    single = Tree([*single, third])
    named = branches(single, lca1="LAD", lca2="LCx", rca1="RCA")
    assert named["branch1"] == "coronary" and named["aorta"] == "aorta" and named["rca1"] == "RCA"


def test_an_end_without_a_bed_is_reported(small_tree):
    with pytest.raises(ValueError, match="without an outlet: rca1"):
        network_from_tree(small_tree, BEDS[:2], {"BC_RCR1": "aorta_outlet"})


def test_heart_parameters_are_the_published_ones_in_cgs(shared):
    import json

    case = json.loads((shared / "data/svzerod-cases/closedLoopHeart_withCoronaries.json").read_text())
    published = case["closed_loop_blocks"][0]["parameters"]
    assert HEART["Elv_s"] == pytest.approx(published["Elv_s"] * MMHG)
    assert HEART["Cp"] == pytest.approx(published["Cp"] / MMHG)
    assert HEART["Kxv_ra"] == published["Kxv_ra"] and HEART["Vlv_u"] == published["Vlv_u"]
    assert set(HEART) == set(published) - {"_comment_"}


@pytest.mark.parametrize(
    ("leaving", "remedy"),
    [
        (["a"], "nothing feeds it"),
        (["a", "b"], "several arise from one aorta, joined by a junction"),
    ],
)
def test_a_loop_without_junctions_is_told_what_its_vessels_lack(leaving, remedy):
    """As svZeroDSolver reads it, the list of junctions may be left out."""
    network = {
        "boundary_conditions": [{"bc_name": name, "bc_type": "ClosedLoopRCR"} for name in ("A", "B")],
        "vessels": [
            {"vessel_id": k, "vessel_name": name, "boundary_conditions": {"outlet": name.upper()}}
            for k, name in enumerate("ab")
        ],
        "closed_loop_blocks": [{"closed_loop_type": "ClosedLoopHeartAndPulmonary", "outlet_blocks": leaving}],
    }
    with pytest.raises(InputError, match=remedy):
        closed_loop_tree(network, "network.json")
