"""A stenosed tube in a closed loop, as a case for the SimVascular codes."""

from pathlib import Path

import numpy as np

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel, write_tree
from coronaryuq.case.network.build import Bed, network_from_tree
from coronaryuq.flow3d.adapter import Batch
from coronaryuq.flow3d.mesh.settings import Settings
from coronaryuq.flow3d.mesh.stage import mesh_tree
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase
from coronaryuq.flow3d.simvascular_settings import SimVascularSettings
from coronaryuq.zerod.network.read import write_network
from support.case_files import write_case_json


def make_case(folder: Path, **settings) -> CoupledCase:
    """An artery of 3 cm with half of its radius lost in the middle, off an aorta that has a Windkessel of its own."""
    arc = np.linspace(0.0, 3.0, 121)
    points = np.column_stack([np.zeros_like(arc), arc, np.zeros_like(arc)])
    inside = np.abs(arc - 1.5) < 0.4
    narrowed = 0.15 * (1.0 - 0.25 * (1.0 + np.cos(2.0 * np.pi * (arc - 1.5) / 0.8)) * inside)
    up = np.column_stack([np.zeros(5), np.zeros(5), np.linspace(-1.0, 0.0, 5)])
    tree = Tree(
        [
            Vessel("aorta", up, np.full(5, 0.3), None, "aorta"),
            Vessel("arch", up + [0.0, 0.0, 1.0], np.full(5, 0.3), "aorta", "aorta"),
            Vessel("LAD", points, narrowed, "aorta", "LAD"),
        ]
    )
    stenoses = [Stenosis("LAD", "LAD", 1.1, 1.9)]
    network = network_from_tree(tree, [Bed("BC_LAD", "LAD", right=False)], {"BC_RCR": "arch"}, stenoses)
    coarse = Settings(
        throat_resolution=2.0,
        resolution=1.5,
        core_resolution=0.0,
        wall_grading=0.0,
        axial_stretch=1.0,
        upstream_diameters=1.0,
        downstream_diameters=2.0,
    )
    write_tree(folder / "tree.vtp", tree)
    mesh_tree(tree, stenoses, network, coarse, folder / "mesh")
    write_network(folder / "network.json", network)
    outlets, stenosis = [{"name": "LAD"}], {"vessel": "LAD", "start": 1.1, "end": 1.9}
    write_case_json(folder / "case.json", name="tube", outlets=outlets, stenoses=[stenosis])
    given = {"steps_per_cycle": 100, "cycles": 1, "frames_per_cycle": 20} | settings
    batch = batch_of(folder, folder / "samples.csv", 0)
    return CoupledCase.of(batch.read_model(), batch.mesh_folder, SimVascularSettings(**given), low_shear=10.0)


def batch_of(folder: Path, samples: Path, count: int) -> Batch:
    """The first rows of a table of θ on the case that `make_case` wrote."""
    mesh = folder / "mesh"
    return Batch(
        folder / "case.json", folder / "network.json", mesh / "mesh-complete", mesh / "mesh.json", samples, 0, count
    )
