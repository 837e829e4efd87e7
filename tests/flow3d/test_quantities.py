"""Statistics over a stenosis region: areas count, patches average, and both settle as the mesh is refined."""

import numpy as np
import pytest

from coronaryuq.core.units import MMHG
from coronaryuq.flow3d.quantities import PATCH, WallRegion, area_quantile, stenosis_quantities


def plane(cells, length=1.0):
    """A square of side `length`, cm, cut into 2·cells² triangles, as a region; and its nodes."""
    line = np.linspace(0.0, length, cells + 1)
    points = np.stack([*np.meshgrid(line, line, indexing="ij"), np.zeros((cells + 1, cells + 1))], axis=2)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3)
    points = points.reshape(-1, 3)
    return WallRegion.of(points, triangles, np.arange(len(points))), points


def test_the_area_quantile_weighs_nodes_by_area():
    values = np.array([[1.0], [2.0], [3.0]])
    assert area_quantile(values, np.array([1.0, 1.0, 98.0]), 0.5)[0] == pytest.approx(3.0, abs=0.03)
    assert area_quantile(values, np.array([98.0, 1.0, 1.0]), 0.49)[0] == pytest.approx(1.0)


@pytest.mark.parametrize("threshold", [-1.0, 0.13, 0.5, 0.875, 2.0])
def test_the_share_below_a_threshold_is_exact_for_a_linear_field(threshold):
    region, points = plane(8)
    expected = np.clip(threshold, 0.0, 1.0)
    assert region.share_below(points[:, :1], threshold)[0] == pytest.approx(expected, abs=1e-12)


def test_the_share_below_a_threshold_counts_every_sample_by_itself():
    region, points = plane(4)
    found = region.share_below(np.stack([points[:, 0], 1.0 - points[:, 0], points[:, 0] + 5.0], axis=1), 0.25)
    assert found == pytest.approx([0.25, 0.25, 0.0])


def test_a_patch_of_a_linear_field_has_the_value_at_its_centre():
    region, points = plane(10)
    averages = region.patches @ points
    assert np.allclose(region.patches.sum(axis=1), 1.0)
    lowest, highest = averages[:, 0].min(), averages[:, 0].max()
    assert 0.0 < lowest < PATCH / 2 and 1.0 - PATCH / 2 < highest < 1.0, "patches that the edge cuts are left out"


def test_a_patch_settles_where_a_minimum_does_not():
    """A dip of 0.2 mm: its deepest node depends on the mesh, its average over 1 mm hardly."""
    minima, patches = [], []
    for cells in (21, 29, 40, 58):
        region, points = plane(cells)
        dip = np.exp(-((points[:, :2] - [0.512, 0.487]) ** 2).sum(axis=1) / 0.02**2)[:, None]
        minima.append(float((1.0 - dip).min()))
        patches.append(float((region.patches @ (1.0 - dip)).min()))
    exact = 1.0 - 0.02**2 / (PATCH / 2) ** 2
    assert patches == pytest.approx([exact] * 4, abs=0.05)
    assert np.ptp(patches) < 0.25 * np.ptp(minima)


def test_a_region_keeps_the_rows_of_its_nodes():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [9, 9, 9]])
    region = WallRegion.of(points, np.array([[0, 1, 2], [1, 3, 2]]), np.array([7, 3, 5, 1, 0]))
    assert region.rows.tolist() == [1, 3, 5, 7]
    assert region.area == pytest.approx([1 / 6, 1 / 3, 1 / 3, 1 / 6])
    assert points[[3, 1, 2, 0]][region.triangles[0]].tolist() == points[[0, 1, 2]].tolist()


def test_quantities_of_a_uniform_wall():
    region, _ = plane(6)
    shear, one = np.full((len(region.rows), 2), [8.0, 12.0]), np.ones(2)
    found = stenosis_quantities("LAD", 0.8 * one, one, shear, 0.1 * shear, region, 10.0)
    for name in ("tawss_min", "tawss_q01", "tawss_mean", "tawss_patch_min"):
        assert found[f"{name}_lad"] == pytest.approx([8.0, 12.0])
    assert found["osi_patch_max_lad"] == pytest.approx([0.8, 1.2])
    assert found["low_shear_area_lad"] == pytest.approx([1.0, 0.0])


def test_the_pressure_drop_is_that_between_the_planes_where_there_are_two():
    region, _ = plane(6)
    shear, aortic = np.ones((len(region.rows), 2)), np.full(2, 100.0 * MMHG)
    given = "LAD", 0.8 * aortic, aortic, shear, shear, region, 10.0
    assert "pressure_drop_lad" not in stenosis_quantities(*given)
    found = stenosis_quantities(*given, np.array([0.85, 0.95]) * aortic)
    assert found["pressure_drop_lad"] == pytest.approx([5.0, 15.0])
