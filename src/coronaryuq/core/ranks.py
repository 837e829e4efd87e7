"""Model runs over MPI ranks: every rank computes a part, and all ranks receive all results."""

import os
import sys
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from coronaryuq.core.errors import InputError

Result = TypeVar("Result")

_LAUNCHED = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK", "MPI_LOCALRANKID")


class Ranks:
    """The ranks of an MPI communicator; a single process by default.

    Every rank draws the same random numbers and takes the same decisions; only model runs are distributed. Because a
    run does not depend on its batch, results are bitwise identical for any number of ranks.

    Parameters
    ----------
    communicator
        `mpi4py.MPI.Comm`, or None for a single process.
    threads
        Threads that each rank may use.
    """

    def __init__(self, communicator: Any = None, threads: int = 1):
        self.communicator, self.threads = communicator, threads
        self.rank: int = 0 if communicator is None else communicator.Get_rank()
        self.size: int = 1 if communicator is None else communicator.Get_size()

    @classmethod
    def started(cls, number: int, threads: int = 1) -> "Ranks":
        """Return the ranks that `mpiexec` or `srun` was told to start; MPI is not loaded for a single one.

        Variables of the environment are no evidence: a process without MPI has those of the `srun` around it.

        Raises
        ------
        InputError
            If MPI counts another number of ranks.
        """
        if number == 1:
            return cls(threads=threads)
        from mpi4py import MPI

        size = MPI.COMM_WORLD.Get_size()
        if size != number:
            remedy = f"the launcher was told to start {number}; use this environment's mpiexec, or one of the same MPI"
            raise InputError("MPI", "ranks", size, remedy)
        return cls(MPI.COMM_WORLD, threads)

    @classmethod
    def by_hand(cls, divide: bool, threads: int = 1) -> "Ranks":
        """Return the ranks of the command line `mpiexec -n N PROGRAM --mpi`; `divide`: whether it has `--mpi`."""
        if not divide:
            if any(name in os.environ for name in _LAUNCHED):
                print("note: under mpiexec or srun, `--mpi` divides the runs among the ranks", file=sys.stderr)
            return cls(threads=threads)
        from mpi4py import MPI

        return cls(MPI.COMM_WORLD if MPI.COMM_WORLD.Get_size() > 1 else None, threads)

    def map_rows(self, function: Callable[[np.ndarray], np.ndarray], rows: np.ndarray) -> np.ndarray:
        """Return `function(rows)`, computed in contiguous blocks of rows, one per rank.

        An error on one rank is raised on all.
        """
        if self.communicator is None:
            return function(rows)
        bounds = np.arange(self.size + 1) * len(rows) // self.size
        block = rows[bounds[self.rank] : bounds[self.rank + 1]]
        parts = self.gather(lambda: function(block) if len(block) else None)
        return np.concatenate([part for part in parts if part is not None])

    def gather(self, make: Callable[[], Result]) -> list[Result]:
        """Return `make()` of every rank, on all of them; an error on one rank is raised on all."""
        if self.communicator is None:
            return [make()]
        part: Result | Exception
        try:
            part = make()
        except Exception as error:  # pass it on, or the other ranks wait forever
            part = error
        parts = self.communicator.allgather(part)
        for part in parts:
            if isinstance(part, Exception):
                raise part
        return parts

    def owns(self, chain: int, chains: int) -> bool:
        """Return whether this rank writes the file of a chain, out of `chains`."""
        return chain * self.size // chains == self.rank

    def run_on_first(self, make: Callable[[], Result]) -> Result:
        """Return `make()` of the first rank, on all of them; its error is raised on all."""
        if self.communicator is None:
            return make()
        result: Any = None
        if self.rank == 0:
            try:
                result = make()
            except Exception as error:
                result = error
        result = self.communicator.bcast(result)
        if isinstance(result, Exception):
            raise result
        return result

    def barrier(self) -> None:
        """Wait until every rank has arrived."""
        if self.communicator is not None:
            self.communicator.Barrier()
