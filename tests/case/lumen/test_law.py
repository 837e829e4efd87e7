"""The law of the radius: its moments, its correlation along the vessels, and what a few coordinates leave."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.case.description.lumen import CalcifiedStretch, LumenError
from coronaryuq.case.lumen.law import _distance, lumen_law
from support.random_trees import random_tree, tube

errors = st.builds(
    LumenError,
    unit=st.sampled_from(["mm", "voxel"]),
    bias=st.floats(-0.6, 0.6),
    common_sd=st.floats(0.0, 0.5),
    local_sd=st.floats(0.0, 0.5),
    length=st.floats(1.0, 30.0),
    narrow=st.floats(0.0, 3.0),
)


def forked() -> tuple[Tree, list[Stenosis]]:
    """LM that divides into LAD, with a stenosis, and LCx; an RCA-free tree whose root is the aorta."""
    x = np.linspace(0.0, 1.0, 11)[:, None]
    aorta = Vessel("aorta", x * [0.0, 0.0, 2.0], np.full(11, 1.2), None, "aorta")
    lm = Vessel("lm", [0.0, 0.0, 2.0] + x * [2.5, 0.0, 0.0], np.full(11, 0.2), "aorta", "LM")
    dip = 1.0 - 0.5 * np.exp(-(((x[:, 0] - 0.5) / 0.1) ** 2))
    lad = Vessel("lad", lm.points[-1] + x * [4.0, 0.5, 0.0], 0.15 * dip, "lm", "LAD")
    lcx = Vessel("lcx", lm.points[-1] + x * [0.0, 3.0, 0.0], np.linspace(0.15, 0.1, 11), "lm", "LCx")
    return Tree([aorta, lm, lad, lcx]), [Stenosis("LAD", "lad", 1.2, 2.8)]


@given(error=errors, seed=st.integers(0, 20))
@settings(max_examples=30)
def test_the_radius_has_the_stated_mean_and_standard_deviation_at_every_place(error, seed):
    tree, stenoses = random_tree(seed)
    law = lumen_law(tree, stenoses, error)
    for vessel in tree:
        own = law.vessels[vessel.name]
        radius, variance = vessel.radius_at(own.arc), sum(np.square(column) for column in own.columns.values())
        mean = radius * np.exp(own.mean + variance / 2)
        shift = error.bias * error.scale
        expected = radius + shift if shift >= 0 else radius / (1.0 - shift / radius)
        np.testing.assert_allclose(mean, expected, rtol=1e-9)
        if not any(s.vessel == vessel.name for s in stenoses):
            sd = error.scale * np.hypot(error.common_sd, error.local_sd)
            np.testing.assert_allclose(radius * np.sqrt(np.expm1(variance)), sd, rtol=1e-9, atol=1e-12)


@given(error=errors, seed=st.integers(0, 20), z=st.floats(-8.0, 8.0))
@settings(max_examples=20)
def test_no_draw_has_a_radius_below_zero(error, seed, z):
    tree, stenoses = random_tree(seed)
    law = lumen_law(tree, stenoses, error)
    drawn = law.tree(tree, dict.fromkeys(law.names, z))
    assert all((vessel.radii > 0).all() and np.isfinite(vessel.radii).all() for vessel in drawn)


def test_without_noise_and_bias_every_draw_is_the_segmented_lumen():
    tree, stenoses = forked()
    law = lumen_law(tree, stenoses, LumenError(common_sd=0.0, local_sd=0.0))
    assert law.names == []
    for vessel in law.tree(tree, {}):
        assert np.array_equal(vessel.radii, tree[vessel.name].radius_at(vessel.arc))


def test_the_error_in_a_stenosis_and_behind_calcium_is_larger_as_stated():
    tree, stenoses = forked()
    calcified = [CalcifiedStretch(vessel="lcx", start=1.0, end=2.0)]
    error = LumenError(unit="mm", common_sd=0.0, local_sd=0.05, narrow=1.0, calcified=calcified, calcium=2.0)
    law = lumen_law(tree, stenoses, error)

    def sd(vessel: str, arc: float) -> float:
        own = law.vessels[vessel]
        variance = sum(np.interp(arc, own.arc, column) ** 2 for column in own.columns.values())
        return float(tree[vessel].radius_at(arc) * np.sqrt(np.expm1(variance)))

    middle = tree["lad"].length / 2
    assert sd("lad", middle) == pytest.approx(0.005 * 1.5, rel=0.01)  # half of the radius is lost
    assert sd("lad", 0.5) == pytest.approx(0.005, rel=1e-3)
    assert sd("lcx", 1.5) == pytest.approx(0.015, rel=1e-3)
    assert sd("lcx", 2.5) == pytest.approx(0.005, rel=1e-3)


@pytest.mark.parametrize(("vessel", "end"), [("aorta", 1.0), ("nowhere", 1.0), ("lcx", 9.0)])
def test_a_calcified_stretch_off_the_coronary_vessels_is_refused(vessel, end):
    tree, stenoses = forked()
    with pytest.raises(ValueError, match="calcified"):
        lumen_law(tree, stenoses, LumenError(calcified=[CalcifiedStretch(vessel=vessel, start=0.5, end=end)]))


@pytest.mark.parametrize("seed", range(4))
def test_distances_are_those_along_the_vessels(seed):
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    tree, _ = random_tree(seed)
    vessels = list(tree)
    first = dict(zip((v.name for v in vessels), np.cumsum([0, *(len(v.arc) for v in vessels)]), strict=False))
    rows, columns, lengths = [], [], []
    for vessel in vessels:
        start, n = first[vessel.name], len(vessel.arc)
        rows += range(start, start + n - 1)
        columns += range(start + 1, start + n)
        lengths += np.diff(vessel.arc).tolist()
        if vessel.parent:
            rows.append(first[vessel.parent] + len(tree[vessel.parent].arc) - 1)
            columns.append(start)
            lengths.append(1e-12)
    total = sum(len(v.arc) for v in vessels)
    exact = dijkstra(coo_array((lengths, (rows, columns)), shape=(total, total)).tocsr(), directed=False)
    np.testing.assert_allclose(_distance(tree, vessels), exact, atol=1e-9)


def test_with_many_terms_the_covariance_along_the_way_to_the_stenosis_is_the_stated_one():
    tree, stenoses = tube(length=3.0, radius=0.15, severity=0.5)
    error = LumenError(unit="mm", common_sd=0.0, local_sd=0.03, length=5.0, narrow=0.0)
    law = lumen_law(tree, stenoses, error, modes=120)
    own = law.vessels["LAD"]
    covariance = sum(np.outer(column, column) for column in own.columns.values())
    sd = np.sqrt(np.diag(covariance))
    exact = np.exp(-np.abs(own.arc[:, None] - own.arc) / 0.5)
    counted = own.arc < 2.0 + 10 * 0.15
    np.testing.assert_allclose(
        (covariance / np.outer(sd, sd))[np.ix_(counted, counted)], exact[counted][:, counted], atol=0.02
    )
    assert law.captured["LAD"] == pytest.approx(1.0, abs=0.01)


def test_few_coordinates_carry_most_of_what_the_pressure_loss_sees_and_more_carry_more():
    tree, stenoses = tube(length=3.0, radius=0.15, severity=0.5)
    shares = [lumen_law(tree, stenoses, LumenError(), modes).captured["LAD"] for modes in (1, 2, 3, 6, 12)]
    assert shares == sorted(shares) and shares[2] > 0.8 and shares[-1] > 0.95


def test_coordinates_are_named_by_artery_and_an_artery_without_stenosis_has_one():
    tree, stenoses = forked()
    law = lumen_law(tree, stenoses, LumenError())
    assert law.names == [
        *("lumen_common", "lumen_LM_rest"),
        *("lumen_LAD_1", "lumen_LAD_2", "lumen_LAD_3", "lumen_LAD_rest"),
        "lumen_LCx_rest",
    ]
    assert "aorta" not in law.vessels
    assert set(law.vessels["lcx"].columns) == {"lumen_common", "lumen_LCx_rest"}
