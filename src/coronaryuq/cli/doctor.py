"""Look at a machine before a campaign does: libraries, MPI, pictures, space, solvers, scheduler."""

import fcntl
import importlib.metadata
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from coronaryuq.core import numba_cache

LIBRARIES = {
    "numpy": "numpy", "scipy": "scipy", "numba": "numba", "torch": "torch", "pandas": "pandas", "pyarrow": "pyarrow",
    "scikit-learn": "sklearn", "arviz": "arviz", "snakemake": "snakemake", "pydantic": "pydantic", "pyvista": "pyvista",
    "tetgen": "tetgen", "manifold3d": "manifold3d", "mmgpy": "mmgpy", "SimpleITK": "SimpleITK", "mpi4py": "mpi4py",
}  # fmt: skip
EXTERNAL = {
    "svzerodsolver": "0D backend `svzerod`",
    "svsolver": "3D backend `svsolver`",
    "svpre": "3D backend `svsolver`",
    "svmultiphysics": "3D backend `svmultiphysics`",
    "sbatch": "profile `slurm`",
}


@dataclass
class Finding:
    """One thing looked at: sound or not, and what to do when it is not."""

    what: str
    sound: bool
    detail: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.sound else 'FAIL'} {self.what}: {self.detail}"


def examine(environment_only: bool = False) -> Iterator[Finding]:
    """Examine this machine; findings come as they are made."""
    yield _python()
    yield from _libraries()
    yield _pictures()
    if environment_only:
        return
    yield _mpi()
    yield _space()
    yield _scratch()
    yield _locks()
    yield _cache()
    yield _kernels()
    yield from _scheduler()
    for program, purpose in EXTERNAL.items():
        path = shutil.which(program)
        yield Finding(program, True, path or f"not installed; only {purpose} needs it")


def versions() -> dict[str, str]:
    """Installed versions of the libraries that a campaign uses."""
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _python() -> Finding:
    version = ".".join(map(str, sys.version_info[:3]))
    return Finding("python", sys.version_info >= (3, 11), f"{version} ({sys.executable})")


def _libraries() -> Iterator[Finding]:
    for name, module in LIBRARIES.items():
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            yield Finding(name, False, "not installed; run `make env`")
            continue
        # Each in its own process: a library whose system libraries are missing may take the process with it.
        tried = _run([sys.executable, "-c", f"import {module}"], timeout=120)
        yield Finding(name, tried is None, version if tried is None else f"{version} does not import: {tried}")


def _pictures() -> Finding:
    code = (
        "import pyvista, sys; p = pyvista.Plotter(off_screen=True, window_size=(64, 64));"
        "p.add_mesh(pyvista.Sphere(), color='red'); image = p.screenshot(None); sys.exit(int(image.std() < 1))"
    )
    failure = _run([sys.executable, "-c", code], timeout=120)
    remedy = "3D pictures need an OpenGL library: apt-get install libgl1 libegl1 (or libosmesa6)"
    return Finding(
        "3D pictures", failure is None, "rendered off screen" if failure is None else f"{remedy} [{failure}]"
    )


def _mpi(ranks: int = 2) -> Finding:
    launcher = shutil.which("mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if launcher is None:
        return Finding("MPI", False, "no mpiexec; run `make env`")
    code = f"from mpi4py import MPI; raise SystemExit(MPI.COMM_WORLD.allreduce(1) != {ranks})"
    failure = _run([launcher, "-n", str(ranks), sys.executable, "-c", code], timeout=120)
    detail = (
        f"{launcher} starts {ranks} ranks" if failure is None else f"{launcher} does not start {ranks} ranks: {failure}"
    )
    return Finding("MPI", failure is None, detail)


def _space(wanted: float = 5e9) -> Finding:
    free = shutil.disk_usage(".").free
    return Finding(
        "disk", free >= wanted, f"{free / 1e9:.0f} GB free here" + ("" if free >= wanted else "; wanted 5 GB")
    )


def _scratch(wanted: float = 2e9) -> Finding:
    """Where jobs keep what they do not hand on: `TMPDIR`, else the system's folder."""
    folder = tempfile.gettempdir()
    try:
        with tempfile.NamedTemporaryFile(dir=folder) as file:
            file.write(bytes(1000))
    except OSError as error:
        return Finding("scratch", False, f"{folder} cannot be written ({error.strerror}); set TMPDIR")
    free = shutil.disk_usage(folder).free
    more = "" if free >= wanted else "; wanted 2 GB, set TMPDIR"
    return Finding("scratch", free >= wanted, f"{free / 1e9:.0f} GB free in {folder}{more}")


def _locks() -> Finding:
    """Whether the file system here knows the lock that keeps two campaigns apart."""
    with tempfile.NamedTemporaryFile(dir=".") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            return Finding("locks", True, f"none on this file system ({error.strerror}); run one campaign at a time")
    return Finding("locks", True, "two campaigns on one results folder are kept apart")


def _scheduler(ranks: int = 2, patience: float = 120.0) -> Iterator[Finding]:
    """One tiny MPI job through SLURM, where there is one."""
    if shutil.which("sbatch") is None:
        return
    told = _said(["sinfo", "--version"], 30)
    if told is None:
        yield Finding("SLURM", False, "sbatch is there, but sinfo does not answer; is the controller running?")
        return
    code = f"from mpi4py import MPI; raise SystemExit(MPI.COMM_WORLD.allreduce(1) != {ranks})"
    # In this folder, because a campaign's jobs need it on every node too.
    with tempfile.TemporaryDirectory(dir=".", prefix=".doctor-") as folder:
        script = Path(folder, "job.sh")
        script.write_text(f"#!/bin/bash\nsrun -n {ranks} {shlex.quote(sys.executable)} -c {shlex.quote(code)}\n")
        limits = [f"--ntasks={ranks}", "--time=2", "--mem-per-cpu=500", f"--output={folder}/out", "--wait"]
        failure = _run(["sbatch", f"--job-name={Path(folder).name}", *limits, str(script)], patience)
        if failure is not None:  # it may still wait for its turn
            _said(["scancel", f"--name={Path(folder).name}"], 30)
        said = [line for line in _read(Path(folder, "out")).splitlines() if line.strip()]
    if failure is None:
        yield Finding("SLURM", True, f"{told}: a job of {ranks} MPI ranks ran by srun")
    else:
        yield Finding("SLURM", False, f"{told}: a job of {ranks} MPI ranks did not: {(said or [failure])[-1][:200]}")


def _said(command: list[str], timeout: float) -> str | None:
    """What a command prints, or None if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def _read(path: Path) -> str:
    return path.read_text(errors="replace") if path.is_file() else ""


def _cache() -> Finding:
    folder = os.environ.get("SNAKEMAKE_OUTPUT_CACHE")
    if not folder:
        return Finding("cache", True, "SNAKEMAKE_OUTPUT_CACHE is not set: results are not shared between campaigns")
    try:
        with tempfile.NamedTemporaryFile(dir=folder):
            return Finding("cache", True, f"{folder} is writeable")
    except OSError as error:
        return Finding("cache", False, f"SNAKEMAKE_OUTPUT_CACHE={folder} cannot be written: {error.strerror}")


def _kernels() -> Finding:
    """Where compiled kernels are kept; without such a folder every job compiles them anew."""
    folder = os.environ.get(numba_cache.VARIABLE, "")
    if not folder:
        return Finding("kernels", False, f"no folder can be written for compiled kernels; set {numba_cache.VARIABLE}")
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            return Finding("kernels", True, f"compiled once for all jobs that see {folder}")
    except OSError as error:
        return Finding("kernels", False, f"{numba_cache.VARIABLE}={folder} cannot be written: {error.strerror}")


def _run(command: list[str], timeout: float) -> str | None:
    """Run a command; None if it succeeds, else the last line that it printed, or how it ended."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        return f"no answer within {timeout:.0f} s"
    except OSError as error:
        return str(error)
    if done.returncode == 0:
        return None
    lines = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
    return lines[-1][:200] if lines else f"ended with code {done.returncode}"
