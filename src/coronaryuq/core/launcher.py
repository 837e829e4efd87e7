"""MPI jobs on this machine, also inside a batch job or a step of `srun`, whose variables mean other processes.

And the programs without which no job starts.
"""

import os
import shutil

from coronaryuq.core.errors import InputError

LOCAL_MPIEXEC = "env HYDRA_LAUNCHER=fork HYDRA_RMK=user mpiexec"
"""Starts ranks here. Left to itself, mpiexec would ask the scheduler's `srun` to, which hangs where there is none."""

_OF_OUTER_RANKS = ("PMI_", "PMIX_", "OMPI_", "PRTE_", "MPI_LOCAL")
"""Beginnings of the variables by which a launcher tells a process its rank."""

FORGET_OUTER_RANKS = f"unset {' '.join(f'${{!{start}@}}' for start in _OF_OUTER_RANKS)}"
"""Command of bash: this shell and what it starts are no ranks of the launcher around them."""


def environment() -> dict[str, str]:
    """Return the environment without what a launcher around this process has set, for programs started here."""
    return {name: value for name, value in os.environ.items() if not name.startswith(_OF_OUTER_RANKS)}


def check_programs(*needed: str) -> None:
    """Raise `InputError` if PATH lacks a program without which Snakemake stops."""
    if missing := [program for program in needed if shutil.which(program) is None]:
        remedy = f"has no {' and no '.join(missing)}, which Snakemake needs; add the system's folders (/usr/bin:/bin)"
        raise InputError("environment", "PATH", os.environ.get("PATH"), remedy)
