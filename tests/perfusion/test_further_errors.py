"""Calibration, registration and rules of territories: exact where flows are known, absent in the paper's setting."""

import json

import numpy as np
import pytest
import pyvista as pv
from hypothesis import given
from hypothesis import strategies as st

from coronaryuq.case.description.routine import RoutineErrors
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.perfusion.further_errors import SHIFTS, further_errors
from coronaryuq.perfusion.settings import Settings
from coronaryuq.perfusion.targets import PerfusionTargets, of_borders, read_perfusion_targets, supplied, without_borders
from coronaryuq.perfusion.territories import Ventricle, distances_to_points
from support.perfusion_stage import gathered

RNG = np.random.default_rng(3)
POINTS = RNG.uniform(0.0, 4.0, (20_000, 3))
CENTRES = np.array([[1.0, 2.0, 2.0], [3.0, 2.0, 2.0]])
VENTRICLE = Ventricle(POINTS, np.full(len(POINTS), 64.0 / len(POINTS)), np.full(len(POINTS), 2.0 / len(POINTS)))
MEAN = np.array([1.0, 1.0])


def nearest(points):
    return distances_to_points(points, CENTRES)


def shifted_rule(points):
    """A rule whose border lies at 1.5 instead of 2 cm: three eighths of the flow to the first outlet."""
    return distances_to_points(points, CENTRES - [0.5, 0.0, 0.0])


def found(**errors):
    rules = {"outlet": nearest, "centreline": shifted_rule}
    none = {"mbf_calibration": 0.0, "registration": 0.0, "tissue_density": 0.0}
    return further_errors(VENTRICLE, [None, None], rules, MEAN, RoutineErrors(**none | errors), seed=1)


def test_calibration_is_one_factor_on_all_flows():
    further = found(mbf_calibration=0.3, tissue_density=0.4)
    np.testing.assert_allclose(further.covariances["calibration"], 0.25 * np.outer(further.mean, further.mean))
    assert np.array_equal(further.covariances["registration"], np.zeros((2, 2)))


def test_registration_moves_flow_across_the_border_as_geometry_says():
    """A shift by s moves the border by s: 0.5 mL/s per cm go from one territory to the other."""
    covariance = found(registration=2.0).covariances["registration"]
    sd = 0.5 * 0.2
    tolerance = 4 * sd**2 * np.sqrt(2 / (SHIFTS - 1)) + 0.05 * sd**2
    np.testing.assert_allclose(covariance, sd**2 * np.array([[1.0, -1.0], [-1.0, 1.0]]), atol=tolerance)
    assert np.array_equal(covariance, found(registration=2.0).covariances["registration"])


def test_rules_of_territories_are_a_choice_of_equal_weights():
    further = found()
    first, second = np.array([1.0, 1.0]), np.array([0.75, 1.25])
    assert further.weights == {"outlet": 0.5, "centreline": 0.5}
    np.testing.assert_allclose(further.mean, (first + second) / 2, rtol=0.03)
    half = (first - second) / 2
    np.testing.assert_allclose(further.covariances["territories"], np.outer(half, half), atol=0.005)


def test_a_table_of_flows_has_neither_borders_nor_a_map_to_register():
    table = Ventricle(CENTRES, np.ones(2), MEAN)
    further = further_errors(table, [None, None], {"outlet": nearest}, MEAN, RoutineErrors(), seed=1)
    assert np.array_equal(further.mean, MEAN)
    assert not further.covariances["registration"].any() and not further.covariances["territories"].any()


def test_the_stage_adds_them_with_full_uncertainty_only(ventricle, tmp_path):
    settings = Settings(realisations=20)
    plain = json.loads(gathered(ventricle, tmp_path, settings).read_text())
    assert plain["further"] == {} and plain["rules"] == {}
    content, folder = read_json(ventricle[0]), tmp_path / "full"
    folder.mkdir()
    write_json(folder / "case.json", content | {"errors": RoutineErrors(registration=0.0).model_dump()})
    ends = np.array([outlet["point"] for outlet in content["outlets"] if outlet["perfuses"] == "LV"])
    tree = pv.PolyData(np.concatenate([0.8 * ends, ends]), lines=[[2, k, k + len(ends)] for k in range(len(ends))])
    tree.cell_data["VesselName"] = [f"vessel{k}" for k in range(len(ends))]
    tree.save(folder / "tree.vtp")
    written = gathered((folder / "case.json", ventricle[1]), folder, settings)
    full = json.loads(written.read_text())
    assert full["rules"] == {"outlet": 0.5, "centreline": 0.5}
    added = sum(np.array(part) for part in full["further"].values())
    np.testing.assert_allclose(np.array(full["covariance"]) - added, plain["covariance"], rtol=1e-6, atol=1e-12)
    calibration = (0.1**2 + 0.01**2) * np.square(full["mean"]).sum()
    assert np.trace(full["further"]["calibration"]) == pytest.approx(calibration)
    # Flow per tissue is that of the map, whichever rule divides the wall.
    targets = read_perfusion_targets(written)
    half = np.sqrt(np.diag(full["further"]["territories"])) / targets.mean
    np.testing.assert_allclose(np.sqrt(np.diag(of_borders(targets))), half)
    calibrated = np.array(plain["covariance"]) + np.array(full["further"]["calibration"])
    np.testing.assert_allclose(without_borders(targets), calibrated, rtol=1e-6, atol=1e-12)
    nothing = targets.model_copy(update={"further": {"calibration": targets.further["calibration"]}})
    assert of_borders(nothing) is None and np.array_equal(without_borders(nothing), targets.covariance)
    flow_per_tissue = targets.mean / supplied(targets)
    assert np.allclose(flow_per_tissue, targets.baseline / targets.volume)
    assert not np.allclose(targets.mean, targets.baseline, rtol=0.01), "the rules differ"


def test_an_outlet_without_a_territory_of_the_own_rule_has_tissue_as_the_rest(ventricle, tmp_path):
    targets = read_perfusion_targets(gathered(ventricle, tmp_path, Settings(realisations=20)))
    none = np.arange(len(targets.mean)) == 0
    empty = {"volume": np.where(none, 0.0, targets.volume), "baseline": np.where(none, 0.0, targets.baseline)}
    found = supplied(targets.model_copy(update=empty))
    rest = targets.volume[1:].sum() / targets.baseline[1:].sum()
    assert found[0] == pytest.approx(rest * targets.mean[0])
    np.testing.assert_allclose(found[1:], supplied(targets)[1:])


@given(st.floats(1e-3, 5.0), st.floats(0.1, 2.0))
def test_no_flow_is_uncertain_by_more_than_itself(sd, flow):
    """Registration of a territory that is small beside the shift."""
    one = np.array([flow])
    targets = PerfusionTargets.model_construct(
        mean=one, baseline=one, covariance=np.array([[sd**2]]), further={"registration": np.array([[sd**2]])}
    )
    assert of_borders(targets)[0, 0] == pytest.approx(min(1.0, (sd / flow) ** 2))
