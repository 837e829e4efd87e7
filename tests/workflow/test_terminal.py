"""`coronaryuq run`, `status` and `compare` as a user sees them: progress, an interruption, results at the end."""

import os
import re
import signal
import subprocess
import sys
import time

import pytest

from coronaryuq.cli.compare import differences
from coronaryuq.cli.status import running
from coronaryuq.core.io.atomic import read_json
from support.case_files import small_tree, write_case

pytestmark = pytest.mark.workflow
COMMAND = [sys.executable, "-m", "coronaryuq.cli.main"]


@pytest.fixture
def folder(tmp_path):
    """A small campaign: up to the perfusion targets a case, four chunks of realisations, and what sums them up."""
    write_case(tmp_path / "given", small_tree())
    (tmp_path / "mine.yaml").write_text(
        "name: mine\ncase: given/case.yaml\nsamples: {chunk_realisations: 10}\nperfusion: {realisations: 40}\n"
    )
    return tmp_path


def coronaryuq(folder, *words):
    return subprocess.run([*COMMAND, *words], cwd=folder, capture_output=True, text=True, timeout=900)


def notes(folder):
    return list(folder.glob("results/mine/provenance/*.json"))


def started(folder, jobs, interrupts):
    """A campaign of which so many jobs have ended; interrupts: SIG_DFL, or SIG_IGN as in the background of a shell."""
    words = [*COMMAND, "run", "mine.yaml", "results/mine/perfusion/targets.json", "--cores", "1"]
    process = subprocess.Popen(
        words, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, interrupts),
    )  # fmt: skip
    until = time.monotonic() + 300
    while len(notes(folder)) < jobs and process.poll() is None and time.monotonic() < until:
        time.sleep(0.05)
    return process


@pytest.mark.slow
def test_a_campaign_that_is_killed_ends_its_jobs_and_says_what_it_keeps(folder):
    process = started(folder, 1, signal.SIG_IGN)
    process.terminate()
    told = process.communicate(timeout=120)[1]
    assert process.returncode == 128 + signal.SIGTERM and "Traceback" not in told, told
    assert re.search(r"\d+ of \d+ steps are there; start it again to go on", told)
    assert not running(folder / "results" / "mine")


@pytest.mark.long
def test_an_interrupted_campaign_says_what_it_keeps_and_goes_on(folder):
    process = started(folder, 2, signal.SIG_DFL)
    os.killpg(process.pid, signal.SIGINT)
    told = process.communicate(timeout=120)[1]
    assert process.returncode == 130 and "Traceback" not in told, told
    there, every = map(int, re.search(r"(\d+) of (\d+) steps are there; start it again to go on", told).groups())
    assert 1 <= there < every  # Snakemake removes the files of the job that it ended
    status = coronaryuq(folder, "status", "results/mine")
    assert status.returncode == 0 and re.match(r"\d+ of \d+ steps are there; the rest takes about", status.stdout)
    again = coronaryuq(folder, "run", "mine.yaml", "results/mine/perfusion/targets.json", "--cores", "1")
    assert again.returncode == 0, again.stderr
    assert re.search(r"^\d+ of \d+ steps are there; the rest takes about", again.stderr, re.M)
    lines = again.stderr.splitlines()
    assert lines[0].startswith("Runs: snakemake --snakefile ") and len(lines) < 20
    assert not re.search(r"eligible for caching|Building DAG|X server|Traceback", again.stderr)
    assert re.search(r"(\d+) of \1 steps, 100 % of the work", again.stderr) or "100 %" not in lines[-1]


@pytest.mark.slow
def test_an_error_is_shown_without_the_rest(folder):
    (folder / "wrong.yaml").write_text("name: mine\nsamples: {n_3d: -4}\n")
    done = coronaryuq(folder, "run", "wrong.yaml")
    assert done.returncode == 2 and "n_3d" in done.stderr and done.stderr.count("\n") == 1


def test_a_finished_campaign_tells_its_results(results):
    home = results.parents[1]
    told = coronaryuq(home, "status", "results/smoke")
    assert told.returncode == 0, told.stderr
    lines = told.stdout.splitlines()
    assert lines[-1] == "Report: results/smoke/report.html"
    rows = {row["row"]: row for row in read_json(results / "estimation" / "estimates.json")["rows"]}
    row = min((rows["ffr_ffr_lad"], rows["ffr_flow_lad"]), key=lambda one: one["estimators"][one["recommended"]]["std"])
    low, median, high = (row["beyond_the_mean"]["predictive"][q] for q in ("0.05", "0.50", "0.95"))
    assert lines[-4].startswith(f"LAD: FFR {median:.2f} ({low:.2f} to {high:.2f}, 90 % range), P(FFR ≤ 0.80) ")
    below = row["beyond_the_mean"]["zones"][-1]
    ends = f"({100 - 100 * below['high']:.0f} to {100 - 100 * below['low']:.0f} %)"
    assert lines[-4].endswith(ends)
    same = coronaryuq(home, "compare", "results/smoke", "results/smoke")
    assert same.returncode == 0 and same.stdout.count(": +0.000 ± ") == 3
    assert same.stdout.count(", 0.0 standard errors") == 3


def test_settings_that_differ_are_listed(tmp_path):
    (tmp_path / "a.yaml").write_text("name: a\nsamples: {n_3d: 16, n_0d: 200}\nseed: 1\n")
    (tmp_path / "b.yaml").write_text("name: b\nsamples: {n_3d: 32, n_0d: 200}\n")
    assert differences(tmp_path / "a.yaml", tmp_path / "b.yaml") == [("samples.n_3d", 16, 32), ("seed", 1, None)]
    assert differences(tmp_path / "a.yaml", tmp_path / "none.yaml") == []
