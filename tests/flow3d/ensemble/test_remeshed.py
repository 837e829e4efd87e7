"""A sample whose lumen the nodes cannot follow: on a mesh of its own, by the rule function, on a small closed loop."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel, write_tree
from coronaryuq.case.description.lumen import LumenError
from coronaryuq.case.lumen.law import lumen_law
from coronaryuq.case.lumen.profiles import with_lumen
from coronaryuq.case.network.along_tree import vessels_along
from coronaryuq.case.network.build import Bed, network_from_tree
from coronaryuq.core import records
from coronaryuq.core.io.tables import write_csv
from coronaryuq.flow3d.adapter import Batch, Outputs
from coronaryuq.flow3d.ensemble.ensemble import Ensemble
from coronaryuq.flow3d.mesh import remesh
from coronaryuq.flow3d.mesh.generation import folder
from coronaryuq.flow3d.mesh.generation.piece import WORST_DIHEDRAL
from coronaryuq.flow3d.mesh.geometry.errors import MeshError
from coronaryuq.flow3d.mesh.morph import morph
from coronaryuq.flow3d.mesh.settings import Settings as MeshSettings
from coronaryuq.flow3d.mesh.stage import mesh_tree
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase
from coronaryuq.flow3d.simvascular_settings import SimVascularSettings
from coronaryuq.flow3d.stage import run_batch
from coronaryuq.zerod.network.read import write_network
from coronaryuq.zerod.theta import theta_changes
from support.case_files import write_case_json

pytestmark = pytest.mark.slow

STENOSIS = Stenosis("LAD", "lca1", 2.3, 2.9)
ERROR = LumenError(unit="mm", common_sd=0.0, local_sd=0.15)
COARSE = MeshSettings(
    throat_resolution=2.5, resolution=1.6, jet_resolution=1.6, core_resolution=0.0, wall_grading=0.0,
    upstream_diameters=1.0, downstream_diameters=1.5, ffr_diameters=1.0, region_downstream_diameters=0.5,
)  # fmt: skip
RUNS = Settings(steps_per_cycle=200, min_cycles=2, max_cycles=2, wall_samples_per_cycle=50, fields=2)
STRICT = 90.0
"""Flattest angle that draws may have: so high that half of the mesh's own is asked for, which sample b has not."""
DRAWN = np.array([0.3, -3.0, -0.3])
"""Coordinate `lumen_LAD_1` of samples a, b and c; the throat of b has a third of the segmented radius."""


def tree() -> Tree:
    arc = np.linspace(0.0, 4.5, 226)
    bump = np.where(np.abs(arc - 2.6) < 0.3, 0.5 * (1.0 + np.cos(2.0 * np.pi * (arc - 2.6) / 0.6)), 0.0)
    line = np.linspace(0.0, 2.0, 41)[:, None]
    return Tree(
        [
            Vessel("aorta", line * [0, 0, 1.0], np.full(41, 1.2), None, "aorta"),
            Vessel("lca1", [0, 0, 2.0] + arc[:, None] * [1.0, 0, 0], 0.15 * (1 - 0.6 * bump), "aorta", "LAD"),
            Vessel("aorta_outlet", [0, 0, 2.0] + line * [0, 0, 1.0], np.full(41, 1.2), "aorta", "aorta"),
        ]
    )


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    """Folder with everything that the stage reads."""
    here, whole = tmp_path_factory.mktemp("remeshed"), tree()
    network = network_from_tree(whole, [Bed("BC_lca1", "lca1", False)], {"BC_RCR1": "aorta_outlet"}, [STENOSIS])
    law = lumen_law(whole, [STENOSIS], ERROR)
    write_network(here / "network.json", with_lumen(network, whole, vessels_along(whole, [STENOSIS], network), law))
    mesh_tree(whole, [STENOSIS], network, COARSE, here)
    write_tree(here / "tree.vtp", whole)
    aorta = next(v["vessel_name"] for v in network.vessels)
    write_case_json(
        here / "case.json", stenoses=[{"start": STENOSIS.start, "end": STENOSIS.end}],
        aorta={"pressure": f"J_heart_outlet:{aorta}"},
    )  # fmt: skip
    table = {"sample": ["a", "b", "c"], "BC_lca1": [0.8, 1.0, 1.2], "R_cor_scaling": [1.0, 1.0, 1.0]}
    table |= {name: np.zeros(3) for name in law.names}
    table["lumen_LAD_1"] = DRAWN
    write_csv(here / "samples.csv", pd.DataFrame(table))
    return here


def batch(here: Path, first: int, count: int) -> Batch:
    return Batch(
        here / "case.json", here / "network.json", here / "mesh-complete", here / "mesh.json",
        here / "samples.csv", first, count, here / "tree.vtp",
    )  # fmt: skip


def run(here: Path, first: int, count: int, fields: Path | None = None) -> list[records.Record]:
    out = here / f"batch_{first}_{count}.jsonl"
    run_batch(batch(here, first, count), "ensemble", RUNS, Outputs(out, here / "checkpoints", fields))
    return records.read(out)


@pytest.fixture(scope="module")
def moved(here):
    """Records of the samples with the nodes moved: the usual bound accepts all of them."""
    return run(here, 0, 3)


@pytest.fixture(scope="module")
def strict():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(morph, "FLATTEST", STRICT)
        yield


@pytest.fixture(scope="module")
def rows(here, moved, strict):
    return run(here, 0, 3, here / "fields")


@pytest.mark.long
def test_the_record_says_why_the_lumen_was_meshed_anew_and_how_well(rows, moved):
    assert all(row.ok for row in rows)
    assert ["remeshed_because" in row.diagnostics["lumen"] for row in rows] == [False, True, False]
    lumen = rows[1].diagnostics["lumen"]
    assert "flattens" in lumen["remeshed_because"] and lumen["dihedral_min"] > WORST_DIHEDRAL
    assert lumen["volume"] == pytest.approx(moved[1].diagnostics["lumen"]["volume"], rel=0.03)


def test_samples_whose_nodes_can_be_moved_keep_their_bits(rows, moved):
    for k in (0, 2):
        assert rows[k].outputs == moved[k].outputs
        assert rows[k].diagnostics["lumen"] == moved[k].diagnostics["lumen"]


def test_a_lumen_meshed_anew_gives_what_moved_nodes_give_up_to_the_meshs_error(rows, moved):
    """Flat facets on a throat of R/h add (h/R)²/4 to its resistance in either mesh; flow and FFR fall in proportion."""
    error = np.sqrt(2.0) * 0.25 * COARSE.throat_resolution**-2
    anew, same = rows[1].outputs, moved[1].outputs
    assert set(anew) == set(same)
    for name in ("ffr_lad", "distal_pressure_lad", "pressure_drop_lad", "aortic_pressure"):
        assert anew[name] == pytest.approx(same[name], rel=error)
    for name in same:
        if name.startswith(("mean_flow:", "mean_pressure:")):
            assert anew[name] == pytest.approx(same[name], rel=error)
    assert moved[0].outputs["ffr_lad"] > 2.0 * same["ffr_lad"]  # of the wider lumen beside it


@pytest.mark.long
def test_a_sample_meshed_anew_does_not_depend_on_its_batch(here, rows):
    (alone,) = run(here, 1, 1)
    assert alone.outputs == rows[1].outputs
    assert [row.outputs for row in run(here, 1, 2)] == [row.outputs for row in rows[1:]]


def test_its_pictures_are_on_its_own_mesh(here, rows):
    shared, own = (pv.read(here / "fields" / f"{name}.vtu") for name in "ab")
    assert shared.n_points != own.n_points
    assert own.compute_cell_sizes()["Volume"].sum() == pytest.approx(rows[1].diagnostics["lumen"]["volume"])
    assert np.isfinite(own["mean_velocity"]).all()


@pytest.mark.long
def test_a_stopped_sample_on_its_own_mesh_goes_on_from_its_checkpoint(here, rows, tmp_path):
    def stop(block, share):
        if block.cycle == 1:
            raise KeyboardInterrupt

    model = batch(here, 1, 1).read_model()
    (sample,) = batch(here, 1, 1).read_samples(model.network)
    theta = {name: np.array([value]) for name, value in sample.theta.items()}
    changes = theta_changes(model.network, theta)

    def go(report):
        shapes = model.shapes(theta, 1)
        return Ensemble(model, RUNS).run(changes, 1, checkpoint=tmp_path / "batch", report=report, shapes=shapes)

    with pytest.raises(KeyboardInterrupt):
        go(stop)
    cycles = []
    (outcome,) = go(lambda block, share: cycles.append(block.cycle))
    assert min(cycles) == 1
    assert outcome.values == rows[1].outputs


def test_simvascular_gets_the_mesh_made_anew(here, strict, tmp_path):
    model = batch(here, 1, 1).read_model()
    (sample,) = batch(here, 1, 1).read_samples(model.network)
    case = CoupledCase.of(model, here / "mesh-complete", SimVascularSettings(), 4.0).drawn(sample, tmp_path / "mesh")
    written = folder.read(tmp_path / "mesh")
    assert len(written.points) == len(case.domain.points) != len(model.domain.points)
    assert case.domain.caps.keys() == model.domain.caps.keys() == set(written.caps.values())


def test_where_meshing_anew_fails_too_the_record_has_both_reasons(here, strict, monkeypatch, tmp_path):
    def fail(*_):
        raise MeshError("piece lca1 could not be meshed")

    monkeypatch.setattr(remesh, "build_kept", fail)
    run_batch(batch(here, 1, 1), "ensemble", RUNS, Outputs(tmp_path / "out.jsonl", tmp_path))
    (row,) = records.read(tmp_path / "out.jsonl")
    assert not row.ok
    assert "flattens" in row.reason and "piece lca1 could not be meshed" in row.reason
