"""Chunks are gathered into target flows and their covariance; wrong chunks are errors."""

import numpy as np
import pytest
import pyvista
from scipy.spatial import cKDTree

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.perfusion import stage
from coronaryuq.perfusion.settings import Settings
from support.perfusion_stage import gathered


def test_flows_without_noise_are_mbf_integrated_over_territories(ventricle, tmp_path):
    targets = read_json(gathered(ventricle, tmp_path, Settings(realisations=5)))
    mesh = pyvista.read(ventricle[1])
    outlets = [o for o in read_json(ventricle[0])["outlets"] if o["perfuses"] == "LV"]
    owner = cKDTree([o["point"] for o in outlets]).query(mesh.cell_centers().points)[1]
    weight = mesh["MBF"] * mesh["Volume"] * 1.05
    assert targets["outlets"] == [o["name"] for o in outlets]
    assert np.allclose(targets["mean"], np.bincount(owner, weights=weight), rtol=1e-12)
    assert np.allclose(targets["volume"], np.bincount(owner, weights=mesh["Volume"]), rtol=1e-12)
    assert np.isclose(sum(targets["mean"]), targets["lv"]["flow"])


def test_chunks_do_not_change_a_bit(ventricle, tmp_path):
    settings = Settings(realisations=12)
    one_chunk = gathered(ventricle, tmp_path, settings)
    three_chunks = gathered(ventricle, tmp_path / "three", settings, chunks=((0, 5), (5, 1), (6, 6)))
    assert one_chunk.read_bytes() == three_chunks.read_bytes()


def test_the_covariance_has_the_branch_deviation_of_the_paper(ventricle, tmp_path):
    targets = read_json(gathered(ventricle, tmp_path, Settings(realisations=60)))
    covariance = np.array(targets["covariance"])
    assert np.allclose(np.sqrt(np.diag(covariance)), 0.2 * np.array(targets["mean"]), rtol=1e-12)
    used = targets["models"][targets["use"]]
    deviation = np.sqrt(np.diag(covariance))
    assert np.allclose(covariance / np.outer(deviation, deviation), used["correlation"])
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_without_a_branch_deviation_the_simulated_covariance_is_kept(ventricle, tmp_path):
    targets = read_json(gathered(ventricle, tmp_path, Settings(realisations=20, branch_sd=None, mean="realisations")))
    used = targets["models"][targets["use"]]
    assert targets["covariance"] == used["covariance"]
    assert targets["mean"] == used["mean"]


def test_a_missing_chunk_and_one_of_another_seed_are_errors(ventricle, tmp_path):
    settings = Settings(realisations=6)
    for first in (0, 4):
        stage.run_chunk(*ventricle, settings, 1, first, 2, tmp_path / f"{first}.npz")
    with pytest.raises(InputError, match="expected realisation 2"):
        stage.gather([tmp_path / "0.npz", tmp_path / "4.npz"], *ventricle, settings, tmp_path / "t.json")
    stage.run_chunk(*ventricle, settings, 2, 2, 2, tmp_path / "2.npz")
    with pytest.raises(InputError, match="different seeds"):
        stage.gather([tmp_path / f"{i}.npz" for i in (0, 2, 4)], *ventricle, settings, tmp_path / "t.json")
