"""Territories follow the distance that the settings choose; an empty one is an error."""

import numpy as np
import pytest
import pyvista

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.perfusion import stage
from coronaryuq.perfusion.settings import Settings
from support.perfusion_stage import gathered


def test_an_outlet_of_larger_radius_reaches_farther(ventricle, tmp_path):
    plain = read_json(gathered(ventricle, tmp_path / "a", Settings(realisations=3)))
    reach = read_json(gathered(ventricle, tmp_path / "b", Settings(realisations=3, radius_power=1.0)))
    assert reach["volume"][-1] > plain["volume"][-1]
    assert reach["volume"][0] < plain["volume"][0]
    assert np.isclose(sum(reach["volume"]), sum(plain["volume"]))


def test_distances_to_centrelines_give_other_territories_of_the_same_total(ventricle, tmp_path):
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
    near = read_json(gathered(ventricle, tmp_path, Settings(realisations=2, distance_to="centreline")))
    far = read_json(gathered(ventricle, tmp_path, Settings(realisations=2)))
    assert np.isclose(sum(near["volume"]), sum(far["volume"]))
    assert not np.allclose(near["volume"], far["volume"], rtol=0.01)


def test_an_empty_territory_is_an_error_that_names_the_outlet(ventricle, tmp_path):
    case = read_json(ventricle[0])
    case["outlets"][2]["point"] = [400.0, 0.0, 0.0]
    write_json(ventricle[0], case)
    with pytest.raises(InputError, match=r"outlets\.out2 = .*territory is empty"):
        stage.run_chunk(*ventricle, Settings(), 1, 0, 1, tmp_path / "x.npz")
    assert not (tmp_path / "x.npz").exists()


def test_a_cell_without_a_finite_value_is_reported(ventricle, tmp_path):
    mesh = pyvista.read(ventricle[1])
    mesh["MBF"][3] = np.nan
    mesh.save(ventricle[1])
    with pytest.raises(InputError, match=r"MBF\[3\]"):
        stage.run_chunk(*ventricle, Settings(), 1, 0, 1, tmp_path / "x.npz")
