"""VMTK's centrelines of a surface beside our own, and read by us as a file of another program."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.centreline_files import read_centrelines
from coronaryuq.case.anatomy.surface import surface_of
from support.surface_trees import random_tree, recovered, resistance, topology
from support.tubes import tube_surface

HERE = Path(__file__).parents[2]
PYTHON = HERE / ".vmtk/bin/python"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not PYTHON.exists(),
        reason="needs VMTK: python3.12 -m venv .vmtk && .vmtk/bin/pip install -r envs/vmtk.txt",
    ),
]
RADIUS = "MaximumInscribedSphereRadius"


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The tree that we find, and the file of VMTK's lines to the same ends."""
    folder = tmp_path_factory.mktemp("vmtk")
    tree = random_tree(1, 4)
    surface = surface_of(*tube_surface(tree, 0.045))
    found = recovered(tree, surface)
    surface.polydata().save(folder / "surface.vtp")
    seeds = {
        "source": found.root.points[0].tolist(),
        "targets": [leaf.points[-1].tolist() for leaf in found.leaves()],
        "step": 0.02,
    }
    (folder / "seeds.json").write_text(json.dumps(seeds))
    files = [str(folder / name) for name in ("surface.vtp", "seeds.json", "lines.vtp")]
    subprocess.run([PYTHON, HERE / "tests/support/vmtk_lines.py", *files], check=True, capture_output=True)
    return found, folder / "lines.vtp"


def test_centrelines_and_radii_agree_away_from_branchings(both):
    found, file = both
    lines = pv.read(file)
    for number, vessel in enumerate(found.leaves()):
        if vessel.branch == "aorta":
            continue  # too short to be away from its branching
        cell = lines.get_cell(number)
        radii = lines[RADIUS][cell.point_ids]
        inner = (vessel.arc > 3 * vessel.radii[0]) & (vessel.arc < vessel.length - 2 * vessel.radii[-1])
        assert inner.sum() > 3
        for point, radius in zip(vessel.points[inner], vessel.radii[inner], strict=True):
            distance = np.linalg.norm(cell.points - point, axis=1)
            assert distance.min() < 0.2 * radius
            assert radius == pytest.approx(radii[np.argmin(distance)], rel=0.08)


def test_the_file_of_vmtk_becomes_the_same_tree(both):
    found, file = both
    read, _ = read_centrelines(file)
    ends = {leaf.name: leaf.points[-1] for leaf in found.leaves()}
    nearest = {
        leaf.name: min(ends, key=lambda name: float(np.linalg.norm(ends[name] - leaf.points[-1])))
        for leaf in read.leaves()
    }
    assert sorted(nearest.values()) == sorted(ends)
    assert {frozenset(nearest[name] for name in part) for part in topology(read)} == topology(found)
    for leaf in read.leaves():
        own = found[nearest[leaf.name]]
        if own.branch == "aorta":
            continue
        theirs = resistance(read.path(leaf.name)[1:], 0.8)
        assert theirs == pytest.approx(resistance(found.path(own.name)[1:], 0.8), rel=0.05)
