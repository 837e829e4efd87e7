"""Where FFR is read: within the asked distance, at the last place possible where that is less; 0D as 3D."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.case.anatomy.ffr_place import ffr_notes, with_ffr_places
from coronaryuq.case.anatomy.tree import Stenosis
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network.build import segments
from coronaryuq.case.settings import Settings
from coronaryuq.case.stage import prepare_case
from coronaryuq.flow3d.mesh.geometry import extent
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from support.case_files import check_case, small_tree, straight, write_case

LESIONS = "[{name: LAD, vessel: lca1, start: 0.5, end: 1.0}]"


def even_tree():
    """The small tree with an LAD of constant radius, 4 cm long."""
    return small_tree().with_vessels(
        {"lca1": straight("lca1", (3.2, 0, 2), (1, 0, -1), 4.0, (0.15,) * 2, "branch1", "LAD")}
    )


@given(
    vessel=st.sampled_from(["branch1", "lca1", "lca2", "rca1"]),
    place=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
    beyond=st.floats(0.0, 5.0),
)
def test_the_place_lies_within_the_asked_distance(vessel, place, beyond):
    tree = small_tree()
    first, length = tree.emergence(vessel), tree[vessel].length
    one, two, three, four = (first + share * (length - first) for share in sorted(place))
    lesions = [Stenosis("one", vessel, one, two), Stenosis("two", vessel, three, four)]
    for stenosis in with_ffr_places(tree, lesions, beyond):
        read = stenosis.read
        assert stenosis.end <= read.arc <= min(length, stenosis.end + beyond)
        assert (read.stop is None) == (read.arc == stenosis.end + beyond)
        if stenosis.name == "one" and three > one:
            assert read.arc <= max(two, three)
    assert len(ffr_notes(with_ffr_places(tree, lesions, 50.0))) == 2


def test_a_place_that_is_nearer_by_less_than_half_a_millimetre_is_not_noted():
    lesions = [Stenosis("LAD", "lca1", 1.0, 2.0)]
    last = small_tree()["lca1"].length - 0.12 - 2.0
    assert ffr_notes(with_ffr_places(small_tree(), lesions, last + 0.04)) == ()
    assert len(ffr_notes(with_ffr_places(small_tree(), lesions, last + 0.06))) == 1


@pytest.mark.parametrize(
    ("vessel", "beyond", "stop"),
    [("lca1", 1.5, None), ("lca1", 3.5, "end"), ("branch1", 3.5, "branch"), ("rca1", 3.5, "stenosis")],
)
def test_what_keeps_the_place_nearer_than_asked_is_named(vessel, beyond, stop):
    tree = small_tree()
    lesions = [Stenosis("first", vessel, 1.6, 2.0)] + [Stenosis("second", "rca1", 4.0, 5.0)] * (vessel == "rca1")
    first = with_ffr_places(tree, lesions, beyond)[0]
    assert first.read.stop == stop and first.read.asked == beyond
    last = {None: 3.5, "end": 4.0 - 0.12, "branch": 3.2 - 0.2, "stenosis": 4.0}[stop]
    assert first.read.arc == pytest.approx(last)


@pytest.mark.parametrize("beyond", [3.0, 12.5, 20.0])
def test_0d_reads_the_exact_pressure_of_a_straight_tube_at_the_place(tmp_path, beyond):
    """Behind the lesion, pressure falls in proportion to distance; the network has a node at the place."""
    prepare_case(
        write_case(tmp_path, even_tree(), stenoses=LESIONS, ffr_beyond_mm=str(beyond)), Settings(), tmp_path / "case"
    )
    (stenosis,) = read_case(tmp_path / "case/case.json").stenoses
    network = read_network(tmp_path / "case/network.json")
    engine = Engine(network)
    behind = next(name for name in engine.unknowns if name.startswith(f"pressure:{stenosis.segment}:"))
    names = [f"mean_{behind}", f"mean_pressure:{stenosis.ffr}", "mean_pressure:lca1:BC_lca1"]
    values = engine.run_cycles(quantities=names, cycles=2, steps_per_cycle=200).values
    at_lesion, at_place, at_end = (values[name][0] for name in names)
    exact = at_lesion + (at_end - at_lesion) * beyond / 30.0
    assert at_place == pytest.approx(exact, rel=1e-9) and at_lesion - at_place > 1e-3 * (at_lesion - at_end)


def test_the_mesh_of_a_segment_holds_the_place():
    (stenosis,) = with_ffr_places(even_tree(), [Stenosis("LAD", "lca1", 0.5, 1.0)], 2.0)
    kept = extent.segments(even_tree(), [stenosis], upstream=1.0, downstream=2.0)
    assert kept["lca1"][1] >= 3.0 + 2 * 0.15 - 1e-9
    kept = extent.segments(even_tree(), [replace(stenosis, read=None)], upstream=1.0, downstream=2.0)
    assert kept["lca1"][1] == pytest.approx(1.6)


def test_the_0d_network_is_cut_at_the_place_alone():
    plain = Stenosis("LAD", "lca1", 0.5, 1.0)
    (placed,) = with_ffr_places(even_tree(), [plain], 1.5)
    names = [[part.name for part in segments(even_tree(), [one])] for one in (plain, placed)]
    assert len(names[1]) == len(names[0]) + 1
    lengths = [part.end - part.start for part in segments(even_tree(), [placed]) if part.vessel == "lca1"]
    assert np.sum(lengths) == pytest.approx(4.0)


@pytest.mark.parametrize("wrong", ["-1", "51", "far", ".nan"])
def test_a_wrong_distance_is_one_line(tmp_path, wrong):
    (fault,), _ = check_case(write_case(tmp_path, small_tree(), ffr_beyond_mm=wrong))
    assert "ffr_beyond_mm = " in fault and "\n" not in fault
