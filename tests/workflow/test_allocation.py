"""A campaign that grows: the checkpoint decides, and only what it asks for is run."""

import pytest

from support.checkout import Checkout

pytestmark = pytest.mark.workflow

# Round 0 asks for one batch and one chunk more, round 1 stops.
DECIDES = """
import json, pathlib
number = snakemake.params["number"]
counts = [{"n_3d": 16, "n_0d": 64}, {"n_3d": 24, "n_0d": 96}][number]
held = {"counts": counts, "next": {"n_3d": 24, "n_0d": 96}, "done": number == 1}
pathlib.Path(snakemake.output[0]).write_text(json.dumps(held))
"""


@pytest.fixture
def growing(tmp_path):
    checkout = Checkout(tmp_path / "grows")
    checkout.settings["estimation"] = {"target_half_width": {"ffr_ffr_lad": 0.001}, "max_3d": 64, "max_0d": 256}
    return checkout


def test_the_checkpoint_runs_rounds_until_it_is_done(growing):
    jobs = growing.dry_run()
    assert jobs["allocation"] == 1 and jobs["flow3d_batch"] == 2, "the first round is planned, no more is known yet"
    jobs = growing.pretend_done(own={"allocation": DECIDES})
    assert jobs["flow3d_batch"] == 3 and growing.dry_run() == {}
    batches = {path.name for path in (growing.folder / "results" / "tiny" / "flow3d").glob("batch_*")}
    assert batches == {"batch_0.jsonl", "batch_1.jsonl", "batch_2.jsonl"}
    rounds = {path.name for path in (growing.folder / "results" / "tiny" / "allocation").glob("*.json")}
    assert rounds == {"round_0.json", "round_1.json"}
