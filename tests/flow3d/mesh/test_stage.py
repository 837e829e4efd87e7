"""Meshes of known bodies: geometry, quality, faces, regions, determinism; and the 0D network that they leave."""

import numpy as np
import pytest

from coronaryuq.case.anatomy.ffr_place import with_ffr_places
from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel, write_tree
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.flow3d.mesh.coupling.cap_connections import connect_caps
from coronaryuq.flow3d.mesh.coupling.network_without_mesh import remaining_network
from coronaryuq.flow3d.mesh.description import Face, MeshDescription, Remainder, read_description
from coronaryuq.flow3d.mesh.generation import folder, quality
from coronaryuq.flow3d.mesh.generation.build import cuthill_mckee, kept_vessels
from coronaryuq.flow3d.mesh.geometry import paths
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.mesh.stage import make_mesh, mesh_tree
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.read import check_network
from coronaryuq.zerod.solver.engine import Engine
from support.case_files import write_case_json
from support.random_trees import network_of, random_tree, tube


def test_a_stenosed_tube_has_its_exact_volume_and_caps(stenosed):
    _, content, tree, _, _ = stenosed
    vessel = tree["LAD"]
    exact = np.pi * np.trapezoid(vessel.radii**2, vessel.arc)
    # Flat facets between nodes on the wall would take 3 % at this size.
    assert content.volume == pytest.approx(exact, rel=0.005)
    caps = [face for face in content.faces if face.kind == "cap"]
    assert [cap.name for cap in caps] == ["inlet_LAD", "outlet_LAD"]
    for cap, x, sense in zip(caps, (0.0, 2.4), (-1.0, 1.0), strict=True):
        assert cap.centroid == pytest.approx([x, 0.0, 0.0], abs=0.01)
        assert cap.normal == pytest.approx([sense, 0.0, 0.0], abs=1e-6)
        assert cap.radius == pytest.approx(0.15, rel=0.04)


def test_the_throat_has_the_requested_resolution(stenosed):
    _, content, *_ = stenosed
    assert content.quality["throat_resolution"]["LAD"] == pytest.approx(3.0, rel=0.15)


def test_elements_at_the_throat_are_twice_as_long_as_wide(stenosed):
    out, *_ = stenosed
    mesh = folder.read(out / "mesh-complete")

    def length_over_width(between):
        x = mesh.points[mesh.tets].mean(axis=1)[:, 0]
        cells = mesh.tets[(x > between[0]) & (x < between[1])]
        ends = mesh.points[np.unique(np.sort(cells[:, quality.EDGES].reshape(-1, 2)), axis=0)]
        edge = np.abs(ends[:, 1] - ends[:, 0])
        return edge[:, 0].mean() / np.hypot(edge[:, 1], edge[:, 2]).mean() / (2.0 / np.pi)  # 1 for all directions alike

    assert length_over_width((1.0, 1.4)) == pytest.approx(2.0, rel=0.2)
    assert length_over_width((0.1, 0.5)) == pytest.approx(1.0, rel=0.2)


def test_the_reported_quality_is_that_of_the_elements(stenosed):
    out, content, *_ = stenosed
    mesh = folder.read(out / "mesh-complete")
    ratio = quality.radius_ratio(mesh.points, mesh.tets)
    assert content.quality["radius_ratio_min"] == pytest.approx(ratio.min())
    assert ratio.min() >= 0.05
    assert content.quality["dihedral_min"] > 5.0
    assert content.nodes == len(mesh.points)
    assert content.volume == pytest.approx(quality.volumes(mesh.points, mesh.tets).sum())


def test_wall_nodes_stand_off_the_true_surface_by_the_sagitta_of_its_facets(stenosed):
    out, _, tree, *_ = stenosed
    mesh = folder.read(out / "mesh-complete")
    triangles = mesh.triangles[mesh.wall_triangles()]
    wall = mesh.points[np.unique(triangles)]
    off = np.hypot(wall[:, 1], wall[:, 2]) - tree["LAD"].radius_at(wall[:, 0])
    longest = np.linalg.norm(mesh.points[triangles] - np.roll(mesh.points[triangles], 1, axis=1), axis=2).max()
    assert (off > -1e-4).all()
    assert off.max() < longest**2 / 8 / tree["LAD"].radii.min()
    rim = (wall[:, 0] < 1e-9) | (wall[:, 0] > 2.4 - 1e-9)
    assert np.abs(off[rim]).max() < 1e-4


def test_elements_at_the_wall_of_a_throat_are_thin(stenosed):
    out, _, tree, *_ = stenosed
    mesh = folder.read(out / "mesh-complete")
    off = np.hypot(mesh.points[:, 1], mesh.points[:, 2])
    depth = 1.0 - off / tree["LAD"].radius_at(mesh.points[:, 0])
    inner = np.setdiff1d(np.arange(len(mesh.points)), mesh.triangles)
    throat, away = (inner[np.abs(mesh.points[inner, 0] - x) < 0.1] for x in (1.2, 0.3))
    # A third of the radius would be the first node's depth without grading; (1/3)^1.5 is 0.19.
    assert np.quantile(depth[throat], 0.1) < 0.2
    assert np.quantile(depth[away], 0.1) > 0.25


def test_region_is_the_wall_around_the_throat(stenosed):
    out, content, tree, *_ = stenosed
    mesh = folder.read(out / "mesh-complete")
    region = content.regions["LAD"]
    centres = mesh.points[mesh.triangles[mesh.region == region.id]].mean(axis=1)
    assert region.throat == pytest.approx(1.2, abs=0.02)
    assert centres[:, 0].min() == pytest.approx(1.2 + region.start, abs=0.05)
    assert centres[:, 0].max() == pytest.approx(1.2 + region.end, abs=0.05)
    vector = quality.areas(mesh.points, mesh.triangles[mesh.region == region.id])
    assert region.area == pytest.approx(np.linalg.norm(vector, axis=1).sum())
    length = region.end - region.start
    assert region.area < 2.0 * np.pi * 0.15 * length * 1.1


def test_plane_lies_on_the_axis_distal_to_the_stenosis(stenosed):
    _, content, _, stenoses, _ = stenosed
    plane = content.planes["LAD"]
    assert plane.point[1:] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert plane.normal == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    assert plane.point[0] > stenoses[0].end


def test_the_plane_before_a_stenosis_lies_where_it_begins(stenosed):
    _, content, _, stenoses, _ = stenosed
    plane = content.proximal_planes["LAD"]
    assert plane.point == pytest.approx([stenoses[0].start, 0.0, 0.0], abs=1e-3)
    assert plane.arc == pytest.approx(plane.point[0], abs=0.05)
    start = stenoses[0].start - content.regions["LAD"].throat
    assert plane.distance_from_throat == pytest.approx(start, abs=1e-3)


@pytest.mark.slow
def test_equal_input_gives_equal_bytes(stenosed, coarse, tmp_path):
    out, _, tree, stenoses, network = stenosed
    mesh_tree(tree, stenoses, network, coarse, tmp_path)
    for name in ("mesh-complete.zip", "mesh.json"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes()


def test_reverse_cuthill_mckee_narrows_the_band(stenosed):
    out, *_ = stenosed
    mesh = folder.read(out / "mesh-complete")
    order = cuthill_mckee(mesh.tets, len(mesh.points))
    assert sorted(order) == list(range(len(mesh.points)))
    assert np.ptp(mesh.tets, axis=1).max() < len(mesh.points) / 4


@pytest.mark.slow
def test_several_pieces_are_one_mesh_and_couple_to_a_closed_loop(tmp_path):
    tree, stenoses = next(
        (tree, found) for tree, found in map(random_tree, range(100)) if len(found) == 2 and len(tree) < 12
    )
    network = network_of(tree, stenoses)
    settings = Settings(
        throat_resolution=2.5,
        resolution=1.6,
        jet_resolution=2.5,
        core_resolution=1.0,
        wall_grading=0.0,
        upstream_diameters=1.0,
        downstream_diameters=1.5,
        stub_diameters=1.0,
    )
    content = mesh_tree(tree, stenoses, network, settings, tmp_path)
    mesh = folder.read(tmp_path / "mesh-complete")
    caps = [face for face in content.faces if face.kind == "cap"]
    assert len(mesh.caps) == len(caps) >= 2 * len(content.pieces)
    assert set(content.regions) == {"LAD", "LCx"} == set(content.planes)
    for name in content.replaces:
        assert name not in content.cut
    assert any(name.endswith("_seg1") for name in content.replaces)
    left = remaining_network(network, content)
    check_network(left)
    model = Model(left)
    assert len(model.variables) == len(model.equations)
    assert [b["name"] for b in left["external_solver_coupling_blocks"]] == [cap.name for cap in caps]


@pytest.fixture(scope="module")
def segment():
    """A stenosed tube of 4 cm, cut 0.9 cm before and after the stenosis: network, what the cut says, kept interval."""
    tree, stenoses = tube(length=4.0, radius=0.15, severity=0.5)
    network = network_of(tree, stenoses)
    kept = kept_vessels(tree, stenoses, Settings(upstream_diameters=3.0, downstream_diameters=3.0))
    caps = paths.caps(tree, kept, ["LAD"])
    connections = connect_caps(tree, kept, vessels_along(tree, stenoses, network), network, caps)
    faces = [Face(name=cap.name, kind="cap", couples=connections.caps[cap.name]) for cap in caps]
    replaced = {"replaces": connections.replaces, "cut": connections.cut}
    return network, MeshDescription(faces=faces, regions={}, planes={}, **replaced), kept["LAD"]


def test_a_cut_vessel_is_shared_in_proportion_to_length(segment):
    network, content, (start, end) = segment
    values = {v["vessel_name"]: v["zero_d_element_values"] for v in network["vessels"]}
    assert content.replaces == ["LAD_seg1"]
    for name, side, outside in (("LAD_seg0", "upstream", start), ("LAD", "downstream", 4.0 - end)):
        share = getattr(content.cut[name], side)
        expected = 8.0 * 0.04 * outside / (np.pi * 0.15**4)
        assert share["R_poiseuille"] * values[name]["R_poiseuille"] == pytest.approx(expected, rel=1e-3)
        assert share["stenosis_coefficient"] == 0.0


def test_the_replaced_part_between_the_caps_restores_the_full_network(segment):
    network, content, _ = segment
    left = remaining_network(network, content)
    before, after = (block["connected_block"] for block in left.pop("external_solver_coupling_blocks"))
    ids = {v["vessel_name"]: v["vessel_id"] for v in left["vessels"]}
    left["vessels"].append(_inside(network, content) | {"vessel_id": 99})
    for name, a, b in (("joint0", ids[before], 99), ("joint1", 99, ids[after])):
        left["junctions"].append(
            {"junction_name": name, "junction_type": "NORMAL_JUNCTION", "inlet_vessels": [a], "outlet_vessels": [b]}
        )
    name = "mean_flow:LAD:BC_LAD"
    one = Engine(network).run_cycles(quantities=[name], cycles=8)
    two = Engine(left).run_cycles(quantities=[name], cycles=8)
    assert two.values[name][0] == pytest.approx(one.values[name][0], rel=1e-6)


def _inside(network, mesh) -> dict:
    """One vessel with everything that 3D takes over."""
    total = dict.fromkeys(("R_poiseuille", "L", "C", "stenosis_coefficient"), 0.0)
    for vessel in network["vessels"]:
        values, name = vessel["zero_d_element_values"], vessel["vessel_name"]
        for key in total:
            cut = mesh.cut.get(name, Remainder())
            outside = sum(part[key] for part in (cut.upstream, cut.downstream) if part is not None)
            if name in mesh.replaces or name in mesh.cut:
                total[key] += (1.0 - outside) * values[key]
    return {"vessel_name": "inside", "zero_d_element_type": "BloodVessel", "zero_d_element_values": total}


def test_a_network_with_other_names_is_rejected(stenosed):
    _, _, tree, stenoses, network = stenosed
    other = network.deep_copy()
    for vessel in other["vessels"]:
        vessel["vessel_name"] += "_x"
    with pytest.raises(InputError, match="same names"):
        vessels_along(tree, stenoses, other)


@pytest.mark.parametrize("domain", ["segments", "trees"])
def test_a_case_without_stenosis_is_rejected_before_anything_runs(stenosed, tmp_path, domain):
    write_case_json(tmp_path / "case.json")
    write_tree(tmp_path / "t.vtp", stenosed[2])
    settings = Settings(domain=domain)
    with pytest.raises(
        InputError,
        match=r"no stenosis or segment selected, so no 3D model.*stenoses: \[\{name: LAD, vessel: LAD, start: ",
    ):
        make_mesh(tmp_path / "case.json", tmp_path / "t.vtp", tmp_path / "n.json", settings, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_anatomy_that_cannot_be_meshed_is_reported_on_one_line(stenosed, coarse, tmp_path):
    _, _, tree, stenoses, network = stenosed
    write_tree(tmp_path / "tree.vtp", tree)
    write_json(tmp_path / "network.json", network)
    entries = [{"name": s.name, "vessel": s.vessel, "start": s.start, "end": s.end} for s in stenoses]
    write_case_json(tmp_path / "case.json", stenoses=entries)
    given = (tmp_path / f"{name}" for name in ("case.json", "tree.vtp", "network.json"))
    short = coarse.model_copy(update={"time_limit": 0.01, "attempts": 1})
    with pytest.raises(
        InputError, match=r"tree.vtp: piece LAD could not be meshed: attempt 1: .*; inspect the geometry"
    ):
        make_mesh(*given, short, tmp_path / "out")


def test_mesh_json_holds_the_returned_description(stenosed):
    out, content, *_ = stenosed
    assert read_description(out / "mesh.json") == content
    assert read_json(out / "mesh.json") == content.content()


@pytest.mark.slow
def test_the_plane_of_ffr_lies_at_the_place_of_the_case(tmp_path, coarse):
    """However many diameters beyond the mesh settings ask for; FFR of 0D is read at the same arc length."""
    tree, (stenosis,) = tube(length=4.0, severity=0.4)
    placed = with_ffr_places(tree, [Stenosis("LAD", "LAD", 1.0, stenosis.end)], 0.9)
    content = mesh_tree(tree, placed, network_of(tree, placed), coarse, tmp_path)
    plane = content.planes["LAD"]
    assert plane.point[0] == pytest.approx(stenosis.end + 0.9, abs=1e-6)
    assert plane.distance_from_throat == pytest.approx(stenosis.end + 0.9 - content.regions["LAD"].throat, abs=1e-6)


@pytest.mark.long
def test_regions_of_serial_stenoses_do_not_overlap(tmp_path, coarse):
    """The plane of the first one lies before the second one, however many diameters beyond are asked for."""
    x = np.linspace(0.0, 3.4, 171)
    first, second = Stenosis("LAD", "LAD", 0.8, 1.4), Stenosis("LAD2", "LAD", 1.8, 2.4)
    radii = np.full(len(x), 0.15)
    for one in (first, second):
        inside = (x > one.start) & (x < one.end)
        share = (x[inside] - one.start) / (one.end - one.start)
        radii[inside] *= 1 - 0.2 * (1 - np.cos(2 * np.pi * share))
    tree = Tree([Vessel("LAD", np.column_stack([x, 0 * x, 0 * x]), radii, None, "LAD")])
    stenoses = [first, second]
    content = mesh_tree(tree, stenoses, network_of(tree, stenoses), coarse, tmp_path)
    ends = [(r.throat + r.start, r.throat + r.end) for r in (content.regions["LAD"], content.regions["LAD2"])]
    assert ends[0][1] == pytest.approx(1.6) and ends[0][1] <= ends[1][0] < second.start
    assert all(region.triangles > 100 for region in content.regions.values())
    assert 1.4 <= content.planes["LAD"].point[0] <= 1.8 < 2.4 <= content.planes["LAD2"].point[0]
    before = content.proximal_planes
    assert before["LAD"].point[0] == pytest.approx(0.8, abs=1e-3)
    assert before["LAD2"].point[0] == pytest.approx(1.8, abs=1e-3)
