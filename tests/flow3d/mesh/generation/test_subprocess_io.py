"""What goes between processes comes back to the bit, and a file that was tampered with runs nothing."""

import json

import numpy as np
import pytest

from coronaryuq.case.anatomy.tree import Stenosis
from coronaryuq.flow3d.mesh.generation import subprocess_io
from coronaryuq.flow3d.mesh.generation.piece import ATTEMPTS
from coronaryuq.flow3d.mesh.geometry.implicit import Implicit, Path
from coronaryuq.flow3d.mesh.geometry.paths import Size
from coronaryuq.flow3d.mesh.settings import Settings


def test_a_job_is_read_back_to_the_bit(tmp_path):
    points = np.linspace([0, 0, 0], [0.1, 0.2, 3.0], 31)
    along = Path(points, np.linspace(0.2, 0.1, 31), np.array(["lca1"] * 31), np.linspace(0, 3, 31), 0.05)
    surface = Implicit([along])
    size = Size(surface, [Stenosis("LAD", "lca1", 1.0, 2.0)], Settings())
    given = {"implicit": surface, "size": size, "attempt": ATTEMPTS[1], "radius": np.float64(1 / 3), "ends": (1, [2])}
    subprocess_io.write(tmp_path / "job.npz", given)
    back = subprocess_io.read(tmp_path / "job.npz")
    at = np.random.default_rng(1).normal(size=(50, 3))
    assert np.array_equal(back["implicit"].distance(at), surface.distance(at))
    assert np.array_equal(back["size"](at), size(at))
    assert (back["attempt"], back["radius"], back["ends"]) == (ATTEMPTS[1], 1 / 3, (1, [2]))


def test_objects_of_other_packages_are_not_written(tmp_path):
    with pytest.raises(TypeError, match="without pickle"):
        subprocess_io.write(tmp_path / "job.npz", {"callback": print})


@pytest.mark.parametrize(
    "value",
    [
        {"object": ["subprocess", "Popen"], "state": {"dict": [["args", "true"]]}},
        {"object": ["coronaryuq.flow3d.mesh.generation.mmg_process", "subprocess"], "state": {"dict": []}},
        {"object": ["coronaryuq.flow3d.mesh.generation.mmg_process", "run"], "state": {"dict": []}},
    ],
)
def test_a_name_from_another_package_is_rejected(tmp_path, value):
    np.savez(tmp_path / "job.npz", parcel=np.array(json.dumps(value)))
    with pytest.raises(ValueError, match="is no class of coronaryuq"):
        subprocess_io.read(tmp_path / "job.npz")


def test_a_pickle_is_rejected(tmp_path):
    np.savez(tmp_path / "job.npz", parcel=np.array(json.dumps({"array": 0})), a0=np.array([{}], object))
    with pytest.raises(ValueError, match="allow_pickle=False"):
        subprocess_io.read(tmp_path / "job.npz")
