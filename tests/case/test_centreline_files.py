"""Centrelines of other programs become the tree that they were made from."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import pyvista as pv
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from coronaryuq.case.anatomy.centreline_files import read_centrelines
from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.network.build import Physics, elements
from coronaryuq.core.errors import InputError
from support.case_files import check_case, write_case


def route(tree: Tree, end: str) -> tuple[np.ndarray, np.ndarray]:
    """Points and radii from the root to an end."""
    names = [end]
    while (parent := tree[names[-1]].parent) is not None:
        names.append(parent)
    parts = [tree[name] for name in reversed(names)]
    return (
        np.concatenate([parts[0].points, *(part.points[1:] for part in parts[1:])]),
        np.concatenate([parts[0].radii, *(part.radii[1:] for part in parts[1:])]),
    )


def resistance(tree: Tree, end: np.ndarray) -> float:
    """Poiseuille resistance from the root to the end at a point."""
    name = min((v.name for v in tree.leaves()), key=lambda name: np.linalg.norm(tree[name].points[-1] - end))
    total = 0.0
    while name is not None:
        total += elements(tree[name], Physics())["R_poiseuille"]
        name = tree[name].parent
    return total


def same(found: Tree, made: Tree, tolerance: float) -> bool:
    assert len(found.leaves()) == len(made.leaves())
    for leaf in made.leaves():
        end = leaf.points[-1]
        assert min(np.linalg.norm(v.points[-1] - end) for v in found.leaves()) < 1e-6
        assert resistance(found, end) == pytest.approx(resistance(made, end), rel=tolerance)
    return True


def welded(tree: Tree) -> Tree:
    """The tree with one radius where vessels meet, as a graph has."""
    vessels = []
    for v in tree:
        first = v.radii[:1] if v.parent is None else tree[v.parent].radii[-1:]
        vessels.append(replace(v, radii=np.concatenate([first, v.radii[1:]])))
    return Tree(vessels)


def polydata(lines, name="Radius", **cells) -> pv.PolyData:
    points = np.concatenate([points for points, _ in lines])
    starts = np.cumsum([0, *(len(points) for points, _ in lines)])
    flat = np.concatenate([[len(p), *range(s, s + len(p))] for (p, _), s in zip(lines, starts, strict=False)])
    mesh = pv.PolyData(points, lines=flat)
    mesh.point_data[name] = np.concatenate([radii for _, radii in lines])
    for key, values in cells.items():
        mesh.cell_data[key] = values
    return mesh


def test_lines_from_the_inlet_to_every_end_are_cut_where_they_part(small_tree, tmp_path):
    lines = [route(small_tree, leaf.name) for leaf in small_tree.leaves()]
    polydata(lines, "MaximumInscribedSphereRadius").save(tmp_path / "vmtk.vtp")
    tree, notes = read_centrelines(tmp_path / "vmtk.vtp")
    assert same(tree, small_tree, 0.05)
    assert notes == ("centrelines: took MaximumInscribedSphereRadius as the radius",)


def test_tracts_of_a_line_belong_together(small_tree, tmp_path):
    lines, of_line, number = [], [], []
    for k, leaf in enumerate(small_tree.leaves()):
        points, radii = route(small_tree, leaf.name)
        middle = len(points) // 2
        for tract, part in ((1, slice(middle, None)), (0, slice(0, middle + 1))):
            lines.append((points[part], radii[part]))
            of_line.append(k)
            number.append(tract)
    polydata(lines, "MaximumInscribedSphereRadius", CenterlineIds=of_line, TractIds=number).save(tmp_path / "a.vtp")
    assert same(read_centrelines(tmp_path / "a.vtp")[0], small_tree, 0.05)


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_segments_of_a_graph_in_any_order_and_direction_are_that_tree(small_tree, tmp_path, seed):
    random, small_tree = np.random.default_rng(seed), welded(small_tree)
    segments = [(v.points[k : k + 2], v.radii[k : k + 2]) for v in small_tree for k in range(len(v.points) - 1)]
    turned = [(p[::-1], r[::-1]) if random.random() < 0.5 else (p, r) for p, r in segments]
    polydata([turned[k] for k in random.permutation(len(turned))]).save(tmp_path / "graph.vtp")
    tree, _ = read_centrelines(tmp_path / "graph.vtp")
    assert same(tree, small_tree, 1e-9)
    assert len(tree.vessels) == len(small_tree.vessels)


def table_of(tree: Tree, **columns) -> pd.DataFrame:
    rows = [
        {"name": v.name, "parent": v.parent or "", "x": p[0], "y": p[1], "z": p[2], "radius": r, "branch": v.branch}
        for v in tree for p, r in zip(v.points, v.radii, strict=True)
    ]  # fmt: skip
    return pd.DataFrame(rows).assign(**columns)


def test_a_table_of_points_is_that_tree(small_tree, tmp_path):
    table_of(small_tree).to_csv(tmp_path / "a.csv", index=False)
    tree, _ = read_centrelines(tmp_path / "a.csv")
    assert [(v.name, v.parent, v.branch) for v in tree] == [(v.name, v.parent, v.branch) for v in small_tree]
    assert same(tree, small_tree, 1e-9)
    table_of(small_tree).drop(columns=["parent", "branch"]).to_csv(tmp_path / "b.csv", index=False, sep=";")
    assert same(read_centrelines(tmp_path / "b.csv", 0.1)[0].vessels["lca1"] and tree, small_tree, 1e-9)


def test_a_vessel_that_starts_in_the_middle_of_another_cuts_it(small_tree, tmp_path):
    trunk = [
        np.concatenate(parts)
        for parts in zip(
            *((small_tree[name].points, small_tree[name].radii) for name in ("branch1", "lca1")), strict=True
        )
    ]
    lines = {"aorta": None, "left": trunk, "lca2": None, "rca1": None, "aorta_outlet": None}
    frames = []
    for name, own in lines.items():
        points, radii = own if own is not None else (small_tree[name].points, small_tree[name].radii)
        frames.append(
            pd.DataFrame({"name": name, "x": points[:, 0], "y": points[:, 1], "z": points[:, 2], "radius": radii})
        )
    pd.concat(frames).to_csv(tmp_path / "a.csv", index=False)
    tree, _ = read_centrelines(tmp_path / "a.csv")
    assert tree["left"].parent == "left_1" == tree["lca2"].parent
    assert same(tree, small_tree, 0.02)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda t: t.drop(columns="radius"), "radius"),
        (
            lambda t: t.assign(radius=t["radius"].where(t.index != 3, -0.1)),
            "radius = '-0.1': line 5: expected a positive number",
        ),
        (
            lambda t: t.assign(x=t["x"].astype(object).where(t.index != 3, "left")),
            "x = 'left': line 5: expected a number",
        ),
        (
            lambda t: t.assign(parent=t["parent"].where(t["name"] != "lca1", "rca1")),
            "parent of lca1 = 'rca1': but it starts on branch1",
        ),
        (
            lambda t: t.assign(parent=t["parent"].where(t["name"] != "lca1", "lad")),
            "parent of lca1 = 'lad': no such vessel",
        ),
        (lambda t: t[(t["name"] != "lca1") | (t.index % 21 == 0)], "has one point"),
        (lambda t: t.assign(name=t["name"].where(t["name"] != "rca1", "")), "line 130: is blank; give every point"),
        (lambda t: pd.concat([t, t[t["name"] == "lca1"]]), "its rows are not together"),
        (lambda t: t.assign(z=t["z"] + 5.0 * (t["name"] == "rca1")), "radii from"),
        (lambda t: t.assign(x=t["x"].where(t.index != 3, 1e300)), "1e+300 cm': no body reaches so far"),
        (lambda t: t.assign(branch="PDA"), "branch 'PDA' is none of aorta, LM, LAD"),
    ],
)
def test_a_table_that_is_no_tree_is_one_line(small_tree, tmp_path, spoil, message):
    spoil(table_of(small_tree)).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(InputError) as error:
        read_centrelines(tmp_path / "a.csv")
    assert message in str(error.value) and str(tmp_path / "a.csv") in str(error.value)


def test_names_have_no_blanks_around_them(small_tree, tmp_path):
    table = table_of(small_tree)
    table.assign(name=" " + table["name"] + " ").to_csv(tmp_path / "a.csv", index=False, sep="\t")
    assert list(read_centrelines(tmp_path / "a.csv")[0].vessels) == list(small_tree.vessels)


def test_a_graft_is_refused_as_a_loop(small_tree, tmp_path):
    segments = [(v.points[k : k + 2], v.radii[k : k + 2]) for v in small_tree for k in range(len(v.points) - 1)]
    graft = np.stack([small_tree["lca1"].points[10], small_tree["aorta_outlet"].points[5]])
    polydata([*segments, (graft, np.array([0.2, 0.2]))]).save(tmp_path / "graph.vtp")
    with pytest.raises(InputError, match="form a loop; grafts and other loops cannot be modelled"):
        read_centrelines(tmp_path / "graph.vtp")


def test_a_case_may_have_a_table_of_centrelines(small_tree, tmp_path):
    path = write_case(tmp_path, small_tree, anatomy="{centrelines: tree.csv, unit: cm}")
    table_of(small_tree).to_csv(tmp_path / "tree.csv", index=False)
    findings, summary = check_case(path)
    assert findings == [] and any("stenosis LAD: vessel lca1" in line for line in summary)


def test_a_file_without_radii_says_what_it_has(small_tree, tmp_path):
    polydata([route(small_tree, "lca1")], "Thickness").save(tmp_path / "a.vtp")
    with pytest.raises(InputError, match="Radius: point data missing; the file has Thickness"):
        read_centrelines(tmp_path / "a.vtp")


def test_a_table_of_points_without_rows_is_told(tmp_path):
    (tmp_path / "tree.csv").write_text("name,x,y,z,radius\n")
    with pytest.raises(InputError, match="tree.csv: rows = 0: expected points of one vessel or more"):
        read_centrelines(tmp_path / "tree.csv", 1.0)
