"""svZeroDSolver as a backend: one run per sample, by its Python module or its command."""

import importlib
import importlib.util
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network import output_names as named
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.parameters import BOUNDARIES, CHAMBERS, CLOSED_LOOP, VALVES, VESSELS, Parameters
from coronaryuq.zerod.solver.engine import Changes
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.result import OK, Result

MODULES = ("svzerod", "pysvzerod")
"""Its Python module, as PyPI and as a build from source names it."""
COMMAND = "svzerodsolver"
TABLES = (VESSELS, BOUNDARIES, CLOSED_LOOP, VALVES, CHAMBERS)


def installed() -> str | None:
    """Return how svZeroDSolver can be run here: one of `MODULES`, `COMMAND`, or None."""
    for module in MODULES:
        if importlib.util.find_spec(module) is not None:
            return module
    return COMMAND if shutil.which(COMMAND) else None


def simulate(network: Network) -> pd.DataFrame:
    """Run svZeroDSolver on a network and return its table as it prints it; `RuntimeError` with its reason if it fails.

    Its standard output is sent to standard error, so that it does not mix with results.
    """
    network = network.for_svzerodsolver()
    name = installed()
    if name in MODULES:
        with _output_as_errors():
            return importlib.import_module(name).simulate(network)
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.json", Path(folder) / "out.csv"
        source.write_text(json.dumps(network), encoding="utf-8")
        run = subprocess.run(
            [COMMAND, source, target], capture_output=True, check=False, encoding="utf-8", errors="replace"
        )
        if run.returncode or not target.exists():
            raise RuntimeError(" ".join((run.stderr or run.stdout).split()) or f"{COMMAND} ended with {run.returncode}")
        return pd.read_csv(io.StringIO(target.read_text(encoding="utf-8")))


def last_cycle(network: Network, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Run svZeroDSolver and return unknowns over the last cycle, both ends included; `RuntimeError` if it fails.

    A tenth of the time of `simulate`, which makes a table of all unknowns.
    """
    written = {"output_variable_based": True, "output_all_cycles": False, "output_mean_only": False}
    written |= {"output_derivative": False, "use_cycle_to_cycle_error": False}
    network = Network({**network, "simulation_parameters": network["simulation_parameters"] | written})
    network = network.for_svzerodsolver()
    name = installed()
    if name in MODULES:
        with _output_as_errors():
            solver = importlib.import_module(name).Solver(network)
            solver.run()
            return {one: np.array(solver.get_single_result(one)) for one in names}
    table = simulate(network)
    return {one: table["y"].to_numpy()[table["name"].to_numpy() == one] for one in names}


def expressible(network: Network) -> bool:
    """Whether a network needs none of our extensions of svZeroDSolver's format."""
    return not any(
        spec.ours and element.values.get(name, 0.0) != 0.0
        for element in network.elements()
        for name, spec in _parameters(element.kind).items()
    )


def _parameters(kind: str) -> Parameters:
    return next((table[kind] for table in TABLES if kind in table), {})


@contextmanager
def _output_as_errors() -> Iterator[None]:
    """Send standard output to standard error, also what a library writes past Python."""
    sys.stdout.flush()
    output = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(output, 1)
        os.close(output)


class SvZeroD:
    """Same interface as `Engine`; marches whole cycles, always one sample at a time on one thread."""

    def __init__(self, network: Network, file: str | Path = "network"):
        self.model = Model(network, file)
        simulation = self.model.simulation
        self.steps_per_cycle = int(simulation["number_of_time_pts_per_cardiac_cycle"]) - 1
        self.cycles = int(simulation["number_of_cardiac_cycles"])

    @property
    def unknowns(self) -> list[str]:
        return self.model.variables

    @property
    def parameters(self) -> dict[str, float]:
        return self.model.parameters

    def run_cycles(
        self,
        changes: Changes | None = None,
        quantities: Sequence[str] = (),
        waveforms: Sequence[str] = (),
        cycles: int | None = None,
        steps_per_cycle: int | None = None,
        start: np.ndarray | None = None,
        threads: int = 1,
    ) -> Result:
        """Run as `Engine.run_cycles` does."""
        return self._run(changes or {}, quantities, waveforms, cycles or self.cycles, steps_per_cycle, start, np.inf)

    def run_to_periodic(
        self,
        changes: Changes | None = None,
        quantities: Sequence[str] = (),
        waveforms: Sequence[str] = (),
        periodicity: Periodicity | None = None,
        steps_per_cycle: int | None = None,
        start: np.ndarray | None = None,
        threads: int = 1,
    ) -> Result:
        """March all cycles that `periodicity` allows, and fail samples above its tolerance."""
        options = periodicity or Periodicity()
        return self._run(
            changes or {}, quantities, waveforms, options.cycles, steps_per_cycle, start, options.tolerance
        )

    def _run(
        self,
        changes: Changes,
        quantities: Sequence[str],
        waveforms: Sequence[str],
        limit: int,
        steps_per_cycle: int | None,
        start: np.ndarray | None,
        tolerance: float,
    ) -> Result:
        changed = {name: np.atleast_1d(np.asarray(value, float)) for name, value in changes.items()}
        samples = max([value.size for value in changed.values()], default=1)
        if start is not None:
            start = np.atleast_2d(np.asarray(start, float))
            samples = max(samples, len(start))
        steps = steps_per_cycle or self.steps_per_cycle
        size = self.model.size
        wanted = [named.parse(name, self.model) for name in quantities]
        result = Result.blank(samples, steps, self.model.period, 2 * size, quantities, waveforms)
        result.cycles[:] = limit
        for sample in range(samples):
            own = {name: float(value[sample % value.size]) for name, value in changed.items()}
            begin = None if start is None else start[sample % len(start)]
            try:
                y, rates = self._march(own, limit, steps, begin)
            except RuntimeError as reason:
                result.status[sample] = str(reason)
                continue
            last, previous = y[-steps - 1 :], y[-2 * steps - 1 : -steps]
            span = np.ptp(last, axis=0)
            scale = np.maximum(span, 1e-6 * np.abs(last).max(axis=0))
            error = np.max(np.abs(last[-1] - last[0])[scale > 0] / scale[scale > 0], initial=0.0)
            if limit > 1:
                caps = [unknown for cap in self.model.caps for unknown in cap]
                means = previous[:, caps].mean(axis=0), last[:, caps].mean(axis=0)
                with np.errstate(divide="ignore", invalid="ignore"):
                    error = max(error, np.nan_to_num(np.abs(means[1] / means[0] - 1.0)).max(initial=0.0))
            result.cycle_error[sample] = error
            result.state[sample] = np.concatenate([last[-1], rates[-1]])
            if not error < tolerance:
                result.status[sample] = f"not periodic after {limit} cycles (cycle error {error:.2g})"
                continue
            result.status[sample] = OK
            reduce: dict[str, Callable[[np.ndarray], float]] = {
                "mean": lambda wave: np.trapezoid(wave) / steps,
                "min": np.min,
                "max": np.max,
            }
            for name, quantity in zip(quantities, wanted, strict=True):
                result.values[name][sample] = reduce[quantity.statistic](last[:, quantity.unknown])
            for name in waveforms:
                result.waveforms[name][sample] = last[:, named.unknown(name, self.model)]
        return result

    def _march(self, changes: dict, cycles: int, steps: int, start) -> tuple[np.ndarray, np.ndarray]:
        network = with_changes(self.model.network, changes, self.model.file)
        simulation = network["simulation_parameters"]
        simulation |= {
            "number_of_cardiac_cycles": cycles,
            "number_of_time_pts_per_cardiac_cycle": steps + 1,
            "output_variable_based": True,
            "output_all_cycles": True,
            "output_derivative": True,
            "output_mean_only": False,
            "use_cycle_to_cycle_error": False,
        }
        if start is not None:
            if any(block.kind.startswith("CORONARY") for block in self.model.blocks.values()):
                raise InputError(
                    self.model.file, "start", None, "svZeroDSolver cannot continue an open-loop coronary bed"
                )
            size = self.model.size
            network["initial_condition"] = dict(zip(self.unknowns, map(float, start[:size]), strict=True))
            rates = map(float, start[size : 2 * size])
            network["initial_condition_d"] = dict(zip(self.unknowns, rates, strict=True))
            simulation["steady_initial"] = False
        table = simulate(network)
        order = {name: number for number, name in enumerate(self.unknowns)}
        shape = len(self.unknowns), -1
        rows = table["name"].map(order).to_numpy().argsort(kind="stable")
        return table["y"].to_numpy()[rows].reshape(shape).T, table["ydot"].to_numpy()[rows].reshape(shape).T
