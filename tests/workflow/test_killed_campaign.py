"""The whole campaign, killed at twenty random moments from its first stage to its last, ends with the same bytes."""

import contextlib
import os
import random
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from support import smoke

pytestmark = [pytest.mark.workflow, pytest.mark.long]

KILLS = 20
JOBS_BETWEEN, SECONDS_MORE = (-0.5, 2.5), (0.0, 6.0)
"""What passes between the first job of a start and its kill: jobs that end, so that long ones do, and then time."""


def jobs_ended(folder: Path) -> int:
    """Every job leaves a note as it ends."""
    return sum(1 for _ in folder.glob("results/smoke/provenance/*.json"))


def interrupt(folder: Path, moment: random.Random, whole_group: bool) -> str | None:
    """Start the campaign and kill it at some moment; what it was doing then, or None where it ended before that."""
    with open(folder / "out.log", "w") as out:
        process = subprocess.Popen(smoke.command(folder), stdout=out, stderr=out, start_new_session=True)
    while not jobs(process.pid) and process.poll() is None:
        time.sleep(0.5)
    wanted = jobs_ended(folder) + moment.uniform(*JOBS_BETWEEN)
    while jobs_ended(folder) < wanted and process.poll() is None:
        time.sleep(0.1)
    until = time.monotonic() + moment.uniform(*SECONDS_MORE)
    while time.monotonic() < until and process.poll() is None:
        time.sleep(0.01)
    if process.poll() is not None:
        assert process.returncode == 0, (folder / "out.log").read_text()[-4000:]
        return None
    running = jobs(process.pid)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL) if whole_group else process.kill()
    process.wait()
    return running or "between jobs"


def jobs(session: int) -> str:
    """Rules whose jobs run in a session."""
    listed = subprocess.run(["ps", "-ww", "-o", "args=", "-s", str(session)], capture_output=True, text=True).stdout
    return " ".join(sorted(set(re.findall(r"--target-jobs (\w+):", listed))))


def test_killed_at_twenty_moments_of_the_whole_campaign(results, tmp_path):
    """Every other time its jobs live on as orphans beside those of the next start."""
    moment, moments = random.Random(11), []
    for number in range(KILLS):
        running = interrupt(tmp_path, moment, whole_group=number % 2 == 1)
        if running is None:
            break
        moments.append((jobs_ended(tmp_path), running))
        print(number, *moments[-1], flush=True)
    ended = smoke.campaign(tmp_path)
    assert len(moments) >= KILLS * 3 // 4, moments
    assert not smoke.differences(results, ended)
    assert not smoke.differing(results, ended)
