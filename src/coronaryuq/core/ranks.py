"""Model runs over MPI ranks: every rank computes its share, and all know the results."""

import os
from collections.abc import Callable

import numpy as np

_LAUNCHERS = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK", "MPI_LOCALRANKID")


class Ranks:
    """One process (the default), or the ranks of an MPI communicator.

    Random numbers and decisions are made by every rank from the same seed; only the model's runs are shared out. As a
    run does not depend on who shares its batch, results are the same bits for any number of ranks.
    """

    def __init__(self, communicator=None):
        self.communicator = communicator
        self.rank = 0 if communicator is None else communicator.Get_rank()
        self.size = 1 if communicator is None else communicator.Get_size()

    @classmethod
    def of_this_job(cls) -> "Ranks":
        """The ranks of `mpiexec` or `srun` when one of them started this process; MPI is not touched otherwise."""
        if not any(name in os.environ for name in _LAUNCHERS):
            return cls()
        from mpi4py import MPI

        return cls(MPI.COMM_WORLD if MPI.COMM_WORLD.Get_size() > 1 else None)

    def share(self, function: Callable[[np.ndarray], np.ndarray], rows: np.ndarray) -> np.ndarray:
        """`function(rows)`, rows split into contiguous blocks, one per rank; an error on one rank is raised on all."""
        if self.communicator is None:
            return function(rows)
        bounds = np.arange(self.size + 1) * len(rows) // self.size
        mine = rows[bounds[self.rank] : bounds[self.rank + 1]]
        parts = self.gather(lambda: function(mine) if len(mine) else None)
        return np.concatenate([part for part in parts if part is not None])

    def gather(self, make: Callable) -> list:
        """`make()` of every rank, on all of them; an error on one rank is raised on all."""
        if self.communicator is None:
            return [make()]
        try:
            part = make()
        except Exception as error:  # every rank must hear of it, or the others wait for ever
            part = error
        parts = self.communicator.allgather(part)
        for part in parts:
            if isinstance(part, Exception):
                raise part
        return parts

    def owns(self, chain: int, chains: int) -> bool:
        """Whether this rank carries `chain` of `chains`, and so writes its file."""
        return chain * self.size // chains == self.rank

    def from_first(self, make: Callable):
        """`make()` on the first rank, its result on all; an error is raised on all."""
        if self.communicator is None:
            return make()
        result = None
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
        if self.communicator is not None:
            self.communicator.Barrier()
