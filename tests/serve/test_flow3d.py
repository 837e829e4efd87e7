"""A campaign whose 3D runs are another campaign's served 3D model: the same numbers as without a server between."""

import pandas as pd
import pytest

from coronaryuq.core import records
from coronaryuq.core.io.atomic import read_json, write_json, write_text
from coronaryuq.flow3d.adapter import Outputs
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.stage import run_batch
from support.served import served
from support.sv_case import batch_of, make_case

pytest.importorskip("umbridge", reason="needs umbridge, which is not installed")
pytestmark = pytest.mark.slow

SOLVER = {"steps_per_cycle": 100, "max_cycles": 2, "ramp_cycles": 0.1, "wall_samples_per_cycle": 20, "tolerance": 0.1}
CAMPAIGN = f"name: tube\ncase: given/case.yaml\nflow3d: {SOLVER}\n"
LOOP = "losses/hyperaemia_3d.json"


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """`results/tube`: a stenosed tube in a closed loop, tuned and meshed, with two draws of its posterior."""
    home = tmp_path_factory.mktemp("tube") / "results" / "tube"
    home.mkdir(parents=True)
    make_case(home)
    for part in ("case", "calibration", "posterior"):
        (home / part).mkdir()
    (home / "case.json").rename(home / "case" / "case.json")
    (home / "tree.vtp").rename(home / "case" / "tree.vtp")
    # The loop of 0D runs, which 3D taught its losses, is not that of 3D runs.
    network = read_json(home / "network.json")
    network["vessels"][0]["zero_d_element_values"]["R_poiseuille"] *= 3.0
    write_json(home / "calibration" / "hyperaemia.json", network)
    (home / "losses").mkdir()
    (home / "network.json").rename(home / LOOP)
    write_text(home / "posterior" / "draws.csv", "chain,generation,BC_LAD,log_density\n0,0,1.0,0.0\n1,0,1.2,0.0\n")
    write_text(home / "campaign.yaml", CAMPAIGN)
    return home


def test_served_3d_runs_are_those_of_the_campaign(home, tmp_path):
    theta = pd.DataFrame({"sample": ["a", "b", "c"], "BC_LAD": [1.0, 1.4, 0.8], "R_cor_scaling": [1.0, 0.9, 1.1]})
    theta.to_csv(tmp_path / "samples.csv", index=False)
    files = {"case": home / "case" / "case.json", "network": home / LOOP}
    batch = batch_of(home, tmp_path / "samples.csv", 3)
    batch = type(batch)(**vars(batch) | files)
    own, remote = (Outputs(tmp_path / f"{name}.jsonl", tmp_path / name) for name in ("own", "remote"))
    run_batch(batch, "ensemble", Settings(**SOLVER), own)
    with served(home) as (url, lines):
        assert any(line.startswith("flow3d: 2 inputs, 14 outputs, up to 8 at once") for line in lines)
        run_batch(batch, "umbridge", Settings(umbridge={"url": url}), remote)
    for mine, theirs in zip(records.read(own.records), records.read(remote.records), strict=True):
        assert mine.ok and theirs.ok, (mine.reason, theirs.reason)
        assert theirs.outputs == {name: mine.outputs[name] for name in theirs.outputs}
        assert {"ffr_lad", "tawss_min_lad", "osi_max_lad", "aortic_pressure"} < set(theirs.outputs)
