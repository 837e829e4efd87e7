"""Which stretches of which vessels are meshed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.case.anatomy.tree import AORTA, Stenosis, Tree, Vessel
from coronaryuq.flow3d.mesh.geometry import extent
from support.random_trees import random_tree, tube


def straight(name: str, start, end, radius: float, parent=None, branch="LAD") -> Vessel:
    share = np.linspace(0.0, 1.0, 101)[:, None]
    points = (1.0 - share) * np.asarray(start, float) + share * np.asarray(end, float)
    return Vessel(name, points, np.full(101, radius), parent, branch)


@pytest.fixture
def fork() -> Tree:
    return Tree(
        [
            straight("trunk", (0, 0, 0), (4, 0, 0), 0.15),
            straight("main", (4, 0, 0), (8, 0.5, 0), 0.13, "trunk"),
            straight("side", (4, 0, 0), (6, -2, 0), 0.09, "trunk"),
        ]
    )


def test_a_segment_far_from_bifurcations_has_the_requested_length(fork):
    kept = extent.segments(fork, [Stenosis("LAD", "trunk", 1.5, 2.0)], upstream=3.0, downstream=4.0)
    assert set(kept) == {"trunk"}
    assert kept["trunk"] == pytest.approx((1.5 - 3.0 * 0.3, 2.0 + 4.0 * 0.3))


def test_a_cut_within_a_bifurcation_is_moved_before_it_if_enough_length_remains(fork):
    kept = extent.segments(fork, [Stenosis("LAD", "trunk", 1.5, 2.0)], downstream=6.0)
    assert set(kept) == {"trunk"}
    assert kept["trunk"][1] == pytest.approx(4.0 - 2.0 * 0.15)


def test_a_bifurcation_near_the_stenosis_is_kept_whole_and_clear_of_its_caps(fork):
    kept = extent.segments(fork, [Stenosis("LAD", "trunk", 3.2, 3.7)], downstream=5.0, stub=2.0)
    assert kept["trunk"][1] == fork["trunk"].length
    assert kept["side"][0] == kept["main"][0] == 0.0
    leaves_trunk = 0.15 / np.sin(np.pi / 4)
    assert kept["side"][1] > leaves_trunk + 2.0 * 2.0 * 0.09 - 0.1
    assert kept["side"][1] < fork["side"].length


def test_a_short_remainder_at_the_end_of_the_tree_is_meshed_too(fork):
    end = fork["main"].length
    kept = extent.segments(fork, [Stenosis("LAD", "main", end - 1.4, end - 0.8)], downstream=2.5)
    assert kept["main"][1] == end


def test_stenoses_with_overlapping_neighbourhoods_form_one_piece(fork):
    apart = [Stenosis("LAD", "trunk", 0.8, 1.2), Stenosis("LCx", "main", 2.0, 2.5)]
    assert len(extent.pieces(fork, extent.segments(fork, apart, 1.0, 2.0))) == 2
    near = [Stenosis("LAD", "trunk", 3.2, 3.6), Stenosis("LCx", "main", 0.8, 1.4)]
    assert len(extent.pieces(fork, extent.segments(fork, near, 1.0, 2.0))) == 1


def test_trees_begin_where_the_coronaries_leave_the_aorta():
    aorta = straight("aorta", (0, 0, 0), (0, 0, 2), 1.2, None, AORTA)
    arch = straight("arch", (0, 0, 2), (0, 0, 6), 1.2, "aorta", AORTA)
    left = straight("left", (0, 0, 2), (5, 0, 2), 0.2, "aorta", "LM")
    tree = Tree([aorta, arch, left])
    kept = extent.trees(tree)
    assert set(kept) == {"left"}
    assert kept["left"][0] == pytest.approx(1.2 + 0.5 * 0.2, abs=0.05)
    assert set(extent.whole(tree)) == {"aorta", "arch", "left"}


def test_a_tube_is_one_piece():
    tree, _ = tube()
    assert extent.pieces(tree, extent.trees(tree)) == [["LAD"]]


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.floats(1.0, 6.0), st.floats(1.5, 8.0))
def test_segments_contain_their_stenoses_and_close_at_every_bifurcation(seed, upstream, downstream):
    tree, stenoses = random_tree(seed, generations=2)
    kept = extent.segments(tree, stenoses, upstream, downstream, stub=1.5)
    for stenosis in stenoses:
        start, end = kept[stenosis.vessel]
        assert start <= stenosis.start < stenosis.end <= end
    for name, (start, end) in kept.items():
        assert 0.0 <= start < end <= tree[name].length + 1e-12
        if end >= tree[name].length:
            for daughter in tree.children(name):
                assert kept[daughter.name][0] == 0.0
    assert sorted(n for piece in extent.pieces(tree, kept) for n in piece) == sorted(kept)
