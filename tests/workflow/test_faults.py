"""Faults of machines and people: the campaign ends with the same bytes as one that nothing happened to.

Results are compared as files; notes, logs and measured costs tell of times and machines and are left out. The campaign
is a small one, up to the perfusion targets, or where it says so up to 0D runs of the posterior's draws; every fault is
a real one (signals, a file system that is full or read-only, a shifted clock), none is put into the code.
"""

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from coronaryuq.campaign import explain
from support.checkout import Checkout, jobs_at_work

pytestmark = pytest.mark.workflow

SMALL = {
    "name": "small",
    "case": "given/case.yaml",
    "samples": {"n_3d": 8, "n_0d": 16, "chunk_0d": 8, "chunk_realisations": 20},
    "perfusion": {"realisations": 40},
}
PATIENT = SMALL | {
    "case": "bundled",
    "synthetic": {"cells": 3000},
    "losses": {"runs_3d": 0},
    "calibration": {"candidates": 4, "starts": 1, "rounds": 1, "evaluations_per_parameter": 2, "final_nelder_mead": 0},
    "posterior": {"dream": {"chains": 12, "generations": 400}, "independence": {"draws": 30}, "checkpoint": 20},
}
FIRST = ("results/small/perfusion/targets.json",)
WHOLE = ("results/small/posterior/summary.json", "results/small/zerod/pilot_0.parquet")
PROFILE = ("--profile", "workflow/profiles/default", "--cores", "2")
APART = ("logs", "costs", "provenance", "chains")


class Campaign(Checkout):
    """A small campaign in a folder of its own, started as a user starts it."""

    def __init__(self, folder: Path, targets: tuple[str, ...], cache: Path | None = None):
        super().__init__(folder, cache)
        self.small_case()
        self.settings, self.targets = SMALL if targets == FIRST else PATIENT, targets

    def go(self, *arguments: str, fake_clock: str | None = None) -> subprocess.CompletedProcess:
        if fake_clock is None:
            return self.run(*PROFILE, *arguments, "--", *self.targets)
        return self._with_clock(subprocess.run, arguments, fake_clock, capture_output=True, timeout=1200)

    def start(self, *arguments: str) -> subprocess.Popen:
        """Start it in a process group of its own, so that all of it can be killed at once."""
        out = open(self.folder / "out.log", "w")  # noqa: SIM115
        return self._with_clock(subprocess.Popen, arguments, None, stdout=out, stderr=out, start_new_session=True)

    def _with_clock(self, call, arguments, fake_clock, **more):
        given = self.command(*PROFILE, *arguments, "--", *self.targets)
        if fake_clock:
            given["args"] = ["faketime", "-f", fake_clock, *given["args"]]
            # A clock that is set leaves the monotonic one alone, on which programs wait.
            given["env"] |= {"FAKETIME_DONT_FAKE_MONOTONIC": "1", "DONT_FAKE_MONOTONIC": "1"}
        return call(**given, **more)

    def results(self) -> dict[str, bytes]:
        home = self.folder / "results" / "small"
        paths = [p for p in home.rglob("*") if p.is_file() and not set(APART) & set(p.relative_to(home).parts)]
        return {p.relative_to(home).as_posix(): content(p) for p in paths if p.name != ".lock"}

    def said(self) -> str:
        return (self.folder / "out.log").read_text()

    def verify(self, *arguments: str) -> subprocess.CompletedProcess:
        command = [sys.executable, "-m", "coronaryuq.cli.main", "verify", "results/small", *arguments]
        given = self.command() | {"args": command}
        return subprocess.run(**given, capture_output=True)


def content(path: Path) -> bytes:
    """A file's bytes; of a table of runs, all but what they have cost, which is measured anew every time."""
    if path.suffix == ".parquet":
        return pd.read_parquet(path).drop(columns="cpu_s").to_csv(index=False).encode()
    return path.read_bytes()


def ended(done: subprocess.CompletedProcess) -> None:
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


def jobs_of(process: subprocess.Popen) -> list[int]:
    """Processes that the campaign has started, itself left out, the youngest last."""
    listed = subprocess.run(["ps", "-o", "pid=", "-s", str(process.pid)], capture_output=True, text=True).stdout.split()
    return sorted(int(pid) for pid in listed if int(pid) != process.pid)


def running(process: subprocess.Popen, word: str) -> list[int]:
    """Those of its processes whose command line holds a word."""
    found = []
    for pid in jobs_of(process):
        with contextlib.suppress(OSError):
            if word.encode() in Path(f"/proc/{pid}/cmdline").read_bytes():
                found.append(pid)
    return found


def wait_for(true, seconds: float = 300.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.05)


def kill_all(process: subprocess.Popen) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@contextlib.contextmanager
def mounted(folder: Path, size: str):
    """A small file system of its own in a folder; gives a function that changes its options."""
    folder.mkdir(exist_ok=True)
    tried = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", str(folder)], capture_output=True)
    if tried.returncode:
        pytest.skip("needs the right to mount a small file system")
    try:
        yield lambda options: subprocess.run(["mount", "-o", f"remount,{options}", str(folder)], check=True)
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Results up to the perfusion targets of a campaign that nothing happened to."""
    campaign = Campaign(tmp_path_factory.mktemp("short"), FIRST)
    ended(campaign.go())
    return campaign.results()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    campaign = Campaign(tmp_path_factory.mktemp("undisturbed"), WHOLE)
    ended(campaign.go())
    return campaign


@pytest.mark.long
def test_two_campaigns_on_one_folder_and_a_kill(short, tmp_path):
    """The second refuses while the first lives; when the first is killed the second goes on, without `--unlock`."""
    campaign = Campaign(tmp_path, FIRST)
    first = campaign.start()
    try:
        wait_for(lambda: running(first, ".snakemake/scripts") or first.poll() is not None)
        second = campaign.go()
        assert second.returncode == 2 and second.stderr.count("error:") == 1
        line = second.stderr.strip().splitlines()[-1]
        assert "results/small: another campaign is running here (process" in line and str(first.pid) in line
    finally:
        kill_all(first)
    ended(campaign.go())
    assert campaign.results() == short


@pytest.mark.long
@pytest.mark.parametrize("whole_group", [False, True], ids=["snakemake", "everything"])
def test_killed_at_random_moments(short, tmp_path, whole_group):
    """Ten times each: Snakemake alone, its jobs living on as orphans, or all of it at once."""
    campaign = Campaign(tmp_path, FIRST)
    moment = random.Random(7 + whole_group)
    kills = 0
    for _ in range(10):
        process = campaign.start()
        wait_for(lambda process=process: "Job stats" in campaign.said() or process.poll() is not None)
        time.sleep(moment.uniform(0.0, 8.0))
        if process.poll() is not None:  # this one came through: once more from the start
            shutil.rmtree(tmp_path / "results")
            continue
        if whole_group:
            kill_all(process)
        else:
            process.kill()
            process.wait()
        kills += 1
    ended(campaign.go())
    assert kills >= 5
    assert campaign.results() == short


@pytest.mark.long
@pytest.mark.parametrize("script", ["zerod_chunk", "posterior_chains"])
def test_a_killed_job_or_rank_is_run_again(undisturbed, tmp_path, script):
    """One job, or one MPI rank of the chains; its retry mends it within the same campaign."""
    campaign = Campaign(tmp_path, WHOLE)
    process = campaign.start("--retries", "1")
    wait_for(lambda: jobs_at_work(tmp_path, script) or process.poll() is not None, 600)
    time.sleep(1.0)
    os.kill(jobs_at_work(tmp_path, script)[-1], signal.SIGKILL)
    assert process.wait(900) == 0, campaign.said()[-3000:]
    assert "Trying to restart job" in campaign.said()
    assert campaign.results() == undisturbed.results()


@pytest.mark.long
def test_a_full_disk(short, tmp_path):
    """The campaign stops and says why; with room again it goes on to the same bytes."""
    with mounted(tmp_path / "results", "60k") as remount:
        campaign = Campaign(tmp_path, FIRST)
        done = campaign.go()
        assert done.returncode != 0
        assert "No space left on device" in done.stdout + done.stderr
        assert not list((tmp_path / "results").rglob(".*.part*"))
        remount("size=100m")
        ended(campaign.go())
        assert campaign.results() == short


@pytest.mark.long
@pytest.mark.parametrize("clock", ["+400d", "-400d"])
def test_a_jump_of_the_clock(short, tmp_path, clock):
    """Set back, it leaves results from the future, which the next run notices; behind its inputs, no job can end."""
    if shutil.which("faketime") is None:
        pytest.skip("needs Debian's faketime")
    campaign = Campaign(tmp_path, FIRST)
    campaign.targets = ("results/small/perfusion/chunk_0.npz",)
    first = campaign.go(fake_clock=clock)
    campaign.targets = FIRST
    if clock == "+400d":
        ended(first)
        second = campaign.go()
        ended(second)
        assert "results have modification times in the future" in second.stderr
    else:
        assert first.returncode != 0 and "clock skew" in first.stdout + first.stderr
        ended(campaign.go())
    assert campaign.results() == short


@pytest.mark.long
def test_every_file_truncated_emptied_or_corrupted(short, tmp_path):
    """Every result in turn: `verify --remove` finds it, and the next run leads back to the bytes."""
    campaign = Campaign(tmp_path, FIRST)
    ended(campaign.go())
    home = tmp_path / "results" / "small"
    spoil = [
        lambda b: b[: len(b) // 2],
        lambda b: b"",
        lambda b: b[: len(b) // 2] + bytes([b[len(b) // 2] ^ 255]) + b[len(b) // 2 + 1 :],
    ]
    for number, (name, whole) in enumerate(sorted(short.items())):
        if name in explain.OF_THE_CAMPAIGN:
            continue
        (home / name).write_bytes(spoil[number % 3](whole))
        told = campaign.verify().stderr
        assert told.count("changed since its job wrote it") == 1 and name in told
        (home / name).write_bytes(whole)
    for number, name in enumerate(("case/lv.vtu", "perfusion/chunk_0.npz", "perfusion/targets.json")):
        (home / name).write_bytes(spoil[number](short[name]))
    assert campaign.verify("--remove").returncode == 0
    ended(campaign.go())
    assert campaign.results() == short
    assert campaign.verify().returncode == 0


@pytest.mark.long
def test_a_cache_that_cannot_be_written(short, tmp_path):
    """It is not used, and the campaign runs without it."""
    with mounted(tmp_path / "cache", "100m") as remount:
        remount("ro")
        campaign = Campaign(tmp_path / "campaign", FIRST, tmp_path / "cache")
        done = campaign.go()
        ended(done)
        assert "cannot be written: no cache is used" in done.stderr
        assert campaign.results() == short
        assert not list((tmp_path / "cache").iterdir())
