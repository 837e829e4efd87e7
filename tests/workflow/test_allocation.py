"""A campaign that grows: the checkpoint decides, and only what it asks for is run."""

import json

import pytest

from support.checkout import Checkout

pytestmark = pytest.mark.workflow

# Round 0 asks for one batch and one chunk more, round 1 for longer chains and two chunks of them, round 2 stops.
DECIDES = """
import json, pathlib
number = snakemake.params["number"]
first, twice = [[0, 1]], [[0, 1], [96, 2]]
counts = [(16, 64, first), (24, 96, first), (24, 160, twice), (24, 160, twice)][number:]
ran, following = (dict(zip(("n_3d", "n_0d", "lengths"), one)) for one in counts[:2])
held = {"counts": ran, "next": following, "done": number == 2}
pathlib.Path(snakemake.output[0]).write_text(json.dumps(held))
"""

NAMES_CHAINS = """
import json, pathlib
given = getattr(snakemake.input, "draws_csv", None) or snakemake.input.chains_npz
written = [given, snakemake.params.get("lengths")]
for output in snakemake.output:
    pathlib.Path(output).write_text(json.dumps(written))
"""
"""In place of a job: writes the chains that it was given, and their lengths."""


@pytest.fixture
def growing(tmp_path):
    checkout = Checkout(tmp_path / "grows")
    checkout.settings["estimation"] = {"target_half_width": {"ffr_ffr_lad": 0.001}, "max_3d": 64, "max_0d": 256}
    return checkout


@pytest.mark.long
def test_the_checkpoint_runs_rounds_until_it_is_done(growing):
    jobs = growing.dry_run()
    assert jobs["allocation"] == 1 and jobs["flow3d_batch"] == 2, "the first round is planned, no more is known yet"
    jobs = growing.pretend_done(own={"allocation": DECIDES})
    assert jobs["flow3d_batch"] == 3 and growing.dry_run() == {}
    batches = {path.name for path in (growing.folder / "results" / "tiny" / "flow3d").glob("batch_*")}
    assert batches == {"batch_0.jsonl", "batch_1.jsonl", "batch_2.jsonl"}
    rounds = {path.name for path in (growing.folder / "results" / "tiny" / "allocation").glob("*.json")}
    assert rounds == {"round_0.json", "round_1.json", "round_2.json"}


@pytest.mark.long
def test_longer_chains_serve_new_propagation_samples_and_change_no_others(growing):
    home = growing.folder / "results" / "tiny"
    own = dict.fromkeys(("zerod_chunk", "flow3d_batch", "samples", "posterior"), NAMES_CHAINS)
    jobs = growing.pretend_done(own=own | {"allocation": DECIDES})
    assert jobs["posterior_chains"] == 2 * 2, "two lengths, two ranks each"
    assert jobs["posterior_draws"] == 2 and jobs["posterior"] == 1
    assert jobs["zerod_chunk"] == 1 + 5 and jobs["flow3d_batch"] == 3, "no run is made again"
    of_length = "results/tiny/posterior/length_{}/draws.csv"

    def written(path):
        return json.loads((home / path).read_text())

    for k in range(5):
        length, lengths = (1, [[0, 1]]) if k < 3 else (2, [[0, 1], [96, 2]])
        assert written(f"zerod/propagation_{k}.parquet") == [of_length.format(length), lengths]
    assert written("zerod/pilot_0.parquet")[0] == written("flow3d/batch_2.jsonl")[0] == of_length.format(1)
    assert written("samples/pilot.csv")[0] == of_length.format(1)
    assert written("samples/propagation.csv")[0] == of_length.format(2)
    assert written("posterior/summary.json")[0] == "results/tiny/posterior/length_2/chains.npz"
    assert growing.dry_run() == {}
