"""Lowest FFR of arteries, pressure drops, FFR at a wire's places, and pressures between the nodes, of known ones."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

from coronaryuq.case.anatomy.tree import Stenosis, Tree
from coronaryuq.case.case_json import CaseWirePlace
from coronaryuq.case.network.build import Segment, segments
from coronaryuq.core.units import MMHG
from coronaryuq.zerod.predicted import TreePressures, compared, predictions
from support.case_files import small_tree, straight

STATES = 100.0 * MMHG * np.array([0.9, 1.0, 1.1])


@dataclass(frozen=True)
class Lesion:
    """What the predictions take of a stenosis."""

    name: str
    artery: str
    vessel: str
    segment: str
    end: float


@dataclass(frozen=True)
class Case:
    """What the predictions take of a case."""

    stenoses: tuple[Lesion, ...] = ()
    ffr_at: tuple[CaseWirePlace, ...] = ()


def known(tree, stenoses, lost):
    """Pressures that fall by a share of the aorta's, per 0D vessel."""
    parts = segments(tree, stenoses)
    at_end, ends = {}, {}
    for part in parts:
        parent = tree[part.vessel].parent
        start = at_end.get(part.vessel, at_end.get(parent, STATES))
        ends[part.name] = (start, start - lost.get(part.name, 0.0) * STATES)
        at_end[part.vessel] = ends[part.name][1]
    return TreePressures(tree, parts, ends, STATES)


def test_an_artery_without_a_lesion_has_its_lowest_ffr_too():
    pressures = known(small_tree(), [], {"branch1_seg0": 0.01, "lca1": 0.04, "lca2": 0.3, "rca1": 0.05})
    rows = predictions(Case(), pressures)
    assert rows["quantity"].unique().tolist() == ["lowest FFR"]
    lowest = rows.set_index("name")["median"].to_dict()
    assert lowest == pytest.approx({"LM": 0.99, "LAD": 0.95, "LCx": 0.69, "RCA": 0.95})
    assert rows.set_index("name").loc["LCx", ["vessel", "arc"]].tolist() == ["lca2", pytest.approx(3.0)]


def test_the_lowest_ffr_of_an_artery_is_that_of_each_state():
    """Of two ends of equal median, each is the lowest in some states."""
    first, second = np.array([0.6, 0.8, 0.9]), np.array([0.9, 0.8, 0.6])
    parts = [Segment("one", "lca1", 0.0, 4.0), Segment("two", "lca1", 0.0, 3.0)]
    ends = {"one": (STATES, first * STATES), "two": (STATES, second * STATES)}
    rows = predictions(Case(), TreePressures(small_tree(), parts, ends, STATES)).set_index("name")
    assert rows.loc["LAD", ["low", "median", "high"]].tolist() == pytest.approx([0.6, 0.6, 0.78])


def test_every_lesion_has_its_pressure_drop_also_several_of_one_artery_and_of_the_left_main():
    stenoses = [Stenosis("LM", "branch1", 1.6, 2.4), Stenosis("LAD", "lca1", 0.6, 1.4), Stenosis("LAD2", "lca1", 2, 3)]
    tree = small_tree()
    name = {part.stenosis: part.name for part in segments(tree, stenoses) if part.stenosis}
    lost = {name["LM"]: 0.05, name["LAD"]: 0.1, name["LAD2"]: 0.2}
    lesions = tuple(Lesion(s.name, tree[s.vessel].branch, s.vessel, name[s.name], s.end) for s in stenoses)
    rows = predictions(Case(lesions), known(tree, stenoses, lost)).set_index(["quantity", "name"])
    drops = rows.loc["pressure drop"]
    assert drops["median"].to_dict() == pytest.approx({"LM": 5.0, "LAD": 10.0, "LAD2": 20.0})
    assert (drops["unit"] == "mmHg").all() and drops["artery"].tolist() == ["LM", "LAD", "LAD"]
    assert drops.loc["LAD2", ["low", "high"]].tolist() == pytest.approx([18.2, 21.8])
    assert rows.loc[("lowest FFR", "LAD"), "median"] == pytest.approx(0.65)


@pytest.mark.parametrize("arc", [0.0, 0.35, 1.0, 2.5, 4.0])
def test_pressure_between_two_nodes_of_a_straight_tube_is_linear(arc):
    tube = straight("tube", (0, 0, 0), (1, 0, 0), 4.0, (0.15, 0.15))
    pressures = TreePressures(
        Tree([tube]), [Segment("tube", "tube", 0.0, 4.0)], {"tube": (STATES, 0.6 * STATES)}, STATES
    )
    assert pressures.at("tube", arc) / STATES == pytest.approx(1.0 - 0.1 * arc, rel=1e-12)


def test_pressure_within_a_tapered_vessel_falls_as_the_resistance_ahead():
    """With r = 0.2 - 0.025 s, ∫ r⁻⁴ ds is proportional to r⁻³ less its value at the start."""
    tube = straight("tube", (0, 0, 0), (1, 0, 0), 4.0, (0.2, 0.1))
    pressures = TreePressures(
        Tree([tube]), [Segment("tube", "tube", 0.0, 4.0)], {"tube": (STATES, 0.6 * STATES)}, STATES
    )
    share = (0.15**-3 - 0.2**-3) / (0.1**-3 - 0.2**-3)
    assert pressures.at("tube", 2.0) / STATES == pytest.approx(1.0 - 0.4 * share, rel=1e-12)


def place(vessel="lca1", arc=2.0, **values) -> CaseWirePlace:
    return CaseWirePlace(name="wire", artery="LAD", vessel=vessel, arc=arc, distance=4.0, **values)


@given(
    cuts=st.lists(st.floats(0.1, 3.9), min_size=4, max_size=4, unique_by=lambda cut: round(cut, 1)),
    losses=st.lists(st.floats(0.0, 0.15), min_size=8, max_size=8),
)
def test_a_place_at_a_node_has_the_pressure_ratio_of_the_node(cuts, losses):
    one, two, three, four = sorted(cuts)
    tree, lesions = small_tree(), [Stenosis("a", "lca1", one, two), Stenosis("b", "lca1", three, four)]
    parts = segments(tree, lesions)
    pressures = known(tree, lesions, dict(zip((part.name for part in parts), losses, strict=False)))
    places = [place(part.vessel, part.end) for part in parts]
    rows = predictions(Case(ffr_at=tuple(places)), pressures)
    rows = rows[rows["quantity"] == "FFR at a place"]
    at_nodes = [float(np.median(pressures.ends[part.name][1] / STATES)) for part in parts]
    assert rows["median"].tolist() == pytest.approx(at_nodes, abs=1e-12)


@given(arcs=st.lists(st.floats(0.0, 4.0), min_size=2, max_size=2), lost=st.floats(0.0, 0.5))
def test_ffr_does_not_rise_along_a_vessel(arcs, lost):
    pressures = known(small_tree(), [Stenosis("LAD", "lca1", 1.0, 2.0)], {"lca1_seg1": lost})
    near, far = (pressures.at("lca1", arc) for arc in sorted(arcs))
    assert (far <= near + 1e-6).all()


def test_a_measured_value_is_compared_with_the_range():
    ffr = np.linspace(0.7, 0.9, 201)
    told = compared(place(measured=0.9), ffr)
    assert told["difference"] == pytest.approx(-0.1) and told["within"] == "no" and told["sd"] is None
    assert (told["expected_low"], told["expected_high"]) == pytest.approx((0.71, 0.89))
    assert compared(place(measured=0.72), ffr)["within"] == "yes"
    assert compared(place(), ffr) == {}


def test_the_wires_own_error_widens_the_range():
    """Of one state the range is the wire's; of normal states it is that of the sum of variances."""
    told = compared(place(measured=0.84, sd=0.02), np.array([0.8]))
    reach = 1.6448536269514722 * 0.02
    assert (told["expected_low"], told["expected_high"]) == pytest.approx((0.8 - reach, 0.8 + reach), abs=1e-9)
    assert told["within"] == "no" and told["difference"] == pytest.approx(-0.04)
    normal = 0.8 + 0.03 * ndtri((np.arange(20_000) + 0.5) / 20_000)
    told = compared(place(measured=0.855, sd=0.02), normal)
    reach = 1.6448536269514722 * (0.02**2 + 0.03**2) ** 0.5
    assert (told["expected_low"], told["expected_high"]) == pytest.approx((0.8 - reach, 0.8 + reach), abs=1e-5)
    assert told["within"] == "yes" and compared(place(measured=0.855), normal)["within"] == "no"


def test_rows_without_a_measured_value_have_none_to_compare():
    pressures = known(small_tree(), [], {"lca1": 0.04})
    rows = predictions(Case(ffr_at=(place(), place(measured=0.9))), pressures)
    assert rows["measured"].notna().tolist() == [False] * (len(rows) - 1) + [True]
    assert rows["within"].iloc[-1] in ("yes", "no")
