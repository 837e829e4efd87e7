"""The bundled anatomy is plausible, can be meshed, and lies in the body as a heart does."""

import numpy as np
import pytest

from coronaryuq.case.anatomy.tree import AORTA, area_ratio, distance_to
from coronaryuq.synthetic.anatomy import CLEAR, EXPONENT, SMALLEST, Anatomy, patient_anatomy
from coronaryuq.synthetic.arteries import BUNDLED, Lesion

PATIENTS = [(2024, "right"), (1, "right"), (2, "right"), (3, "right"), (1, "left"), (2, "left"), (3, "left")]
LEFT_LESIONS = (
    Lesion("LAD", "LAD", 0.85, 1.0, 0.60),
    Lesion("LCx", "LCx", 0.9, 1.0, 0.60),
    Lesion("RCA", "RCA", 0.7, 1.0, 0.60),
)


@pytest.fixture(scope="module", params=PATIENTS, ids=str)
def drawn(request) -> tuple[str, Anatomy]:
    seed, dominance = request.param
    return dominance, patient_anatomy(seed, dominance, BUNDLED if dominance == "right" else LEFT_LESIONS)


@pytest.fixture(scope="module")
def anatomy(drawn) -> Anatomy:
    return drawn[1]


def test_many_outlets_perfuse_the_left_ventricle_and_some_do_not(drawn):
    dominance, anatomy = drawn
    perfuses = [outlet.perfuses for outlet in anatomy.outlets]
    assert perfuses.count("LV") >= {"right": 14, "left": 12}[dominance]
    assert perfuses.count("RV") >= 2 and perfuses.count("septum") >= 1
    coronary = {v.name for v in anatomy.tree.leaves() if v.branch != AORTA}
    assert {outlet.vessel for outlet in anatomy.outlets} == coronary


def test_the_dominant_artery_ends_in_the_posterior_groove(drawn):
    dominance, anatomy = drawn
    label, branch = {"right": ("PDA", "RCA"), "left": ("LCx", "LCx")}[dominance]
    vessel = next(o.vessel for o in anatomy.outlets if o.label == label)
    assert anatomy.tree[vessel].branch == branch
    assert anatomy.tree.path(vessel)[1].parent == "aorta"
    phi, s, _ = anatomy.ventricle.coordinates(anatomy.to_heart_frame(anatomy.tree[vessel].points[-1:]))
    assert np.degrees(phi[0]) == pytest.approx(240, abs=8) and 0.4 < s[0] < 0.65
    feeding = {o.branch for o in anatomy.outlets if o.perfuses == "LV"}
    assert ("RCA" in feeding) == (dominance == "right")


def test_two_ostial_arteries_arise_from_one_aorta(anatomy):
    ostial = [v for v in anatomy.tree if anatomy.tree.ostial(v)]
    assert [v.branch for v in ostial] == ["LM", "RCA"]
    for vessel in ostial:
        assert 1.2 < anatomy.tree.emergence(vessel.name) < vessel.length - 0.5


def test_calibres_obey_murrays_law_where_none_is_at_the_floor(anatomy):
    checked = 0
    for vessel in anatomy.tree:
        children = [c for c in anatomy.tree.children(vessel.name) if c.branch != AORTA]
        if vessel.branch == AORTA or not children or min(c.radii[0] for c in children) <= SMALLEST:
            continue
        total = sum(c.radii[0] ** EXPONENT for c in children)
        assert total == pytest.approx(vessel.radii[-1] ** EXPONENT, rel=1e-9)
        checked += 1
    assert checked >= 5


def test_no_vessel_widens_and_none_is_thinner_than_ct_can_see(anatomy):
    stenosed = {s.vessel for s in anatomy.stenoses}
    for vessel in anatomy.tree:
        if vessel.branch != AORTA and vessel.name not in stenosed:
            assert (np.diff(vessel.radii) <= 1e-12).all()
            assert vessel.radii[-1] > 0.05


def test_vessels_that_do_not_meet_keep_clear_of_one_another(anatomy):
    tree = anatomy.tree
    for a in tree:
        for b in tree:
            related = a.name == b.name or a.parent == b.name or b.parent == a.name or a.parent == b.parent
            if not related:
                clearance = (distance_to(a, b.points) - b.radii).min()
                assert clearance > 0.05, f"{a.name} and {b.name}: {clearance:.3f} cm"


def test_siblings_part_within_a_few_radii(anatomy):
    for a in anatomy.tree:
        for b in anatomy.tree.children(a.parent) if a.parent else []:
            if a.name != b.name and AORTA not in (a.branch, b.branch):
                far = b.arc > 5 * b.radii[0]
                assert (distance_to(a, b.points[far]) - b.radii[far]).min() > 0.01, f"{a.name} and {b.name}"


def test_epicardial_arteries_lie_on_the_heart_and_septal_ones_in_it(anatomy):
    for outlet in anatomy.outlets:
        end = anatomy.to_heart_frame(anatomy.tree[outlet.vessel].points[-1:])
        _, s, depth = anatomy.ventricle.coordinates(end)
        assert 0.0 < s[0] < 1.0
        if outlet.perfuses == "LV":
            assert -0.8 < depth[0] < 0.0
        elif outlet.perfuses == "septum":
            assert 0.2 < depth[0] < 0.8


def test_each_artery_has_one_stenosis_of_the_stated_severity(anatomy):
    assert [s.name for s in anatomy.stenoses] == ["LAD", "LCx", "RCA"]
    for stenosis in anatomy.stenoses:
        assert anatomy.tree[stenosis.vessel].branch == stenosis.name
        assert 0.10 < area_ratio(anatomy.tree, stenosis) < 0.25


def test_a_stenosis_that_would_lie_on_a_bifurcation_is_moved_beside_it():
    course = [patient_anatomy(1, lesions=(Lesion("LAD", "LAD", at, 0.8, 0.5),)) for at in (1.55, 1.65)]
    for anatomy in course:
        (stenosis,) = anatomy.stenoses
        vessel = anatomy.tree[stenosis.vessel]
        assert min(stenosis.start, vessel.length - stenosis.end) == pytest.approx(CLEAR, abs=1e-3)
        assert stenosis.end - stenosis.start == pytest.approx(0.8)
    assert patient_anatomy(1, lesions=()).stenoses == ()
    with pytest.raises(ValueError, match="of LAD does not fit between two bifurcations"):
        patient_anatomy(1, lesions=(Lesion("LAD", "LAD", 1.0, 5.0, 0.5),))


def test_no_territory_is_tiny_or_takes_half_the_wall(anatomy):
    from scipy.spatial import cKDTree

    ends = [anatomy.tree[o.vessel].points[-1] for o in anatomy.outlets if o.perfuses == "LV"]
    wall = anatomy.wall(20_000)
    _, nearest = cKDTree(ends).query(np.asarray(wall.cell_centers().points))
    share = np.bincount(nearest, minlength=len(ends)) / wall.n_cells
    assert share.min() > 0.01 and share.max() < 0.25


def test_the_seed_alone_decides():
    first, second, other = (patient_anatomy(seed).tree["lca1"].points for seed in (2024, 2024, 2025))
    assert np.array_equal(first, second)
    assert np.linalg.norm(first[-1] - other[-1]) > 0.01


def test_body_axes_are_a_rotation_that_points_the_apex_left_forwards_and_down():
    rotation = Anatomy.to_body_axes(np.eye(3))
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    left, posterior, superior = Anatomy.to_body_axes(np.array([0.0, 0.0, -1.0]))
    assert left > 0 and posterior < 0 and superior < 0
    assert Anatomy.to_heart_frame(Anatomy.to_body_axes(np.eye(3))) == pytest.approx(np.eye(3), abs=1e-12)


def test_the_apex_points_left_forwards_and_down():
    wall = patient_anatomy().wall(3000)
    points = np.asarray(wall.points)
    base = points[np.argsort(points @ [0.6, -0.53, -0.6])[: len(points) // 20]].mean(axis=0)
    apex = points[np.argmax(points @ [0.6, -0.53, -0.6])]
    assert (np.sign(apex - base) == [1, -1, -1]).all()


def test_the_right_ventricle_is_on_the_left_as_seen_from_the_apex_with_the_anterior_wall_up():
    anatomy = patient_anatomy()
    ends = {outlet.label: anatomy.tree[outlet.vessel].points[-1] for outlet in anatomy.outlets}
    points = np.asarray(anatomy.wall(3000).points)
    long_axis = anatomy.to_body_axes(np.array([0.0, 0.0, -1.0]))
    up = ends["LAD"] - ends["PDA"]
    right = np.cross(-long_axis, up)
    assert (ends["RV"] - points.mean(axis=0)) @ right < 0
    assert (ends["OM3"] - points.mean(axis=0)) @ right > 0
