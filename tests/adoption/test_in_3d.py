"""Adopted effects in 3D runs: on the 0D side, in the lumen, or refused; and what the page's lists are made of."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.adoption.in_3d import INSIDE, for_3d, places_along
from coronaryuq.adoption.network import with_effects
from coronaryuq.adoption.stage import in_3d
from coronaryuq.case.anatomy.tree import write_tree
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network.build import Physics
from coronaryuq.case.network.network import NARROWED
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.flow3d.mesh.coupling.cut_network import cut_network
from coronaryuq.flow3d.narrowed_lumen import narrowed_lumen
from coronaryuq.flow3d.narrowed_network import Place
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.read import read_network, write_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import Theta
from support.adopted_effects import KINDS, SCALES, adopted, placed
from support.case_files import write_case_json
from support.ostium import MIDDLE, artery, entered, mesh_of
from support.small_loop import loop, mesh_of_part

MESH = mesh_of_part({"R_poiseuille": 0.3, "L": 0.3, "C": 0.3})
PLACES = {
    "lca1": Place("lca1", 0.0, 1.0, (0.0, 0.7), (0.0, 0.7)),
    "lca2": Place("lca2", 0.0, 1.0, (0.0, 1.0), (0.05, 0.95)),
}
LESION = {
    "name": "LAD", "vessel": "lca1", "segment": "lca1_seg1", "start": 2.5, "end": 3.5, "ffr": "lca1_seg1:J2",
    "flow": "J1:lca1_seg1", "root": "J0:lca1_seg0", "outlet": "BC_lca1",
}  # fmt: skip


def label(name):
    return f"{name.replace('_', ' ')} at {KINDS[name][0]}"


@pytest.mark.parametrize(
    ("name", "kept"), [("side_branch_leak", True), ("aortic_stenosis", True), ("haematocrit", False)]
)
def test_the_0d_side_gets_what_lies_outside_the_mesh(name, kept):
    """A leak behind the outlet and the heart; not the viscosity of the blood inside."""
    tuned = adopted([placed(name, 0.7), placed("pressure_offset", 0.3, True)])
    tuned.bed_values("BC_lca1")["Ra"] *= 1.1
    found = for_3d(tuned, loop(), MESH, PLACES, Physics())
    network = found.network
    assert found.refused == ({} if kept else {label(name): INSIDE}) and found.lumen == {} and NARROWED not in network
    assert Theta(network).columns == Theta(tuned).columns, "the same samples run in 0D and 3D"
    Model(cut_network(network, MESH).network)
    assert network.bed_values("BC_lca1")["Ra"] == tuned.bed_values("BC_lca1")["Ra"]
    own, plain = Engine(network).parameters, Engine(loop()).parameters
    still = [target for target in Theta(tuned).mixtures.absent if target in plain and own[target] == plain[target]]
    assert bool(still) != kept or name == "side_branch_leak"
    theta = {column: [0.4] for column in Theta(network).laws.names}
    assert bool(set(Theta(network).mixtures.absent) & set(Theta(network).changes(theta))) == kept


@pytest.mark.parametrize("name", ["diffuse_narrowing", "quadratic_stenosis", "stenosis_with_viscous_loss"])
def test_a_narrowing_in_the_mesh_is_in_the_lumen_and_the_network_is_without_it(name):
    """Of a vessel that the mesh replaces and of one that it cuts; both store blood, so that 0D added vessels ahead."""
    tuned = adopted([placed(name, 0.7), placed("pressure_offset", 0.3, True)])
    found = for_3d(tuned, loop(), MESH, PLACES, Physics())
    assert list(found.lumen) == [label(name)] and found.refused == {}
    assert found.network["vessels"] == loop()["vessels"]
    assert Theta(found.network).columns == Theta(tuned).columns
    (row,) = found.network[NARROWED]["members"]
    assert (row["parameter"], row["member"], row["vessel"]) == ("missing_1", 0, KINDS[name][0])
    theta = {column: np.full(1, 0.4) for column in Theta(found.network).laws.names}
    Engine(cut_network(found.network, MESH).network)
    assert not [target for target in Theta(found.network).changes(theta) if target.startswith("lca")]


@pytest.mark.parametrize("name", ["diffuse_narrowing", "quadratic_stenosis"])
def test_a_narrowing_of_a_vessel_that_is_not_along_the_centrelines_is_refused(name):
    found = for_3d(adopted([placed(name)]), loop(), MESH, {}, Physics())
    assert found.refused == {label(name): INSIDE}
    assert found.lumen == {} and NARROWED not in found.network


def test_a_loss_at_the_start_of_a_vessel_that_the_mesh_cuts_is_refused():
    """What stays of its coefficient in 0D is the entrance's alone."""
    tuned = adopted([replace(placed("quadratic_stenosis"), effect="ostial_loss")])
    found = for_3d(tuned, loop(), MESH, PLACES, Physics())
    assert found.refused == {"ostial loss at lca1": INSIDE} and found.lumen == {}


def test_a_campaign_without_effects_runs_its_own_loop_in_3d():
    tuned = loop()
    tuned.bed_values("BC_lca1")["Ra"] *= 1.1
    found = for_3d(tuned, loop(), MESH, PLACES, Physics())
    assert found.refused == {} and found.network["vessels"] == tuned["vessels"]
    assert found.network["boundary_conditions"] == tuned["boundary_conditions"]


def test_vessels_lie_where_the_case_stage_put_them_and_the_lesion_in_its_own(tmp_path):
    tree = artery(MIDDLE)
    network = entered(tree, MIDDLE)
    write_case_json(tmp_path / "case.json", stenoses=[LESION])
    mesh, _ = mesh_of(tree, network, "segments")
    ((first, last),) = (piece["lca1"] for piece in mesh.pieces)
    found = places_along(tree, read_case(tmp_path / "case.json").stenoses, network, mesh)
    assert found["lca1_seg1"] == Place("lca1", 2.5, 3.5, (2.5, 3.5), (2.5, 3.5), lesion=True)
    before, behind = found["lca1_seg0"], found["lca1"]
    assert before.end == 2.5 and before.meshed == (first, 2.5) and not before.lesion
    assert behind.start == 3.5 and behind.meshed == (3.5, last)
    for place in (before, behind):
        assert not place.has(0.5 * sum(place.stenosis)), "two or three diameters beside the lesion are no room"


@pytest.mark.parametrize("domain", ["trees", "segments"])
def test_the_files_of_the_stage_give_a_lumen_with_the_narrowing(domain, tmp_path):
    tree = artery(MIDDLE)
    network = entered(tree, MIDDLE)
    mesh, _ = mesh_of(tree, network, domain)
    scales = SCALES | {"flow": dict.fromkeys(network.vessel_names.values(), 2.0)}
    one = replace(placed("quadratic_stenosis"), place="lca1_seg1")
    tuned = with_effects(network, network, [[one]], scales).network
    case = tmp_path / "case.json"
    write_case_json(case, outlets=[{"name": "lca1", "bc": "BC_lca1", "vessel": "lca1"}], stenoses=[LESION])
    files = {name: tmp_path / f"{name}.json" for name in ("tuned", "case_network", "mesh", "out", "lists")}
    write_network(files["tuned"], tuned)
    write_network(files["case_network"], network)
    write_json(files["mesh"], mesh.content())
    write_tree(tmp_path / "tree.vtp", tree)
    in_3d(
        files["tuned"], files["case_network"], files["mesh"], case, tmp_path / "tree.vtp", 1.0, files["out"],
        files["lists"],
    )  # fmt: skip
    lists = read_json(files["lists"])
    assert lists["refused"] == {}
    assert "declared lesion of lca1_seg1" in lists["lumen"]["quadratic stenosis at lca1_seg1"]
    lumen = narrowed_lumen(read_network(files["out"]), tree)
    assert lumen.physics.stenosis_loss == 1.0 and lumen.physics.density == read_case(case).density
    ratio = lumen.ratio("lca1", np.linspace(0.0, 5.0, 501), {})[0]
    inside = np.linspace(0.0, 5.0, 501)[ratio < 1.0]
    assert inside.min() > 2.5 and inside.max() < 3.5 and ratio.min() < 0.95
