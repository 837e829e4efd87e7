"""One sound example of everything that a campaign reads, small; the tests spoil copies of it."""

import zipfile
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.case.stage import prepare_case
from coronaryuq.core import records
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.perfusion.settings import Settings as PerfusionSettings
from coronaryuq.perfusion.stage import run_chunk
from support.case_files import small_tree, write_case

BEDS = ("BC_lca1", "BC_lca2", "BC_rca1")
PERFUSION = PerfusionSettings(realisations=20)


def write_image(path: Path) -> None:
    import SimpleITK as sitk

    values = np.zeros((8, 8, 8), np.float32)
    values[2:6, 2:6, 2:6] = 2.0
    image = sitk.GetImageFromArray(values)
    image.SetSpacing((10.0, 10.0, 10.0))
    sitk.WriteImage(image, str(path))


def write_open_loop(folder: Path) -> None:
    """A vessel with a resistance behind it, two conditions, and its flow in both."""
    vessel = {"R_poiseuille": 100.0, "C": 1e-6, "L": 1.0, "stenosis_coefficient": 0.0}
    flow = {"bc_name": "INFLOW", "bc_type": "FLOW", "bc_values": {"t": [0, 0.5, 1.0], "Q": [1.0, 2.0, 1.0]}}
    end = {"bc_name": "OUT", "bc_type": "RESISTANCE", "bc_values": {"R": 1000.0, "Pd": 0.0}}
    write_json(
        folder / "model.json",
        {
            "simulation_parameters": {
                "number_of_cardiac_cycles": 2,
                "number_of_time_pts_per_cardiac_cycle": 20,
            },
            "vessels": [
                {
                    "vessel_id": 0, "vessel_name": "lad", "vessel_length": 1.0,
                    "boundary_conditions": {"inlet": "INFLOW", "outlet": "OUT"},
                    "zero_d_element_type": "BloodVessel", "zero_d_element_values": vessel,
                }
            ],
            "boundary_conditions": [flow, end],
            "junctions": [],
        },
    )  # fmt: skip
    (folder / "conditions.yaml").write_text("rest:\nstress: {scale: {OUT: {R: 0.5}}}\n")
    rows = [
        {"condition": c, "quantity": "flow", "location": "lad:OUT", "statistic": "mean", "time": np.nan,
         "value": 1.5, "sd": 0.1, "unit": "mL/s"}
        for c in ("rest", "stress")
    ]  # fmt: skip
    write_csv(folder / "measurements.csv", pd.DataFrame(rows))
    pulled = pd.DataFrame({"condition": "stress", "quantity": "pressure", "location": "lad", "statistic": "mean",
                           "value": [70.0, 80.0, 90.0], "sd": 1.5, "unit": "mmHg", "distance": [10.0, 5.0, 0.0],
                           "distance_unit": "mm"})  # fmt: skip
    write_csv(folder / "pullback.csv", pulled)


def write_runs(folder: Path) -> None:
    random = np.random.default_rng(1)
    for name, count in (("pilot", 6), ("propagation", 8)):
        theta = pd.DataFrame({"sample": [f"{name}_{k:05d}" for k in range(count)]})
        for column in (*BEDS, "R_cor_scaling"):
            theta[column] = random.uniform(0.7, 1.25, count)
        write_csv(folder / f"{name}.csv", theta)
        runs = pd.DataFrame({"sample": theta["sample"], "status": "ok", "reason": "", "cpu_s": 0.5})
        runs["mean_flow:lca1:BC_lca1"] = runs["ffr_lad"] = theta["BC_lca1"]
        runs.to_parquet(folder / f"{name}_0.parquet")
        if name == "pilot":
            outputs = [{"ffr_lad": x, "osi_max_lad": x, "tawss_min_lad": x} for x in theta["BC_lca1"]]
            inputs = theta.drop(columns="sample").to_dict("records")
            found = [records.Record(s, i, o) for s, i, o in zip(theta["sample"], inputs, outputs, strict=True)]
            records.write(folder / "batch_0.jsonl", found)


def write_sound_inputs(folder: Path) -> None:
    write_case(folder, small_tree())
    prepare_case(folder / "case.yaml", CaseSettings(), folder / "case")
    run_chunk(folder / "case/case.json", folder / "case/lv.vtu", PERFUSION, 1, 0, 20, folder / "chunk_0.npz")
    (folder / "campaign.yaml").write_text("name: mine\nseed: 3\nsamples: {n_3d: 16}\n")
    write_image(folder / "mbf.nii.gz")
    write_open_loop(folder)
    write_runs(folder)
    draws = pd.DataFrame({"chain": [0, 1], "generation": [1, 1], "log_density": [-1.0, -2.0]})
    write_csv(folder / "draws.csv", draws.assign(**dict.fromkeys(BEDS, [1.0, 1.1])))
    with zipfile.ZipFile(folder / "mesh-complete.zip", "w") as packed:
        packed.writestr("mesh-complete/mesh-complete.mesh.vtu", "none")
