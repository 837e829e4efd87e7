"""Adopted narrowings in the lumen of samples: of the member that acts, by its size, in and outside the mesh."""

from dataclasses import replace

import numpy as np
import pytest

from coronaryuq.case.anatomy.tree import Tree
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.throat_loss import throat_loss
from coronaryuq.case.network.build import Physics, elements, shape_integrals, stenosis_coefficient
from coronaryuq.case.network.network import NARROWED
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.generation import quality
from coronaryuq.flow3d.mesh.remesh import drawn_tree
from coronaryuq.flow3d.narrowed_lumen import narrowed_lumen
from coronaryuq.zerod.effects.library import effect
from support.loops import RADIUS
from support.narrowings import FLOW, LENGTH, MEMBER, SCALES, SIZE, member, narrowed

ARC = np.linspace(0.0, LENGTH, 961)
UNIT = stenosis_coefficient(0.5, 1.0, Physics())
COMMON = LumenError(unit="mm", common_sd=0.15, local_sd=0.0)
STENOSIS = [member("quadratic_stenosis")]
UNDECIDED = [member("quadratic_stenosis", probability=0.6), member("pressure_offset", probability=0.4)]


def coefficient(name: str, z: float = 0.0, sd: float = 0.5) -> float:
    """S that the law of a stenosis adds."""
    loss = float(effect(name).parameters[0].from_standard(sd * z))
    return loss * SCALES["pressure"] / FLOW**2


def radii(model, theta, own=RADIUS):
    return own * model.lumen.ratio("B", ARC, {name: np.array([value]) for name, value in theta.items()})[0]


def rule(drawn, start=0.0, end=LENGTH):
    inside = (start - 1e-9 <= ARC) & (end + 1e-9 >= ARC)
    return UNIT * float(throat_loss(drawn[None, inside], ARC[inside])[0])


@pytest.mark.parametrize("z", [-1.0, 0.0, 1.5])
def test_the_drawn_lumen_has_the_coefficient_of_the_samples_size(z):
    drawn = radii(narrowed(STENOSIS), {SIZE: z})
    assert rule(drawn) == pytest.approx(coefficient("quadratic_stenosis", z), rel=1e-3)
    half = 3.0 * RADIUS
    far = np.abs(ARC - 0.5 * LENGTH) > half
    np.testing.assert_array_equal(drawn[far], RADIUS)


def test_without_columns_the_lumen_is_that_of_the_first_member_at_its_mean():
    model = narrowed(UNDECIDED)
    absent = model.shapes({}, 3)
    centre = model.shapes({SIZE: np.zeros(3), MEMBER: np.zeros(3)}, 3)
    np.testing.assert_array_equal(absent.points, centre.points)
    assert not np.array_equal(absent.points[0], model.domain.points)


def test_a_sample_with_another_member_has_the_segmented_lumen():
    model = narrowed(UNDECIDED)
    shapes = model.shapes({SIZE: np.array([1.0, 1.0, -1.0]), MEMBER: np.array([0.0, 1.0, 1.0])}, 3)
    assert np.abs(shapes.points[0] - model.domain.points).max() > 0.1 * RADIUS
    np.testing.assert_array_equal(shapes.points[1], model.domain.points)
    np.testing.assert_array_equal(shapes.points[2], model.domain.points)
    (whole,) = shapes.whole.values()
    assert whole[0] == pytest.approx(coefficient("quadratic_stenosis", 1.0)) and not whole[1:].any()


def test_a_mean_stenosis_is_a_valid_mesh_of_its_own_volume():
    model = narrowed(STENOSIS, rings=4)
    shapes = model.shapes({SIZE: np.zeros(1)}, 1)
    assert shapes.reasons == [""]
    volumes = (quality.volumes(points, model.domain.tets) for points in (shapes.points[0], model.domain.points))
    new, old = volumes
    assert new.min() > 0
    drawn = radii(model, {SIZE: 0.0})
    exact = np.trapezoid((drawn / RADIUS) ** 2, ARC) / LENGTH
    spacing = LENGTH / 60  # of the mesh's rings, between which its radius is linear
    curved = np.abs(np.gradient(np.gradient((drawn / RADIUS) ** 2, ARC), ARC)).max()
    assert new.sum() / old.sum() == pytest.approx(exact, abs=curved * spacing**2 / 8)


def test_a_stenosis_that_closes_the_lumen_is_a_reason_and_the_others_go_on():
    shapes = narrowed(STENOSIS).shapes({SIZE: np.array([0.0, 40.0])}, 2)
    assert shapes.reasons[0] == "" and "drawn lumen" in shapes.reasons[1]


def test_a_lesion_is_tighter_where_it_was_declared_and_nothing_else_is():
    z = np.linspace(0.0, LENGTH, 121)
    own = RADIUS * (1.0 - 0.4 * np.exp(-(((z - 0.8) / 0.1) ** 2)))
    model = narrowed(STENOSIS, lesion=(0.4, 1.4), radii=own)
    segmented = np.interp(ARC, z, own)
    drawn = radii(model, {SIZE: 0.0}, segmented)
    before, after = (rule(values, 0.4, 1.4) for values in (segmented, drawn))
    assert after == pytest.approx(before + coefficient("quadratic_stenosis"), rel=1e-3)
    np.testing.assert_array_equal(drawn[(ARC <= 0.4) | (ARC >= 1.4)], segmented[(ARC <= 0.4) | (ARC >= 1.4)])
    assert ARC[np.argmin(drawn)] == pytest.approx(0.8, abs=0.02)


def test_a_focal_stenosis_is_where_the_search_found_it():
    law, mean = effect("focal_stenosis"), 0.4
    found = member("focal_stenosis", 4, mean=mean)
    sizes = {one.name: float(one.from_standard(mean)) for one in law.parameters}
    length = min(sizes["length"], LENGTH)
    start = (LENGTH - length) * sizes["position"] / (1.0 + sizes["position"])
    drawn = radii(narrowed([found]), {})
    inside = np.flatnonzero(drawn < RADIUS * (1 - 1e-9))
    assert ARC[inside[0]] == pytest.approx(start, abs=0.02)
    assert ARC[inside[-1]] == pytest.approx(start + length, abs=0.02)
    assert ARC[np.argmin(drawn)] == pytest.approx(start + 0.5 * length, abs=0.01)


def test_a_diffuse_narrowing_has_the_added_resistance():
    model = narrowed([member("diffuse_narrowing")])
    added = float(effect("diffuse_narrowing").parameters[0].centre) * SCALES["pressure"] / FLOW
    own = elements(model.tree["B"], Physics())["R_poiseuille"]
    fourth = [float(shape_integrals(values, ARC)[0]) for values in (radii(model, {}), np.full(len(ARC), RADIUS))]
    assert fourth[0] / fourth[1] == pytest.approx(1.0 + added / own, rel=1e-3)


def test_an_uncertain_lumen_is_narrowed_by_what_its_own_radius_needs():
    model = narrowed(STENOSIS, error=COMMON)
    drawn = radii(model, {"lumen_common": -1.0, SIZE: 0.5})
    healthy = radii(model, {"lumen_common": -1.0, SIZE: -40.0})
    assert healthy.max() < 0.95 * RADIUS
    assert rule(drawn) == pytest.approx(coefficient("quadratic_stenosis", 0.5), rel=1e-3)
    shapes = model.shapes({"lumen_common": np.array([-1.0, 1.0]), SIZE: np.zeros(2)}, 2)
    assert shapes.reasons == ["", ""]


@pytest.mark.parametrize("error", [None, COMMON])
def test_what_lies_outside_the_mesh_stays_with_the_0d_part(error):
    """Of a diffuse narrowing, resistances inside and outside add up to that of the whole."""
    meshed = (0.7, 2.0)
    model = narrowed([member("diffuse_narrowing")], error=error, meshed=meshed)
    theta = {SIZE: np.array([0.5])} | ({} if error is None else {"lumen_common": np.array([-0.7])})
    factors = model.shapes(theta, 1).outside
    narrow, plain = (model.lumen.ratio("B", ARC, theta | {SIZE: np.array([z])})[0] for z in (0.5, -40.0))
    for name, (start, end) in (("B", (0.0, meshed[0])), ("B_downstream", (meshed[1], LENGTH))):
        inside = (start - 1e-9 <= ARC) & (end + 1e-9 >= ARC)
        new, old = (shape_integrals(r[inside], ARC[inside])[0] for r in (narrow, plain))
        # The coordinate of the lumen changes the part as it does the whole.
        assert factors[f"{name}.R_poiseuille"][0] == pytest.approx(new / old, rel=1e-3)
        assert new / old > 1.05


@pytest.mark.parametrize(
    ("meshed", "part"), [((0.0, 0.9), "B"), ((1.5, LENGTH), "B"), ((0.0, 2.0), ""), ((0.9, 1.4), "B_downstream")]
)
def test_a_stenosis_goes_where_the_mesh_has_room_and_beside_it_keeps_its_own_law(meshed, part):
    model = narrowed([member("stenosis_with_viscous_loss", 2)], meshed=meshed)
    theta = {SIZE: np.array([0.0, 1.0])}
    shapes = model.shapes(theta, 2)
    moved = ARC[model.lumen.ratio("B", ARC, {SIZE: np.zeros(1)})[0] < 1.0]
    if part:
        assert not len(moved) and np.array_equal(shapes.points[1], model.domain.points)
        assert set(shapes.added) == {f"{part}.stenosis_coefficient", f"{part}.R_poiseuille"}
        expected = [coefficient("stenosis_with_viscous_loss", z) for z in (0.0, 1.0)]
        np.testing.assert_allclose(shapes.added[f"{part}.stenosis_coefficient"], expected, rtol=1e-9)
    else:
        assert not shapes.added and meshed[0] < moved[0] and moved[-1] < meshed[1]
        np.testing.assert_allclose([moved[0], moved[-1]], 1.0 + np.array([-0.45, 0.45]), atol=0.01)


@pytest.mark.parametrize("position", [-1.5, 1.5])
def test_a_focal_stenosis_beyond_the_cap_stays_in_0d_and_one_before_it_is_in_the_lumen(position):
    """The third size is the logarithm of the length ahead over that behind, in standard deviations."""
    model = narrowed([member("focal_stenosis", 4, sd=1.0)], meshed=(0.0, 1.2))
    theta = {f"{SIZE}_3": np.array([position]), f"{SIZE}_4": np.array([-1.0])}
    inside = position < 0.0
    shapes = model.shapes(theta, 1)
    assert bool((model.lumen.ratio("B", ARC, theta)[0] < 1.0).any()) == inside
    assert bool(shapes.added) == (not inside)
    assert set(shapes.whole) == {"B.stenosis_coefficient", "B.R_poiseuille"}


@pytest.mark.parametrize("error", [None, COMMON])
def test_blood_enters_faster_into_a_narrowed_inlet(error):
    """The 0D part ahead of the cap has the term of Bernoulli's equation: with the fourth power of the cap's radius."""
    model = narrowed([member("diffuse_narrowing")], error=error, meshed=(0.4, LENGTH), entrance=1.0)
    plain, drawn = (model.shapes({SIZE: np.array([z])}, 1).outside["B.stenosis_coefficient"][0] for z in (-40.0, 1.0))
    ratio = [model.lumen.ratio("B", 0.4, {SIZE: np.array([z])})[0, 0] for z in (-40.0, 1.0)]
    assert ratio[1] < 0.95 * ratio[0]
    assert drawn / plain == pytest.approx((ratio[0] / ratio[1]) ** 4, rel=1e-9)


def test_a_lumen_that_is_meshed_anew_has_the_shape_between_the_points_of_a_coarse_centreline():
    model = narrowed(STENOSIS)
    coarse = Tree([replace(model.tree["B"], points=model.tree["B"].points[::40], radii=np.full(4, RADIUS))])
    drawn = drawn_tree(coarse, narrowed_lumen(model.network, coarse), {SIZE: 0.0})["B"]
    assert rule(drawn.radius_at(ARC)) == pytest.approx(coefficient("quadratic_stenosis"), rel=1e-2)


def test_a_part_that_does_not_fit_the_network_names_the_file():
    model = narrowed(STENOSIS)
    spoiled = model.network.deep_copy()
    spoiled[NARROWED]["members"][0]["member"] = 3
    with pytest.raises(InputError, match=r"loop\.json.*narrowed"):
        narrowed_lumen(spoiled, model.tree, "loop.json")
