"""The nodes of a mesh in drawn lumens: volume, validity, caps, identity; forks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import lumen_of, with_lumen
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.core.seeds import generator
from coronaryuq.flow3d.mesh.generation import quality
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.geometry.extent import pieces
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit
from coronaryuq.flow3d.mesh.geometry.paths import paths
from coronaryuq.flow3d.mesh.morph.morph import FLATTEST, INCREMENTS, Morph
from coronaryuq.flow3d.mesh.read_mesh import read_domain
from coronaryuq.flow3d.mesh.stage import mesh_tree
from support.loops import LENGTH, RADIUS, uncertain
from support.random_trees import network_of, random_tree

LARGER = [pytest.param(seed, 3, marks=pytest.mark.long) for seed in (1, 3)]
ERROR = LumenError(unit="mm", common_sd=0.1, local_sd=0.2, narrow=0.5)
coordinates = st.lists(st.floats(-2.5, 2.5), min_size=8, max_size=8)


def morph_of(model) -> Morph:
    return Morph(model.domain, model.tree, model.lumen)


@pytest.fixture(scope="module")
def narrowed():
    return morph_of(uncertain(ERROR, rings=4, constant=False))


def volume(points: np.ndarray, tets: np.ndarray) -> float:
    return float(quality.volumes(points, tets).sum())


@given(values=coordinates)
@settings(max_examples=30)
def test_volume_changes_as_the_radius_says_and_no_element_is_inverted(narrowed, values):
    morph, z = narrowed, dict(zip(narrowed.lumen.names, values, strict=False))
    moved = morph(z)
    assert quality.volumes(moved.points, morph.domain.tets).min() > 0
    arc = np.linspace(0.0, LENGTH, 4001)
    ratio = morph.lumen.ratio("B", arc, {name: np.array([value]) for name, value in z.items()})[0]
    # The mesh's own rings, 0.04 cm apart, between which its radius is linear.
    rings = np.unique(np.round(morph.domain.points[:, 2], 9))
    radius = np.interp(rings, arc, ratio * np.interp(arc, morph_radii[0], morph_radii[1]))
    across = np.diff(rings) * (radius[1:] ** 2 + radius[1:] * radius[:-1] + radius[:-1] ** 2) / 3
    own = np.interp(rings, *morph_radii)
    before = np.diff(rings) * (own[1:] ** 2 + own[1:] * own[:-1] + own[:-1] ** 2) / 3
    changed = volume(moved.points, morph.domain.tets) / volume(morph.domain.points, morph.domain.tets)
    assert changed == pytest.approx(across.sum() / before.sum(), rel=2e-3)
    assert moved.quality["volume"] == pytest.approx(volume(moved.points, morph.domain.tets))


_z = np.linspace(0.0, LENGTH, 81)
morph_radii = (_z, RADIUS * (1.0 - 0.4 * np.exp(-(((_z - 0.4) / 0.08) ** 2))))


@given(values=coordinates)
@settings(max_examples=15)
def test_caps_stay_in_their_planes(narrowed, values):
    moved = narrowed(dict(zip(narrowed.lumen.names, values, strict=False))).points
    for faces in narrowed.domain.caps.values():
        height = moved[np.unique(faces), 2]
        np.testing.assert_allclose(height, narrowed.domain.points[np.unique(faces), 2], atol=1e-12)


def test_a_lumen_with_the_meshs_radii_leaves_every_node_where_it_is():
    exact = LumenError(common_sd=0.0, local_sd=0.0, bias=0.2)
    model = uncertain(exact, constant=False)
    still = model.lumen.__class__([], {}, {})
    assert np.array_equal(Morph(model.domain, model.tree, still)({}).points, model.domain.points)


def test_in_a_tube_one_ratio_scales_every_node_across_it():
    model = uncertain(LumenError(unit="mm", common_sd=0.2, local_sd=0.0))
    moved, points = morph_of(model)({"lumen_common": 1.5}).points, model.domain.points
    ratio = model.lumen.ratio("B", [0.1], {"lumen_common": np.array([1.5])})[0, 0]
    np.testing.assert_allclose(moved[:, :2], ratio * points[:, :2], atol=1e-10)
    np.testing.assert_allclose(moved[:, 2], points[:, 2], atol=1e-10)


def test_a_draw_that_closes_the_lumen_is_refused(narrowed):
    with pytest.raises(MeshError, match="drawn lumen"):
        narrowed(dict.fromkeys(narrowed.lumen.names, -15.0))


def test_increments_keep_a_draw_that_one_displacement_spoils():
    steep = morph_of(uncertain(LumenError(unit="mm", common_sd=0.0, local_sd=0.3, length=1.0, narrow=3.0), 4, False))
    assert "increments" not in steep({"lumen_LAD_2": 1.0}).quality
    # From which draw on one displacement spoils the mesh depends on the mesh, whose last digits differ by processor.
    z, hard = next(
        (z, one) for z in np.arange(2.5, 5.0, 0.25) if "increments" in (one := steep({"lumen_LAD_2": z})).quality
    )
    assert hard.quality["increments"] == INCREMENTS
    assert hard.quality["dihedral_min"] > FLATTEST
    # The surface is where one displacement puts it.
    at = np.unique(quality.boundary(steep.domain.tets)[0])
    shift = steep._surface_shift({"lumen_LAD_2": z})
    np.testing.assert_allclose(hard.points[at], (steep.domain.points + shift)[at], rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "generations"), [(3, 2), *(pytest.param(seed, 3, marks=pytest.mark.long) for seed in (1, 3))]
)
def test_forks_grow_and_shrink_as_a_whole_and_walls_lie_on_the_drawn_tubes(seed, generations, coarse, tmp_path):
    tree, stenoses = random_tree(seed, generations)
    network = network_of(tree, stenoses)
    description = mesh_tree(tree, stenoses, network, coarse, tmp_path)
    domain = read_domain(tmp_path / "mesh-complete", tmp_path / "mesh.json")
    law = lumen_law(tree, stenoses, LumenError())
    lumen = lumen_of(with_lumen(network, tree, vessels_along(tree, stenoses, network), law))
    morph = Morph(domain, tree, lumen)
    kept = {name: interval for piece in description.pieces for name, interval in piece.items()}
    faces, _ = quality.boundary(domain.tets)
    on_caps = np.unique(np.concatenate(list(domain.caps.values())))
    wall = np.setdiff1d(np.unique(faces), on_caps)

    def off(of_tree, points) -> np.ndarray:
        """Distance of the wall's nodes from the tubes, in local radii."""
        tubes = Implicit([path for group in pieces(of_tree, kept) for path in paths(of_tree, kept, group)])
        path, segment, _ = tubes.nearest(points[wall])
        radius = [tubes.paths[p].radii[s] for p, s in zip(path, segment, strict=True)]
        return np.abs(tubes.distance(points[wall])) / radius

    shares = [0.5, 0.9, 0.95]
    own = np.quantile(off(tree, domain.points), shares)
    for k in range(12):
        z = dict(zip(lumen.names, generator(k, "fork").normal(size=20), strict=False))
        moved = morph(z)
        assert quality.volumes(moved.points, domain.tets).min() > 0
        assert (np.quantile(off(law.tree(tree, z), moved.points), shares) < own + [0.005, 0.02, 0.05]).all()
