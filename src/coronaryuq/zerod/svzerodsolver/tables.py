"""Tables as svZeroDSolver writes them: by vessel or by variable, last cycle or all, means, derivatives."""

import math
from itertools import islice

import numpy as np
import pandas as pd

from coronaryuq.case.network.network import Network
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.solver.engine import Engine

_VESSELS = ("BloodVessel", "BloodVesselCRL", "LinearElastanceChamber", "PiecewiseValve")
"""Elements that svZeroDSolver's table by vessel shows."""


def simulate(network: Network, file: str = "network") -> pd.DataFrame:
    """Solve a network in time with its `simulation_parameters` and return svZeroDSolver's output table.

    With `use_cycle_to_cycle_error` the number of cycles follows from the largest RCR time constant (Pfaller et al.
    2021, eq. 21), or, without an RCR, cycles are added until mean flow and pressure at the caps change by less than
    `sim_cycle_to_cycle_percent_error`. Raises `InputError` for a bad network, `RuntimeError` when Newton's method
    does not converge.
    """
    engine = Engine(network, file)
    model, simulation = engine.model, engine.model.simulation
    tolerance = simulation.get("sim_cycle_to_cycle_percent_error", 1.0) / 100.0
    checked = simulation.get("use_cycle_to_cycle_error", False)
    windkessels = [block.scalars for block in model.blocks.values() if block.kind == "RCR"]
    cycles = engine.cycles
    if checked and windkessels:
        slowest = max(values["Rd"] * values["C"] for values in windkessels)
        cycles = math.ceil(-slowest / model.period * math.log(tolerance))
    histories = engine.histories()
    whole = [(y.copy(), rates.copy()) for y, rates in islice(histories, cycles)]
    extra: list[tuple[np.ndarray, ...]] = []
    if checked and not windkessels:
        while _drift((whole + extra)[-2][0], (whole + extra)[-1][0], model) > tolerance:
            extra.append(tuple(part.copy() for part in next(histories)))
    numbers, places = _written(simulation, engine.steps_per_cycle, cycles, len(extra))
    step = model.period / engine.steps_per_cycle
    history = whole + extra
    y, rates = (np.array([history[cycle][part][at] for cycle, at in places]) for part in (0, 1))
    times = step * np.array(numbers, float)
    if not simulation.get("output_all_cycles", False):
        times = times - times[0]
    by = _by_variable if simulation.get("output_variable_based", False) else _by_vessel
    mean, derivative = simulation.get("output_mean_only", False), simulation.get("output_derivative", False)
    if mean:
        times, y, rates = np.array([np.nan]), y.mean(axis=0, keepdims=True), rates.mean(axis=0, keepdims=True)
    return by(model, times, y, rates, derivative)


def _written(simulation: dict, steps: int, cycles: int, extra: int) -> tuple[list[int], list[tuple[int, int]]]:
    """List the steps that are written: their number in time, and (cycle, step in cycle)."""
    everything, interval = simulation.get("output_all_cycles", False), simulation.get("output_interval", 1)
    last = (cycles - 1) * steps
    times, places, since = [], [], 0
    if everything or last <= 0:
        times.append(0)
        places.append((0, 0))

    def visit(number: int, place: tuple[int, int]) -> None:
        nonlocal since
        since += 1
        if since == interval or (not everything and number == last):
            if everything or number >= last:
                times.append(number)
                places.append(place)
            since = 0

    for number in range(1, cycles * steps + 1):
        visit(number, ((number - 1) // steps, (number - 1) % steps + 1))
    for cycle in range(cycles, cycles + extra):
        # svZeroDSolver counts time from zero in every added cycle.
        for number in range(1, steps + 1):
            visit(number, (cycle, number))
    return times, places


def _drift(before: np.ndarray, after: np.ndarray, model: Model) -> float:
    caps = [unknown for cap in model.caps for unknown in cap]
    means = before[:, caps].mean(axis=0), after[:, caps].mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.nan_to_num(np.abs((means[1] - means[0]) / means[0]), nan=0.0).max(initial=0.0))


def _by_vessel(model: Model, times, y, rates, derivative: bool) -> pd.DataFrame:
    tables = []
    for block in model.blocks.values():
        if block.kind not in _VESSELS:
            continue
        inlet, outlet = block.inlets[0], block.outlets[0]
        columns = {"flow_in": inlet, "flow_out": outlet, "pressure_in": inlet + 1, "pressure_out": outlet + 1}
        table = {"name": block.name, "time": times} | {name: y[:, at] for name, at in columns.items()}
        if derivative:
            table |= {f"d_{name}": rates[:, at] for name, at in columns.items()}
        tables.append(pd.DataFrame(table))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def _by_variable(model: Model, times, y, rates, derivative: bool) -> pd.DataFrame:
    table = {
        "name": np.repeat(model.variables, len(times)),
        "time": np.tile(times, model.size),
        "y": y.T.ravel(),
    }
    if derivative:
        table["ydot"] = rates.T.ravel()
    return pd.DataFrame(table)
