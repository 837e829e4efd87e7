"""The stage: territories add up, noise does what its name says, chunks do not matter."""

import json

import numpy as np
import pytest
import pyvista
from scipy.spatial import cKDTree

from coronaryuq.case.case_json import read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.perfusion import stage
from coronaryuq.perfusion.realisations import Study
from coronaryuq.perfusion.settings import DistanceNoise, FlowNoise, NoiseModel, Settings
from coronaryuq.perfusion.territories import Ventricle, distances_to_points, perfusing_outlets


def run(ventricle, folder, settings, seed=5, chunks=((0, None),)):
    case, lv = ventricle
    paths = []
    for first, count in chunks:
        count = settings.realisations - first if count is None else count
        paths.append(folder / f"chunk_{first}.npz")
        stage.run_chunk(case, lv, settings, seed, first, count, paths[-1])
    out = folder / "targets.json"
    stage.gather(paths[::-1], case, lv, settings, out)
    return out


def study(ventricle, models, **options):
    case, lv = ventricle
    centres = [outlet.point for outlet in perfusing_outlets(read_case(case), case)]
    wall = Ventricle.read(lv, 1.05)
    return Study(wall, distances_to_points(wall.points, centres), models, 1.0, 7, **options)


def test_baseline_flows_are_mbf_over_territories(ventricle, tmp_path):
    targets = read_json(run(ventricle, tmp_path, Settings(realisations=5)))
    mesh = pyvista.read(ventricle[1])
    outlets = [o for o in read_json(ventricle[0])["outlets"] if o["perfuses"] == "LV"]
    owner = cKDTree([o["point"] for o in outlets]).query(mesh.cell_centers().points)[1]
    weight = mesh["MBF"] * mesh["Volume"] * 1.05
    assert targets["outlets"] == [o["name"] for o in outlets]
    assert np.allclose(targets["mean"], np.bincount(owner, weights=weight), rtol=1e-12)
    assert np.allclose(targets["volume"], np.bincount(owner, weights=mesh["Volume"]), rtol=1e-12)
    assert np.isclose(sum(targets["mean"]), targets["lv"]["flow"])


def test_results_do_not_depend_on_chunks_to_the_bit(ventricle, tmp_path):
    settings = Settings(realisations=12)
    one = run(ventricle, tmp_path, settings)
    many_folder = tmp_path / "many"
    many = run(ventricle, many_folder, settings, chunks=((0, 5), (5, 1), (6, 6)))
    assert one.read_bytes() == many.read_bytes()


def test_used_covariance_has_the_papers_branch_deviation(ventricle, tmp_path):
    targets = read_json(run(ventricle, tmp_path, Settings(realisations=60)))
    covariance = np.array(targets["covariance"])
    assert np.allclose(np.sqrt(np.diag(covariance)), 0.2 * np.array(targets["mean"]), rtol=1e-12)
    used = targets["models"][targets["use"]]
    deviation = np.sqrt(np.diag(covariance))
    assert np.allclose(covariance / np.outer(deviation, deviation), used["correlation"])
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_simulated_covariance_when_asked(ventricle, tmp_path):
    targets = read_json(run(ventricle, tmp_path, Settings(realisations=20, branch_sd=None, mean="realisations")))
    used = targets["models"][targets["use"]]
    assert targets["covariance"] == used["covariance"]
    assert targets["mean"] == used["mean"]


def deviations(ventricle, realisations=400, **models):
    work = study(ventricle, models)
    flows = {name: [] for name in models}
    for k in range(realisations):
        for name, (flow, _) in work.flows(k).items():
            flows[name].append(flow)
    return {name: np.array(value) for name, value in flows.items()}, work


def test_factor_per_outlet_gives_its_own_deviation_and_no_correlation(ventricle):
    n = 2000
    flows, work = deviations(ventricle, n, x=NoiseModel(mbf=FlowNoise(outlet=0.2)))
    relative = flows["x"].std(axis=0, ddof=1) / flows["x"].mean(axis=0)
    assert np.all(np.abs(relative / 0.2 - 1) < 4.5 / np.sqrt(2 * n))
    correlation = np.corrcoef(flows["x"].T)[np.triu_indices(work.outlets, 1)]
    assert np.all(np.abs(correlation) < 4.5 / np.sqrt(n))


def test_factor_per_scan_moves_all_outlets_together(ventricle):
    flows, _ = deviations(ventricle, 300, x=NoiseModel(mbf=FlowNoise(scan=0.2)))
    assert np.allclose(np.corrcoef(flows["x"].T), 1)


def test_independent_noise_averages_out_as_the_sum_rule_says(ventricle):
    n = 1500
    flows, work = deviations(ventricle, n, x=NoiseModel(mbf=FlowNoise(independent=0.2)))
    points, weight = work.ventricle.points, work.ventricle.flows
    owner = cKDTree([o["point"] for o in read_json(ventricle[0])["outlets"][: work.outlets]]).query(points)[1]
    expected = 0.2 * np.sqrt(np.bincount(owner, weights=weight**2))
    assert np.all(np.abs(flows["x"].std(axis=0, ddof=1) / expected - 1) < 4.5 / np.sqrt(2 * n))
    assert np.all(expected < 0.02 * np.bincount(owner, weights=weight))


def test_shared_borders_correlate_neighbours_negatively(ventricle):
    """Distance noise only moves tissue from one outlet to another: rows of the covariance add up to zero."""
    n = 800
    patterns = {
        kind: NoiseModel(distance=DistanceNoise(**{kind: 0.1})) for kind in ("independent", "correlated", "outlet")
    }
    flows, work = deviations(ventricle, n, **patterns)
    distance = np.sort(np.stack([np.linalg.norm(work.ventricle.points - o["point"], axis=1)
                                 for o in read_json(ventricle[0])["outlets"][: work.outlets]], 1), 1)  # fmt: skip
    assert np.all(distance[:, 0] > 0)
    for name, values in flows.items():
        covariance = np.cov(values.T)
        assert np.allclose(covariance.sum(axis=0), 0, atol=1e-10 * covariance.max()), name
        off = covariance[~np.eye(len(covariance), dtype=bool)].reshape(len(covariance), -1)
        assert np.all(off.min(axis=1) < 0), name


def test_leaving_out_hopeless_outlets_changes_nothing(ventricle):
    model = {
        "independent": NoiseModel(distance=DistanceNoise(independent=0.1), mbf=FlowNoise(independent=0.2)),
        "correlated": NoiseModel(distance=DistanceNoise(correlated=0.1)),
        "outlet": NoiseModel(distance=DistanceNoise(outlet=0.1)),
    }
    fast, whole = study(ventricle, model), study(ventricle, model, sigmas=1e9)
    for few, all_of_them in zip(fast.candidates.values(), whole.candidates.values(), strict=True):
        assert len(few.outlet) < len(all_of_them.outlet)
    for k in range(5):
        a, b = fast.flows(k), whole.flows(k)
        for name in model:
            assert np.array_equal(a[name][0], b[name][0])
            assert np.array_equal(a[name][1], b[name][1])


def test_larger_radius_reaches_further(ventricle, tmp_path):
    plain = read_json(run(ventricle, tmp_path / "a", Settings(realisations=3)))
    reach = read_json(run(ventricle, tmp_path / "b", Settings(realisations=3, radius_power=1.0)))
    assert reach["volume"][-1] > plain["volume"][-1]
    assert reach["volume"][0] < plain["volume"][0]
    assert np.isclose(sum(reach["volume"]), sum(plain["volume"]))


def test_distance_to_centrelines(ventricle, tmp_path):
    case = read_json(ventricle[0])
    lines = pyvista.merge([
        pyvista.lines_from_points([[0, 0, 0.5], outlet["point"]])
        for outlet in case["outlets"] if outlet["perfuses"] == "LV"
    ], merge_points=False)  # fmt: skip
    tree = pyvista.PolyData(
        lines.points, lines=lines.cells if isinstance(lines, pyvista.UnstructuredGrid) else lines.lines
    )
    tree.cell_data["VesselName"] = [o["vessel"] for o in case["outlets"] if o["perfuses"] == "LV"]
    tree.save(tmp_path / "tree.vtp")
    near = read_json(run(ventricle, tmp_path, Settings(realisations=2, distance_to="centreline")))
    far = read_json(run(ventricle, tmp_path, Settings(realisations=2)))
    assert np.isclose(sum(near["volume"]), sum(far["volume"]))
    assert not np.allclose(near["volume"], far["volume"], rtol=0.01)


def test_empty_territory_names_the_outlet(ventricle, tmp_path):
    case = read_json(ventricle[0])
    case["outlets"][2]["point"] = [400.0, 0.0, 0.0]
    write_json(ventricle[0], case)
    with pytest.raises(InputError, match=r"outlets\.out2 = .*territory is empty"):
        stage.run_chunk(*ventricle, Settings(), 1, 0, 1, tmp_path / "x.npz")
    assert not (tmp_path / "x.npz").exists()


def test_missing_and_foreign_chunks_are_named(ventricle, tmp_path):
    settings = Settings(realisations=6)
    for first in (0, 4):
        stage.run_chunk(*ventricle, settings, 1, first, 2, tmp_path / f"{first}.npz")
    with pytest.raises(InputError, match="wanted realisation 2"):
        stage.gather([tmp_path / "0.npz", tmp_path / "4.npz"], *ventricle, settings, tmp_path / "t.json")
    stage.run_chunk(*ventricle, settings, 2, 2, 2, tmp_path / "2.npz")
    with pytest.raises(InputError, match="different seeds"):
        stage.gather([tmp_path / f"{i}.npz" for i in (0, 2, 4)], *ventricle, settings, tmp_path / "t.json")


def test_bad_lv_is_named(ventricle, tmp_path):
    mesh = pyvista.read(ventricle[1])
    mesh["MBF"][3] = np.nan
    mesh.save(ventricle[1])
    with pytest.raises(InputError, match=r"MBF\[3\]"):
        stage.run_chunk(*ventricle, Settings(), 1, 0, 1, tmp_path / "x.npz")


def test_unknown_model_is_refused():
    with pytest.raises(ValueError, match="not among the models"):
        Settings(use="absent")
    assert json.loads(Settings().model_dump_json())["use"] == "outlet"
