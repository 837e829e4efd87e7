"""Each pattern of noise has the statistics that its name says."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from coronaryuq.case.case_json import read_case
from coronaryuq.core.io.atomic import read_json
from coronaryuq.perfusion.realisations import NoiseStudy
from coronaryuq.perfusion.settings import DistanceNoise, FlowNoise, NoiseModel
from coronaryuq.perfusion.territories import Ventricle, distances_to_points, perfusing_outlets


def make_study(ventricle, models, **options):
    case, lv = ventricle
    centres = [outlet.point for outlet in perfusing_outlets(read_case(case), case)]
    wall = Ventricle.read(lv, 1.05)
    return NoiseStudy(wall, distances_to_points(wall.points, centres), models, 1.0, 7, **options)


def deviations(ventricle, realisations=400, **models):
    study = make_study(ventricle, models)
    flows = {name: [] for name in models}
    for k in range(realisations):
        for name, (flow, _) in study.flows(k).items():
            flows[name].append(flow)
    return {name: np.array(value) for name, value in flows.items()}, study


def test_one_factor_per_outlet_gives_its_deviation_and_no_correlation(ventricle):
    n = 2000
    flows, study = deviations(ventricle, n, x=NoiseModel(mbf=FlowNoise(outlet=0.2)))
    relative = flows["x"].std(axis=0, ddof=1) / flows["x"].mean(axis=0)
    assert np.all(np.abs(relative / 0.2 - 1) < 4.5 / np.sqrt(2 * n))
    correlation = np.corrcoef(flows["x"].T)[np.triu_indices(study.outlets, 1)]
    assert np.all(np.abs(correlation) < 4.5 / np.sqrt(n))


def test_one_factor_per_scan_moves_all_outlets_together(ventricle):
    flows, _ = deviations(ventricle, 300, x=NoiseModel(mbf=FlowNoise(scan=0.2)))
    assert np.allclose(np.corrcoef(flows["x"].T), 1)


def test_noise_per_point_averages_out_over_a_territory(ventricle):
    n = 1500
    flows, study = deviations(ventricle, n, x=NoiseModel(mbf=FlowNoise(independent=0.2)))
    points, weight = study.ventricle.points, study.ventricle.flows
    owner = cKDTree([o["point"] for o in read_json(ventricle[0])["outlets"][: study.outlets]]).query(points)[1]
    expected = 0.2 * np.sqrt(np.bincount(owner, weights=weight**2))
    assert np.all(np.abs(flows["x"].std(axis=0, ddof=1) / expected - 1) < 4.5 / np.sqrt(2 * n))
    assert np.all(expected < 0.02 * np.bincount(owner, weights=weight))


@pytest.mark.slow
def test_shared_borders_correlate_neighbours_negatively(ventricle):
    """Distance noise only moves tissue from one outlet to another: rows of the covariance add up to zero."""
    n = 800
    patterns = {
        kind: NoiseModel(distance=DistanceNoise(**{kind: 0.1})) for kind in ("independent", "correlated", "outlet")
    }
    flows, study = deviations(ventricle, n, **patterns)
    distance = np.sort(np.stack([np.linalg.norm(study.ventricle.points - o["point"], axis=1)
                                 for o in read_json(ventricle[0])["outlets"][: study.outlets]], 1), 1)  # fmt: skip
    assert np.all(distance[:, 0] > 0)
    for name, values in flows.items():
        covariance = np.cov(values.T)
        assert np.allclose(covariance.sum(axis=0), 0, atol=1e-10 * covariance.max()), name
        off = covariance[~np.eye(len(covariance), dtype=bool)].reshape(len(covariance), -1)
        assert np.all(off.min(axis=1) < 0), name


def test_leaving_out_unlikely_outlets_changes_no_flow(ventricle):
    models = {
        "independent": NoiseModel(distance=DistanceNoise(independent=0.1), mbf=FlowNoise(independent=0.2)),
        "correlated": NoiseModel(distance=DistanceNoise(correlated=0.1)),
        "outlet": NoiseModel(distance=DistanceNoise(outlet=0.1)),
    }
    short, full = make_study(ventricle, models), make_study(ventricle, models, sigmas=1e9)
    for some, every in zip(short.candidates.values(), full.candidates.values(), strict=True):
        assert len(some.outlet) < len(every.outlet)
    for k in range(5):
        a, b = short.flows(k), full.flows(k)
        for name in models:
            assert np.array_equal(a[name][0], b[name][0])
            assert np.array_equal(a[name][1], b[name][1])
