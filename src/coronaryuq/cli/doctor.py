"""Checks of a machine before a campaign: libraries, MPI, 3D rendering, disk, solvers, scheduler."""

import functools
import importlib.metadata
import io
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass
from pathlib import Path

import coronaryuq
from coronaryuq.core import numba_cache, provenance
from coronaryuq.core.io.lock import lock_results
from coronaryuq.core.launcher import LOCAL_MPIEXEC, environment

EXTERNAL = {
    "svsolver": "3D backend `svsolver`",
    "svpre": "3D backend `svsolver`",
    "svmultiphysics": "3D backend `svmultiphysics`",
    "sbatch": "profile `slurm`",
}


@dataclass
class Finding:
    """One check: what was checked, whether it passed, and a detail or a remedy."""

    what: str
    sound: bool
    detail: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.sound else 'FAIL'} {self.what}: {self.detail}"


def examine(environment_only: bool = False) -> Iterator[Finding]:
    """Check this machine.

    Parameters
    ----------
    environment_only
        Check the Python environment and 3D rendering only.

    Yields
    ------
    Finding
        One per check, as soon as it is done.
    """
    yield check_python()
    yield from check_libraries()
    yield check_rendering()
    if environment_only:
        return
    yield from _guard("MPI", check_mpi)
    yield from _guard("disk", check_space)
    yield check_scratch()
    yield from _guard("locks", check_locks)
    yield check_cache()
    yield check_kernels()
    yield from _guard("Snakemake", check_job)
    yield from _guard("SLURM", check_scheduler)
    yield check_umbridge()
    yield check_svzerodsolver()
    for program, purpose in EXTERNAL.items():
        yield from _guard(program, functools.partial(check_program, program, purpose))


def _guard(what: str, check: Callable[[], Finding | Iterable[Finding]]) -> Iterator[Finding]:
    """Make a check; one that finds no folder to work in has failed, and the other checks go on."""
    try:
        found = check()
        yield from (found,) if isinstance(found, Finding) else found
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        yield Finding(what, False, f"could not be checked ({place}{error.strerror or error})")


def check_python() -> Finding:
    """Check the version of Python."""
    version = ".".join(map(str, sys.version_info[:3]))
    return Finding("python", sys.version_info >= (3, 11), f"{version} ({sys.executable})")


def check_libraries() -> Iterator[Finding]:
    """Import every library that the package needs."""
    for name, module in provenance.LIBRARIES.items():
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            yield Finding(name, False, "not installed; run `make env`")
            continue
        # In a separate process, which a library whose system libraries are missing may crash.
        failure = _run([sys.executable, "-c", f"import {module}"], timeout=120)
        detail = version if failure is None else f"{version} cannot be imported: {failure}"
        yield Finding(name, failure is None, detail)


def check_rendering() -> Finding:
    """Render one image in a separate process."""
    code = (
        "import pyvista, sys; p = pyvista.Plotter(off_screen=True, window_size=(64, 64));"
        "p.add_mesh(pyvista.Sphere(), color='red'); image = p.screenshot(None); sys.exit(int(image.std() < 1))"
    )
    failure = _run([sys.executable, "-c", code], timeout=120)
    remedy = "needs an OpenGL library: apt-get install libgl1 libegl1 (or libosmesa6)"
    detail = "works off screen" if failure is None else f"{remedy} [{failure}]"
    return Finding("3D rendering", failure is None, detail)


def check_umbridge() -> Finding:
    """Report the version of umbridge, which is optional."""
    try:
        return Finding("umbridge", True, importlib.metadata.version("umbridge"))
    except importlib.metadata.PackageNotFoundError:
        needs = "`coronaryuq serve` and the backend `umbridge`"
        return Finding("umbridge", True, f"not installed; needed only by {needs}: pip install 'coronaryuq[umbridge]'")


def check_svzerodsolver() -> Finding:
    """Report svZeroDSolver's Python module or program, which is optional."""
    from coronaryuq.zerod.svzerodsolver import program

    name = program.installed()
    if name is None:
        detail = "not installed; needed only by the 0D backend `svzerod`: pip install svzerod"
    elif name == program.COMMAND:
        detail = str(shutil.which(name))
    else:
        failure = _run([sys.executable, "-c", f"import {name}"], timeout=120)
        if failure is not None:
            return Finding("svZeroDSolver", False, f"module {name} cannot be imported: {failure}")
        detail = f"module {name} {importlib.metadata.version(name)}"
    return Finding("svZeroDSolver", True, detail)


def check_program(program: str, purpose: str) -> Finding:
    """Start an external program, if it is installed; without input it ends at once, but not for want of a library."""
    path = shutil.which(program)
    if path is None:
        return Finding(program, True, f"not installed; needed only by the {purpose}")
    with tempfile.TemporaryDirectory() as folder:
        failure = _run([path], timeout=60, folder=folder)
    absent = failure is not None and any(word in failure for word in ("shared librar", "Exec format", "cannot execute"))
    return Finding(program, not absent, f"{path}: {failure}" if absent else path)


def check_job() -> Finding:
    """Run the first job of a campaign in a new folder here, by Snakemake, as a campaign does."""
    with tempfile.TemporaryDirectory(dir=".", prefix=".doctor-") as folder:
        target = "results/smoke/patient/case.yaml"
        command = [sys.executable, "-m", "coronaryuq.cli.main", "run", "smoke", target, "--cores", "1"]
        own = os.environ | {"PYTHONPATH": str(Path(coronaryuq.__file__).parents[1])}
        failure = _run(command, timeout=300, folder=folder, environment=own)
        made = Path(folder, target).is_file()
    remedy = "the first job of a campaign fails here; see `coronaryuq run smoke`"
    detail = "the first job of a campaign ran" if made else f"{remedy} [{failure}]"
    return Finding("Snakemake", made, detail)


def check_mpi(ranks: int = 2) -> Finding:
    """Run a tiny MPI job as a campaign starts its ranks."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"
    launcher = shutil.which("mpiexec", path=path)
    if launcher is None:
        return Finding("MPI", False, "mpiexec not found; run `make env`")
    code = f"from coronaryuq.core.ranks import Ranks; raise SystemExit(Ranks.started({ranks}).size != {ranks})"
    start = [*shlex.split(LOCAL_MPIEXEC), "-n", str(ranks), sys.executable, "-c", code]
    failure = _run(start, timeout=120, environment=environment() | {"PATH": path})
    detail = "started" if failure is None else "could not start"
    return Finding("MPI", failure is None, f"{launcher} {detail} {ranks} ranks{f': {failure}' if failure else ''}")


def check_space(required: float = 5e9) -> Finding:
    """Check the free disk space here (bytes)."""
    free = shutil.disk_usage(".").free
    shortage = "" if free >= required else "; a campaign needs 5 GB"
    return Finding("disk", free >= required, f"{free / 1e9:.0f} GB free here{shortage}")


def check_scratch(required: float = 2e9) -> Finding:
    """Check the folder of temporary files: `TMPDIR`, else the system's."""
    folder = tempfile.gettempdir()
    try:
        with tempfile.NamedTemporaryFile(dir=folder) as file:
            file.write(bytes(1000))
    except OSError as error:
        return Finding("scratch", False, f"{folder} is not writable ({error.strerror}); set TMPDIR")
    free = shutil.disk_usage(folder).free
    shortage = "" if free >= required else "; jobs need 2 GB, set TMPDIR"
    if (named := os.environ.get("TMPDIR")) and os.path.realpath(named) != os.path.realpath(folder):
        shortage += f" (TMPDIR={named} cannot be used)"
    return Finding("scratch", free >= required, f"{free / 1e9:.0f} GB free in {folder}{shortage}")


def check_locks() -> Finding:
    """Check whether the file system here supports the lock that keeps two campaigns apart."""
    with tempfile.TemporaryDirectory(dir=".", prefix=".doctor-") as folder, redirect_stderr(io.StringIO()) as told:
        lock_results(folder).__exit__(None, None, None)
    if told.getvalue():
        return Finding("locks", True, "none on this file system; run only one campaign at a time")
    return Finding("locks", True, "two campaigns cannot run in the same results folder")


def check_scheduler(ranks: int = 2, patience: float = 120.0) -> Iterator[Finding]:
    """Run one tiny MPI job through SLURM, if it is installed."""
    if shutil.which("sbatch") is None:
        return
    version = _output(["sinfo", "--version"], 30)
    if version is None:
        yield Finding("SLURM", False, "sbatch is installed, but sinfo does not answer; is the controller running?")
        return
    code = f"from coronaryuq.core.ranks import Ranks; raise SystemExit(Ranks.started({ranks}).size != {ranks})"
    # In this folder, which a campaign's jobs need on every node.
    with tempfile.TemporaryDirectory(dir=".", prefix=".doctor-") as folder:
        script = Path(folder, "job.sh")
        line = f"srun -n {ranks} {shlex.quote(sys.executable)} -c {shlex.quote(code)}"
        script.write_text(f"#!/bin/bash\n{line}\n", encoding="utf-8")
        limits = [f"--ntasks={ranks}", "--time=2", "--mem-per-cpu=500", f"--output={folder}/out", "--wait"]
        failure = _run(["sbatch", f"--job-name={Path(folder).name}", *limits, str(script)], patience)
        if failure is not None:  # it may still be in the queue
            _output(["scancel", f"--name={Path(folder).name}"], 30)
        log = Path(folder, "out")
        text = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
        lines = [line for line in text.splitlines() if line.strip()]
    if failure is None:
        yield Finding("SLURM", True, f"{version}: srun ran a job of {ranks} MPI ranks")
    else:
        reason = (lines or [failure])[-1][:200]
        yield Finding("SLURM", False, f"{version}: a job of {ranks} MPI ranks failed: {reason}")


def _output(command: list[str], timeout: float) -> str | None:
    """Return the output of a command, or None if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=timeout)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def check_cache() -> Finding:
    """Check the folder of Snakemake's output cache."""
    folder = os.environ.get("SNAKEMAKE_OUTPUT_CACHE")
    if not folder:
        return Finding("cache", True, "SNAKEMAKE_OUTPUT_CACHE is not set; campaigns do not share results")
    try:
        tempfile.TemporaryFile(dir=folder).close()
        return Finding("cache", True, f"{folder} is writable")
    except OSError as error:
        return Finding("cache", False, f"SNAKEMAKE_OUTPUT_CACHE={folder} is not writable: {error.strerror}")


def check_kernels() -> Finding:
    """Check the folder of compiled kernels; without it, every job compiles them again."""
    numba_cache.choose_folder()
    folder = os.environ.get(numba_cache.VARIABLE, "")
    if not folder:
        return Finding("kernels", False, f"no writable folder for compiled kernels; set {numba_cache.VARIABLE}")
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            return Finding("kernels", True, f"compiled once into {folder}")
    except OSError as error:
        return Finding("kernels", False, f"{numba_cache.VARIABLE}={folder} is not writable: {error.strerror}")


def _run(
    command: list[str], timeout: float, folder: str | None = None, environment: dict[str, str] | None = None
) -> str | None:
    """Run a command; return None if it succeeds, else the last line of its output or its exit status."""
    try:
        done = subprocess.run(
            command, capture_output=True, encoding="utf-8", errors="replace", timeout=timeout,
            cwd=folder, env=environment, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"timed out after {timeout:.0f} s"
    except OSError as error:
        return str(error)
    if done.returncode == 0:
        return None
    lines = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
    return lines[-1][:200] if lines else f"exit code {done.returncode}"
