"""Signed distance of vessels and the surface cut from it, against bodies whose shape is known."""

import numpy as np
import pytest

from coronaryuq.case.anatomy.tree import Tree, Vessel
from coronaryuq.core.seeds import generator
from coronaryuq.flow3d.mesh.generation.volume import borders
from coronaryuq.flow3d.mesh.geometry import implicit, paths
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.geometry.extent import trees
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit, Path
from coronaryuq.flow3d.mesh.geometry.surface import cut, enclosed_volume, isosurface, surface
from support.random_trees import random_tree, tube


def path(points, radii, blend=0.05) -> Path:
    points = np.asarray(points, float)
    return Path(points, np.asarray(radii, float), np.full(len(points), "v"), np.arange(len(points), dtype=float), blend)


@pytest.fixture(scope="module")
def pipe():
    tree, _ = tube(length=1.5, radius=0.2)
    kept = trees(tree)
    return Implicit(paths.paths(tree, kept, ["LAD"])), paths.caps(tree, kept, ["LAD"])


def test_distance_to_a_straight_tube_is_exact(pipe):
    tube, _ = pipe
    rng = generator(1, "points")
    points = np.column_stack([rng.uniform(0.2, 1.3, 200), rng.uniform(-0.5, 0.5, (200, 2))])
    expected = np.hypot(points[:, 1], points[:, 2]) - 0.2
    np.testing.assert_allclose(tube.distance(points), expected, atol=1e-12)


def test_skipping_distant_segments_does_not_change_the_distance(monkeypatch):
    rng = generator(2, "knots")
    lines = [path(np.cumsum(rng.normal(scale=0.1, size=(60, 3)), axis=0), rng.uniform(0.05, 0.2, 60)) for _ in range(2)]
    points = rng.normal(size=(300, 3))
    skipping = Implicit(lines)
    monkeypatch.setattr(implicit, "CHUNK", 1000)
    np.testing.assert_array_equal(skipping.distance(points), Implicit(lines).distance(points))


def test_a_tapered_tube_has_the_given_radius():
    x = np.linspace(0.0, 2.0, 81)
    radii = 0.2 - 0.1 * np.exp(-(((x - 1.0) / 0.3) ** 2))
    tapered = Implicit([path(np.column_stack([x, 0 * x, 0 * x]), radii)])
    points = np.column_stack([x, radii, 0 * x])
    np.testing.assert_allclose(tapered.distance(points), 0.0, atol=1e-12)


def test_two_tubes_are_blended_smoothly():
    one, two = path([(-1, 0, 0), (1, 0, 0)], [0.2, 0.2]), path([(0, 0, 0), (0, 1, 0)], [0.15, 0.15], blend=0.1)
    points = generator(4, "blend").uniform(-0.4, 0.4, (200, 3))
    first, second = Implicit([one]).distance(points), Implicit([two]).distance(points)
    overlap = np.clip(0.1 - np.abs(first - second), 0.0, None)
    expected = np.minimum(first, second) - overlap**2 / 0.4
    np.testing.assert_allclose(Implicit([one, two]).distance(points), expected, atol=1e-12)


def bend(radii, names) -> Path:
    """An axis that turns by a right angle half way."""
    points = [(x, 0.0, 0.0) for x in np.linspace(-1.0, 0.0, 20, endpoint=False)]
    points += [(0.0, y, 0.0) for y in np.linspace(0.0, 1.0, 20)]
    return Path(np.array(points), radii, np.array(names), np.linspace(0.0, 2.0, 40), 0.05)


@pytest.mark.parametrize(
    "line",
    [
        bend(np.repeat([0.3, 0.2], 20), ["mother"] * 20 + ["daughter"] * 20),
        bend(np.linspace(0.4, 0.1, 40), ["one"] * 40),
    ],
    ids=["narrower daughter", "taper round a corner"],
)
def test_the_distance_is_continuous_inside_a_bend(line):
    body = Implicit([line])
    points = generator(5, "bend").uniform([-0.6, -0.1, -0.4], [0.1, 0.6, 0.4], (20000, 3))
    step = 1e-4 * generator(6, "bend").normal(size=points.shape)
    change = np.abs(body.distance(points + step) - body.distance(points))
    assert (change <= implicit.STEEPEST * np.linalg.norm(step, axis=1)).all()


def test_the_distance_to_a_tree_is_continuous_at_a_bifurcation():
    # The first bifurcation of this tree turns by more than a right angle and loses a fifth of the radius.
    tree, _ = random_tree(1)
    kept = trees(tree)
    body = Implicit(paths.paths(tree, kept, list(kept)))
    reach = 1.2 * tree.root.radii[-1]
    points = tree.root.points[-1] + generator(7, "fork").uniform(-reach, reach, (20000, 3))
    step = 1e-4 * generator(8, "fork").normal(size=points.shape)
    change = np.abs(body.distance(points + step) - body.distance(points))
    assert (change <= implicit.STEEPEST * np.linalg.norm(step, axis=1)).all()


def test_blocks_agree_with_single_points(pipe):
    tube, _ = pipe
    corner, values = next(iter(tube.blocks(0.05, 6)))
    index = np.stack(np.meshgrid(*[np.arange(7)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    points = tube.origin(0.05) + 0.05 * (corner + index)
    np.testing.assert_allclose(values.ravel(), tube.distance(points), atol=1e-12)


def test_isosurface_is_closed_and_on_the_surface(pipe):
    tube, _ = pipe
    points, triangles = isosurface(tube, 0.06)
    assert len(borders(triangles, np.arange(len(triangles)))) == 1.5 * len(triangles)
    assert np.abs(tube.distance(points)).max() < 1e-8


def test_cut_tube_has_flat_caps_and_the_volume_of_its_polygon(pipe):
    tube, caps = pipe
    volumes = []
    for spacing in (0.06, 0.03):
        points, triangles, refs = surface(tube, caps, spacing)
        volumes.append(enclosed_volume(points, triangles))
        for index, cap in enumerate(caps):
            flat = points[triangles[refs == index + 2]]
            assert np.abs((flat - cap.centre) @ cap.normal).max() < 1e-12
        rim = points[borders(triangles, refs)]
        assert np.linalg.norm(rim[:, 0] - rim[:, 1], axis=1).min() > 0.25 * spacing
    errors = 1.0 - np.array(volumes) / (np.pi * 0.2**2 * 1.5)
    assert errors[1] < 0.006
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.35)


@pytest.mark.slow
def test_no_triangle_flips_at_a_rim_on_a_coarse_grid():
    for seed in range(30):
        way = generator(seed, "way").normal(size=3)
        way /= np.linalg.norm(way)
        along = np.linspace(0.0, 1.0, 41)
        vessel = Vessel("LAD", along[:, None] * way, np.full(41, 0.1), None, "LAD")
        tree = Tree([vessel])
        body = Implicit(paths.paths(tree, trees(tree), ["LAD"]))
        points, triangles, refs = surface(body, paths.caps(tree, trees(tree), ["LAD"]), 0.06)
        corners = points[triangles[refs == 1]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outward = corners.mean(axis=1)
        outward -= (outward @ way)[:, None] * way
        assert ((normal * outward).sum(axis=1) > 0.0).all()


@pytest.mark.slow
def test_no_triangle_flips_at_the_caps_of_a_tree():
    # Here the isosurface has slivers within reach of three of its caps.
    tree, _ = random_tree(3)
    kept = trees(tree)
    ends = paths.caps(tree, kept, list(kept))
    along = paths.paths(tree, kept, list(kept))
    body = Implicit(along)
    points, triangles, refs = surface(body, ends, 0.6 * min(line.radii.min() for line in along))
    corners = points[triangles[refs == 1]]
    centres = corners.mean(axis=1)
    near = np.any([np.linalg.norm(centres - cap.centre, axis=1) < 1.6 * cap.radius for cap in ends], axis=0)
    normal = np.cross(corners[near, 1] - corners[near, 0], corners[near, 2] - corners[near, 0])
    assert ((normal * body.gradient(centres[near], 1e-3)).sum(axis=1) > 0.0).all()


def test_a_cap_within_another_vessel_is_rejected_by_name():
    tree, _ = tube(length=1.5, radius=0.2)
    kept = trees(tree)
    other = path([(1.5, 0.3, -1.0), (1.5, 0.3, 1.0)], [0.25, 0.25])
    crossing = Implicit([*paths.paths(tree, kept, ["LAD"]), other])
    outlet = paths.caps(tree, kept, ["LAD"])[1]
    points, triangles = isosurface(crossing, 0.06)
    with pytest.raises(MeshError, match="outlet_LAD"):
        cut(points, triangles, np.ones(len(triangles), int), 2, outlet, crossing, 0.06)


def test_a_vessel_that_crosses_the_plane_of_a_cap_stays_whole():
    trunk = path([(0, 0, -0.5), (0, 0, 1.5)], [0.5, 0.5])
    branch = path([(0, 0, 1), (0.85, 0, 0.9), (0.9, 0, 0.205), (0.9, 1, 0.205)], [0.2, 0.2, 0.2, 0.2])
    ends = [
        paths.Cap("low", "v", 0.0, True, np.zeros(3), np.array([0.0, 0.0, -1.0]), 0.5),
        paths.Cap("high", "v", 0.0, False, np.array([0.0, 0.0, 1.4]), np.array([0.0, 0.0, 1.0]), 0.5),
        paths.Cap("side", "v", 0.0, False, np.array([0.9, 0.8, 0.205]), np.array([0.0, 1.0, 0.0]), 0.2),
    ]
    points, triangles, refs = surface(Implicit([trunk, branch]), ends, 0.05)
    assert len(borders(triangles, refs)) == sum(len(borders(triangles, np.where(refs == k, 2, 1))) for k in (2, 3, 4))
    low = triangles[refs == 2]
    assert np.linalg.norm(points[np.unique(low), :2], axis=1).max() < 0.55
