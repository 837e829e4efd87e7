"""Meshing in a process of its own, because mmg may kill the process that calls it; with retries and a time limit.

The limit is on CPU time: with a limit on wall time a busy machine would give the mesh of another attempt.
"""

import importlib
import math
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from coronaryuq.flow3d.mesh.generation import subprocess_io
from coronaryuq.flow3d.mesh.generation.piece import ATTEMPTS, Attempt, Piece
from coronaryuq.flow3d.mesh.geometry.errors import MeshError

Job = tuple[Callable[..., Piece], dict]
"""A module-level function of `piece` and its arguments, all but `attempt`."""

PATIENCE = 20.0
"""Wall time over CPU time after which an attempt counts as stuck."""


def run(name: str, job: Job, time_limit: float, attempts: int) -> tuple[Piece, list[str]]:
    """Mesh one piece; return it with one line per attempt that failed.

    time_limit: CPU seconds of one attempt. Raises `MeshError` with all of those lines if no attempt succeeds.
    """
    failures: list[str] = []
    for number, attempt in enumerate(ATTEMPTS[:attempts], start=1):
        piece, reason = _once(job, attempt, time_limit)
        if piece is not None:
            return piece, failures
        failures.append(f"attempt {number}: {reason}")
    raise MeshError(f"piece {name} could not be meshed: {'; '.join(failures)}")


def _once(job: Job, attempt: Attempt, time_limit: float) -> tuple[Piece | None, str]:
    with tempfile.TemporaryDirectory(prefix="coronaryuq-mesh-") as folder:
        job_file, piece_file = Path(folder) / "job.npz", Path(folder) / "piece.npz"
        function, arguments = job
        subprocess_io.write(job_file, arguments | {"attempt": attempt})
        try:
            done = subprocess.run(
                [
                    sys.executable,
                    "-m",
                    __spec__.name,
                    *map(str, (function.__module__, function.__name__, job_file, piece_file, time_limit)),
                ],
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                timeout=PATIENCE * time_limit,
                check=False,
                cwd=folder,  # so that files which a mesher leaves behind are deleted with the folder
            )
        except subprocess.TimeoutExpired:
            return None, f"stuck: not finished after {PATIENCE * time_limit:g} s"
        if done.returncode == -signal.SIGXCPU:
            return None, f"not finished after {time_limit:g} s of CPU time"
        if done.returncode == 0 and piece_file.exists():
            return subprocess_io.read(piece_file), ""
        return None, _reason(done)


def _reason(done: subprocess.CompletedProcess) -> str:
    if done.returncode < 0:
        return f"the mesher was killed ({signal.Signals(-done.returncode).name})"
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    return lines[-1].strip() if lines else f"the mesher exited with code {done.returncode} and no message"


def main(module: str, function: str, job_file: str, piece_file: str, time_limit: str) -> int:
    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = math.ceil(used.ru_utime + used.ru_stime + float(time_limit))
    # A cluster may have set a limit of its own, which no process may raise: a higher one would be an error.
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (limit if most == resource.RLIM_INFINITY else min(limit, most), most))
    try:
        piece = getattr(importlib.import_module(module), function)(**subprocess_io.read(job_file))
    except MeshError as error:
        print(error, file=sys.stderr)
        return 1
    subprocess_io.write(piece_file, piece)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
