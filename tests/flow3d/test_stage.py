"""The rule function on a small closed loop: mesh folder, table of θ and network in, records and fields out."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import pyvista as pv

from coronaryuq.case.anatomy.tree import Stenosis, Tree, Vessel
from coronaryuq.case.network.build import Bed, network_from_tree, segments
from coronaryuq.case.network.network import UNCERTAIN
from coronaryuq.core import records
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.units import MMHG
from coronaryuq.flow3d.adapter import Batch, Outputs
from coronaryuq.flow3d.mesh.coupling.cap_connections import downstream_block, upstream_block
from coronaryuq.flow3d.mesh.generation import folder
from coronaryuq.flow3d.mesh.generation.quality import boundary
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.stage import run_batch
from coronaryuq.flow3d.verification.tube import tube
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
from support.case_files import write_case_json

SETTINGS = Settings(steps_per_cycle=300, min_cycles=3, max_cycles=3, wall_samples_per_cycle=50)


def loop():
    """Aorta and one artery with a stenosis: tree, stenosis, network."""
    line = np.linspace(0, 1, 41)[:, None]
    radii = np.where(np.abs(line[:, 0] - 0.5) < 0.15, 0.09, 0.16)
    tree = Tree(
        [
            Vessel("aorta", 2.0 * line * [0, 0, 1.0], np.full(41, 1.2), None, "aorta"),
            Vessel("lca1", [0, 0, 2.0] + 5.0 * line * [1.0, 0, 0], radii, "aorta", "LAD"),
            Vessel("aorta_outlet", [0, 0, 2.0] + 2.0 * line * [0, 0, 1.0], np.full(41, 1.2), "aorta", "aorta"),
        ]
    )
    stenosis = Stenosis("LAD", "lca1", 1.7, 3.3)
    network = network_from_tree(tree, [Bed("BC_lca1", "lca1", False)], {"BC_RCR1": "aorta_outlet"}, [stenosis])
    return tree, stenosis, network


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Folder with everything that the stage reads."""
    here = tmp_path_factory.mktemp("flow3d")
    tree, stenosis, network = loop()
    part = next(p for p in segments(tree, [stenosis]) if p.stenosis).name
    length = 1.6

    def radius(z):
        return 0.16 - 0.06 * np.exp(-(((z - 0.8) / 0.2) ** 2))

    points, tets, faces = tube(length, radius, 3, 24)
    triangles, owner = boundary(tets)
    height = points[triangles][:, :, 2]
    face = np.where((height == 0).all(axis=1), 2, np.where((height == length).all(axis=1), 3, 1))
    region = ((face == 1) & (np.abs(height.mean(axis=1) - 0.9) < 0.5)).astype(int)
    names = {1: "wall", 2: "inlet", 3: "outlet"}
    folder.write(here / "mesh-complete", folder.Mesh(points, tets, triangles, owner, face, names, region))
    upstream, downstream = upstream_block(network, part), downstream_block(network, part)
    caps = [("inlet", upstream, part, "in"), ("outlet", part, downstream, "out")]
    write_json(
        here / "mesh.json",
        {
            "nodes": len(points),
            "faces": [{"name": "wall", "kind": "wall"}]
            + [
                {"name": name, "kind": "cap", "couples": {"upstream": a, "downstream": b, "flow": way}}
                for name, a, b, way in caps
            ],
            "replaces": [part],
            "cut": {},
            "regions": {"LAD": {"id": 1}},
            "planes": {"LAD": {"point": [0.0, 0.0, 1.4], "normal": [0.0, 0.0, 1.0]}},
            "proximal_planes": {"LAD": {"point": [0.0, 0.0, 0.2], "normal": [0.0, 0.0, 1.0]}},
        },
    )
    write_json(here / "network.json", network)
    aorta = next(name for name in Engine(network).unknowns if name.startswith("pressure:J_heart_outlet:"))
    write_case_json(here / "case.json", aorta={"pressure": aorta.split(":", 1)[1]}, stenoses=[{}])
    table = {"sample": ["a", "b", "c"], "BC_lca1": [0.7, 1.0, 1.5], "R_cor_scaling": [0.9, 1.0, 1.1]}
    write_csv(here / "samples.csv", pd.DataFrame(table))
    return here


def run(here, first, count, settings=SETTINGS, fields=None, table="samples.csv"):
    out = here / f"batch_{first}_{count}.jsonl"
    batch = Batch(
        *(here / "case.json", here / "network.json", here / "mesh-complete", here / "mesh.json"),
        *(here / table, first, count),
    )
    run_batch(batch, "ensemble", settings, Outputs(out, here / "checkpoints", fields))
    return records.read(out)


@pytest.fixture(scope="module")
def rows(campaign):
    return run(campaign, 0, 3, fields=campaign / "fields")


def test_every_sample_has_a_record_with_all_outputs(rows):
    assert [row.sample for row in rows] == ["a", "b", "c"]
    for row in rows:
        assert row.ok and row.solver["name"] == "ensemble" and "monolithic" in row.solver["coupling"]
        for name in ("ffr", "tawss_min", "osi_max", "tawss_q01", "osi_q99", "osi_patch_max"):
            assert np.isfinite(row.outputs[f"{name}_lad"])
        assert row.outputs["tawss_min_lad"] <= row.outputs["tawss_patch_min_lad"] <= row.outputs["tawss_mean_lad"]
        assert 0.0 <= row.outputs["low_shear_area_lad"] <= 1.0
        assert {"cfl", "mass_balance", "backflow_steps", "cycles", "change"} <= set(row.diagnostics)
        assert row.diagnostics["mass_balance"] < 1e-6


@pytest.mark.slow
def test_a_record_keeps_the_quantities_of_the_cycles_before_the_last(campaign, rows):
    (short,) = run(campaign, 0, 1, SETTINGS.model_copy(update={"min_cycles": 2, "max_cycles": 2}))
    earlier = rows[0].diagnostics["earlier_cycles"]
    assert len(earlier["ffr_lad"]) == rows[0].cost["cycles"] - 1 == 2
    assert short.diagnostics["earlier_cycles"] == {name: [first] for name, (first, _) in earlier.items()}
    assert {name: short.outputs[name] for name in earlier} == {name: second for name, (_, second) in earlier.items()}


def test_the_pressure_drop_is_what_is_lost_between_the_planes(rows):
    """The mesh has caps 2 mm ahead of one plane and beyond the other, so that the drop between these is larger."""
    for row in rows:
        caps = [row.outputs[name] for name in row.outputs if name.startswith("mean_pressure:")]
        behind = caps[0] - row.outputs["distal_pressure_lad"]
        assert 0.9 * behind < MMHG * row.outputs["pressure_drop_lad"] < behind < 1.1 * (caps[0] - caps[1])


def test_the_lowest_ffr_of_an_artery_is_at_its_end(campaign, rows):
    """Behind the mesh the artery goes on in 0D, whose loss is that of its part there."""
    network = read_network(campaign / "network.json")
    for row in rows:
        outlet = next(name for name in row.outputs if name.startswith("mean_pressure:lca1_seg1:"))
        lost = network.vessel_values("lca1")["R_poiseuille"] * row.outputs[outlet.replace("pressure", "flow")]
        end = (row.outputs[outlet] - lost) / row.outputs["aortic_pressure"]
        assert row.outputs["lowest_ffr_lad"] == pytest.approx(end, rel=1e-3) and end < row.outputs["ffr_lad"]


def test_more_resistance_means_less_flow_and_more_pressure_behind_the_stenosis(rows):
    ffr = [row.outputs["ffr_lad"] for row in rows]
    shear = [row.outputs["tawss_mean_lad"] for row in rows]
    assert 0.5 < ffr[0] < ffr[1] < ffr[2] < 1.0
    assert shear[0] > shear[1] > shear[2] > 0


@pytest.mark.slow
def test_numbers_do_not_depend_on_the_batch_in_a_closed_loop(campaign, rows):
    (alone,) = run(campaign, 2, 1)
    assert alone.outputs == rows[2].outputs


def test_fields_of_the_first_sample_are_kept(campaign, rows):
    wall, lumen = pv.read(campaign / "fields" / "a_wall.vtp"), pv.read(campaign / "fields" / "a.vtu")
    region = np.abs(np.asarray(wall.points)[:, 2] - 0.9) < 0.4
    assert np.asarray(wall["TAWSS"])[region].min() >= rows[0].outputs["tawss_min_lad"]
    assert np.isfinite(lumen["mean_pressure"]).all()
    assert len(list((campaign / "fields").iterdir())) == 2


def test_a_failed_sample_gives_a_record(campaign):
    (row,) = run(campaign, 0, 1, SETTINGS.model_copy(update={"speed_limit": 1.0, "refinements": 0}))
    assert not row.ok and not row.outputs and "diverged" in row.reason


def test_an_unknown_column_is_rejected(campaign):
    write_csv(campaign / "wrong.csv", pd.DataFrame({"sample": ["a"], "BC_other": [1.0]}))
    with pytest.raises(InputError, match="BC_other"):
        run(campaign, 0, 1, table="wrong.csv")


def test_a_table_with_too_few_rows_is_rejected(campaign):
    with pytest.raises(InputError, match="at least 5 rows"):
        run(campaign, 2, 3)


@pytest.mark.slow
def test_blocks_over_mpi_ranks_give_the_same_numbers(campaign, tmp_path):
    """Nine samples are two blocks: one on each of two ranks, and the second rank's is a block that is not full."""
    multipliers = np.linspace(0.7, 1.5, 9)
    table = {"sample": [f"s{k}" for k in range(9)], "BC_lca1": multipliers, "R_cor_scaling": 1.0}
    write_csv(campaign / "nine.csv", pd.DataFrame(table))
    settings = SETTINGS.model_copy(update={"steps_per_cycle": 150, "max_cycles": 2})
    alone = run(campaign, 0, 9, settings, table="nine.csv")
    mpiexec = Path(sys.executable).with_name("mpiexec")
    if not mpiexec.exists():
        pytest.skip("needs mpiexec beside python")
    mesh = tmp_path / "mesh"
    mesh.mkdir()
    for name in ("mesh-complete", "mesh.json"):
        (mesh / name).symlink_to(campaign / name)
    given = (campaign / "case.json", campaign / "network.json", mesh, campaign / "nine.csv", tmp_path / "records.jsonl")
    command = [mpiexec, "-n", "2", sys.executable, "-m", "coronaryuq.flow3d", *given, "--mpi"]
    subprocess.run([*map(str, command), "--settings", settings.model_dump_json()], check=True, timeout=300)
    shared = records.read(tmp_path / "records.jsonl")
    assert [row.sample for row in shared] == [f"s{k}" for k in range(9)]
    assert [row.outputs for row in shared] == [row.outputs for row in alone]
    assert len(list((tmp_path / "fields").iterdir())) == 2


@pytest.mark.slow
def test_an_uncertain_parameter_of_the_loop_reaches_both_sides(campaign, tmp_path):
    """A factor on the bed's resistance by a parameter of the network is one by its multiplier, to the bit."""
    network = read_network(campaign / "network.json")
    targets = {f"BC_lca1.{name}": 1.0 for name in ("Ra", "Ram", "Rv")}
    entry = {"name": "bed", "distribution": "lognormal", "centre": 2.0, "spread": 0.1, "kind": "factor"}
    network[UNCERTAIN] = [entry | {"targets": targets}, entry | {"name": "idle", "targets": {}}]
    write_json(tmp_path / "network.json", network)
    records_of = []
    for theta in ({"BC_lca1": [1.25, 0.5]}, {"bed": [2.5, 1.0], "idle": [2.0, 3.0]}):
        write_csv(tmp_path / "samples.csv", pd.DataFrame({"sample": ["a", "b"], "R_cor_scaling": [1.0, 1.0], **theta}))
        batch = Batch(
            campaign / "case.json", tmp_path / "network.json", campaign / "mesh-complete", campaign / "mesh.json",
            tmp_path / "samples.csv", 0, 2,
        )  # fmt: skip
        run_batch(batch, "ensemble", SETTINGS, Outputs(tmp_path / "out.jsonl", tmp_path / "checkpoints"))
        records_of.append(records.read(tmp_path / "out.jsonl"))
    for one, other in zip(*records_of, strict=True):
        assert one.ok and one.outputs == other.outputs and one.inputs != other.inputs
