"""Progress counts steps by the time that they take."""

import numpy as np
import pytest

from coronaryuq.campaign import progress
from coronaryuq.campaign.progress import Progress, Step, duration, kept, planned
from coronaryuq.core.io.atomic import write_json

DRY_RUN = """
Job stats:
job             count
flow3d_batch        2

[Thu Nov 26 06:37:50 2026]
rule flow3d_batch:
    input: results/x/mesh/mesh.json
    output: results/x/flow3d/batch_0.jsonl, results/x/costs/flow3d/batch_0.json
    log: results/x/logs/flow3d/batch_0.log
    jobid: 7
    wildcards: run=flow3d, k=0
    resources: tmpdir=<TBD>

checkpoint allocation:
    output: results/x/allocation/round_0.json
    wildcards: r=0

localrule all:
    input: results/x/report.html
    jobid: 0
"""


def test_the_plan_is_read_from_a_dry_run():
    assert planned(DRY_RUN) == [
        Step(
            "flow3d_batch", "flow3d_batch flow3d 0",
            ("results/x/flow3d/batch_0.jsonl", "results/x/costs/flow3d/batch_0.json"),
        ),
        Step("allocation", "allocation 0", ("results/x/allocation/round_0.json",)),
    ]  # fmt: skip
    assert planned("Nothing to be done (all requested files are present and up to date).") == []


@pytest.fixture
def running(tmp_path):
    """Two batches and a figure remain; two other steps, and an outdated figure, have notes."""
    home = tmp_path / "results" / "x"
    for job in ("case", "mesh-mesh", "figure-a"):
        write_json(home / "provenance" / f"{job}.json", {"resources": {"wall_s": 1.0}})
    steps = [Step("flow3d_batch", f"flow3d_batch flow3d {k}", (f"results/x/batch_{k}.jsonl",)) for k in range(2)]
    steps.append(Step("figure", "figure a", ("results/x/a.png",)))
    return Progress(home, steps, cores=2, folder=tmp_path)


def finish(running, name, seconds):
    (step,) = (step for step in running.steps if step.name == name)
    (running.folder / step.outputs[0]).write_text("")
    write_json(running.home / "provenance" / f"{name.replace(' ', '-')}.json", {"resources": {"wall_s": seconds}})
    running.look()


def test_a_step_counts_with_the_time_that_its_rule_takes_here(running):
    assert running.counts == (2, 5) and running.fraction == 0.0
    usual = progress.SECONDS
    assert running.left == pytest.approx((2 * usual["flow3d_batch"] + usual["figure"]) / 2)
    finish(running, "flow3d_batch flow3d 0", 300.0)
    assert running.counts == (3, 5)
    assert running.fraction == pytest.approx(300 / (600 + usual["figure"]))
    finish(running, "figure a", 10.0)
    finish(running, "flow3d_batch flow3d 1", 320.0)
    assert running.counts == (5, 5) and running.fraction == 1.0 and running.left == 0.0


def test_the_time_left_follows_from_the_work_done_so_far(running):
    running.started -= 600
    (running.folder / "results/x/batch_0.jsonl").touch()
    finish(running, "flow3d_batch flow3d 0", 300.0)  # half a second of work per second
    assert running.left == pytest.approx((300 + progress.SECONDS["figure"]) / 0.5, rel=0.01)
    assert running.line() == "3 of 5 steps, 50 % of the work, about 10 min left"


def test_a_step_whose_files_were_removed_is_not_there(running):
    finish(running, "figure a", 10.0)
    (running.folder / "results/x/a.png").unlink()
    running.recount()
    assert running.counts == (2, 5)


def test_a_file_from_before_the_start_is_no_progress(running):
    path = running.folder / running.steps[0].outputs[0]
    path.write_text("")
    running.started += 3600
    running.look()
    assert running.counts == (2, 5)


@pytest.mark.parametrize(
    ("seconds", "words"), [(2, "5 s"), (38, "40 s"), (110, "2 min"), (5340, "89 min"), (7500, "2 h 5 min")]
)
def test_durations_have_the_digits_of_an_estimate(seconds, words):
    assert duration(seconds) == words


def test_what_was_kept_of_a_killed_campaign_is_told(tmp_path):
    folder = tmp_path / "flow3d" / "checkpoints"
    folder.mkdir(parents=True)
    np.savez(folder / "batch_1_0_0.npz", cycle=2)
    (folder / "torn.npz").write_bytes(b"PK")
    (tmp_path / "posterior" / "length_1" / "chains").mkdir(parents=True)
    (tmp_path / "posterior" / "length_1" / "chains" / "chain_0.npz").write_bytes(b"")
    assert kept(tmp_path) == ["3D batch 1 goes on after cycle 2", "posterior chains (length_1) go on"]
    assert kept(tmp_path / "elsewhere") == []
