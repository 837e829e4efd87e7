"""Choice of the 0D solver: our engine, or svZeroDSolver if it is installed, with the same methods."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.solver.engine import Changes, Engine
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.result import Result
from coronaryuq.zerod.svzerodsolver.program import SvZeroD, installed


class Backend(Protocol):
    """Interface of both backends; see `Engine`."""

    @property
    def unknowns(self) -> list[str]: ...

    @property
    def parameters(self) -> dict[str, float]: ...

    def run_cycles(
        self,
        changes: Changes | None = None,
        quantities: Sequence[str] = (),
        waveforms: Sequence[str] = (),
        cycles: int | None = None,
        steps_per_cycle: int | None = None,
        start: np.ndarray | None = None,
        threads: int = 1,
    ) -> Result: ...

    def run_to_periodic(
        self,
        changes: Changes | None = None,
        quantities: Sequence[str] = (),
        waveforms: Sequence[str] = (),
        periodicity: Periodicity | None = None,
        steps_per_cycle: int | None = None,
        start: np.ndarray | None = None,
        threads: int = 1,
    ) -> Result: ...


def make(name: str, network: Network, file: str | Path = "network") -> Backend:
    """Return a backend by name: `coronaryuq` or `svzerod`; `InputError` if the latter is not installed."""
    if name == "coronaryuq":
        return Engine(network, file)
    if name == "svzerod":
        if installed() is None:
            raise InputError("configuration", "zerod.backend", name, "pip install svzerod, or use coronaryuq")
        return SvZeroD(network, file)
    raise InputError("configuration", "zerod.backend", name, "expected coronaryuq or svzerod")
