"""A network as blocks, nodes and unknowns, numbered and named as in svZeroDSolver."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.case.network.network import AFTER_HEART, BEFORE_HEART, HEART, HEART_TYPE
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.parameters import (
    ACTIVATIONS,
    BOUNDARIES,
    CHAMBERS,
    CLOSED_LOOP,
    JUNCTIONS,
    VALVES,
    VESSELS,
)
from coronaryuq.zerod.network.read import check_network

INTERNAL = {
    "RCR": ("pressure_c",),
    "CORONARY": ("volume_im",),
    "CORONARY_VAR_RES": ("volume_im",),
    "ClosedLoopRCR": ("P_c",),
    "ClosedLoopCoronaryLeft": ("volume_im",),
    "ClosedLoopCoronaryRight": ("volume_im",),
    "ClosedLoopHeartAndPulmonary": (
        *("V_RA", "Q_RA", "P_RV", "V_RV", "Q_RV", "P_pul"),
        *("P_LA", "V_LA", "Q_LA", "P_LV", "V_LV", "Q_LV"),
    ),
    "ValveTanh": ("valve_status",),
    **dict.fromkeys(CHAMBERS, ("Vc",)),
}
"""Internal variables of each element, in svZeroDSolver's order."""

PERIOD = f"{HEART}.cardiac_cycle_period"
"""Name of the period in `changes`, with or without a heart in the network."""
SAME_PERIOD = 1e-9
"""Relative difference allowed between two periods: times cut from a recording differ by rounding."""


@dataclass
class Series:
    """A waveform over time: linear between its points, periodic with its own length (s) where `periodic`."""

    times: np.ndarray
    values: np.ndarray
    periodic: bool = True

    def __call__(self, time: np.ndarray) -> np.ndarray:
        if self.values.size == 1:
            return np.full(np.shape(time), self.values[0])
        if self.periodic:
            time = np.fmod(time, self.times[-1] - self.times[0])
        # svZeroDSolver extrapolates the first segment to times before the first point.
        k = np.searchsorted(self.times, time, side="left")
        k = np.minimum(k, self.times.size - 1)
        m = np.where(k > 0, k - 1, 1)
        slope = (self.values[k] - self.values[m]) / (self.times[k] - self.times[m])
        return np.where(self.times[k] == time, self.values[k], self.values[m] + slope * (time - self.times[m]))

    @property
    def mean(self) -> float:
        """Plain mean of the points, which svZeroDSolver uses for the steady initial state."""
        return float(np.sum(self.values) / self.values.size)


@dataclass
class Block:
    """One element: its kind, scalar parameters, waveforms, and the numbers of its unknowns and equations.

    `variables` are P, Q of every inlet, then of every outlet, then internal ones.
    """

    name: str
    kind: str
    scalars: dict[str, float] = field(default_factory=dict)
    series: dict[str, Series] = field(default_factory=dict)
    inlets: list[int] = field(default_factory=list)
    outlets: list[int] = field(default_factory=list)
    variables: list[int] = field(default_factory=list)
    equations: list[int] = field(default_factory=list)
    activation: str = ""
    """Activation function of a chamber."""


class Model:
    """Blocks and unknowns of a network.

    variables: names such as `flow:A:B`, `pressure:A:B`, `V_LV:CLH`, in svZeroDSolver's order.
    caps: for each vessel at a boundary the (flow, pressure) indices that the cycle-to-cycle error uses.
    period: cardiac period (s). Raises `InputError` when periods disagree or the blocks do not close the system.
    """

    def __init__(self, network: Mapping[str, Any], file: str | Path = "network"):
        self.network, self.file = check_network(network, file), file
        self.simulation: dict[str, Any] = self.network["simulation_parameters"]
        self.blocks: dict[str, Block] = {}
        self.variables: list[str] = []
        self.equations: list[str] = []
        self.period = self._consistent_period()
        connections = self._add_blocks()
        self._number(connections)
        self.index = {name: number for number, name in enumerate(self.variables)}
        self.caps = self._cap_unknowns()
        if len(self.equations) != len(self.variables):
            raise InputError(
                file,
                None,
                None,
                f"{len(self.equations)} equations for {len(self.variables)} unknowns; "
                "a block lacks a connection: check boundary_conditions of vessels and sides of junctions",
            )

    @property
    def size(self) -> int:
        return len(self.variables)

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Every scalar parameter, "BLOCK.parameter" → value, and the period."""
        scalars = {
            f"{block.name}.{name}": value for block in self.blocks.values() for name, value in block.scalars.items()
        }
        return {**scalars, PERIOD: self.period}

    def _consistent_period(self) -> float:
        """Return the common period of parameters, waveforms and heart; 1 s if none gives one."""
        periods: dict[str, float] = {}
        for block in self.network.boundary_conditions:
            periods |= _series_period(block["bc_name"], block["bc_values"], BOUNDARIES[block["bc_type"]])
        for block in self.network.couplings:
            if block.get("periodic", True):
                periods |= _series_period(block["name"], block["values"], BOUNDARIES[block["type"]])
        if self.network.closed_loop:
            periods[PERIOD] = self.network.heart["cardiac_cycle_period"]
        if self.simulation.get("cardiac_period", -1.0) >= 0:
            periods["simulation_parameters.cardiac_period"] = self.simulation["cardiac_period"]
        if not periods:
            return 1.0
        (first, period), *others = periods.items()
        for name, other in others:
            if abs(other - period) > SAME_PERIOD * period:
                raise InputError(self.file, name, other, f"inconsistent cardiac period; {first} has {period}")
        return float(period)

    def _add_blocks(self) -> list[tuple[str, str]]:
        network, connections = self.network, []
        for vessel in network.vessels:
            kind, name = vessel["zero_d_element_type"], vessel["vessel_name"]
            self._add(name, kind, vessel["zero_d_element_values"], VESSELS[kind])
            ends = vessel.get("boundary_conditions", {})
            if "inlet" in ends:
                connections.append((ends["inlet"], name))
            if "outlet" in ends:
                connections.append((name, ends["outlet"]))
        for block in network.couplings:
            periodic = block.get("periodic", True)
            self._add(block["name"], block["type"], block["values"], BOUNDARIES[block["type"]], periodic)
            if block["location"] == "inlet":
                connections.append((block["name"], block["connected_block"]))
            elif block["connected_block"] != HEART_TYPE:
                connections.append((block["connected_block"], block["name"]))
        to_heart = []
        for block in network.boundary_conditions:
            kind, name = block["bc_type"], block["bc_name"]
            self._add(name, kind, block["bc_values"], BOUNDARIES[kind])
            if kind.startswith("ClosedLoopCoronary") or (
                kind == "ClosedLoopRCR" and block["bc_values"].get("closed_loop_outlet", False)
            ):
                to_heart.append(name)
        for block in network.junctions:
            name, kind = block["junction_name"], block["junction_type"]
            inlets, outlets = network.junction_sides(block)
            values = {
                f"{key}[{i}]": value for key in JUNCTIONS[kind] for i, value in enumerate(block["junction_values"][key])
            }
            self.blocks[name] = Block(name, kind, values)
            connections += [(inlet, name) for inlet in inlets] + [(name, outlet) for outlet in outlets]
        if network.closed_loop:
            self._add(HEART, HEART_TYPE, network.heart["parameters"], CLOSED_LOOP[HEART_TYPE])
            for name in (BEFORE_HEART, AFTER_HEART):
                self.blocks[name] = Block(name, "NORMAL_JUNCTION")
            connections.append((BEFORE_HEART, HEART))
            connections += [(name, BEFORE_HEART) for name in to_heart]
            connections.append((HEART, AFTER_HEART))
            connections += [(AFTER_HEART, name) for name in network.heart["outlet_blocks"]]
        for block in network.valves:
            name, values = block["name"], block["params"]
            self._add(name, block["type"], values, VALVES[block["type"]])
            connections += [(values["upstream_block"], name), (name, values["downstream_block"])]
        for block in network.chambers:
            name, activation = block["name"], block["activation_function"]
            parameters = CHAMBERS[block["type"]] | ACTIVATIONS[activation["type"]]
            self._add(name, block["type"], block["values"] | activation, parameters)
            self.blocks[name].activation = activation["type"]
        return connections

    def _add(self, name: str, kind: str, values: dict, parameters: dict, periodic: bool = True) -> None:
        scalars, series = {}, {}
        for key, spec in parameters.items():
            if spec.flag or spec.name or key == "t":
                continue
            if spec.series:
                series[key] = Series(np.asarray(values["t"], float), np.asarray(values[key], float), periodic)
            else:
                scalars[key] = float(values.get(key, 0.0))
        self.blocks[name] = Block(name, kind, scalars, series)

    def _number(self, connections: list[tuple[str, str]]) -> None:
        for upstream, downstream in connections:
            number = len(self.variables)
            self.variables += [f"flow:{upstream}:{downstream}", f"pressure:{upstream}:{downstream}"]
            self.blocks[upstream].outlets.append(number)
            self.blocks[downstream].inlets.append(number)
        if len(set(self.variables)) < len(self.variables):
            twice = next(name for name in self.variables if self.variables.count(name) > 1)
            raise InputError(self.file, twice.split(":", 1)[1], None, "these two blocks are connected twice")
        for block in self.blocks.values():
            for flow in block.inlets + block.outlets:
                block.variables += [flow + 1, flow]
            for name in INTERNAL.get(block.kind, ()):
                block.variables.append(len(self.variables))
                self.variables.append(f"{name}:{block.name}")
            self._check_ends(block)
            first = len(self.equations)
            self.equations += [block.name] * _equations(block)
            block.equations = list(range(first, len(self.equations)))

    def _check_ends(self, block: Block) -> None:
        ends = len(block.inlets), len(block.outlets)
        if block.kind in VESSELS and ends != (1, 1):
            remedy = (
                f"has {ends[0]} inlets and {ends[1]} outlets; expected one of each: a junction or a boundary condition"
            )
            raise InputError(self.file, f"vessels.{block.name}", None, remedy)
        if block.kind in VALVES | CHAMBERS and ends != (1, 1):
            part = "valves" if block.kind in VALVES else "chambers"
            remedy = f"has {ends[0]} inlets and {ends[1]} outlets; expected one of each: a valve or a junction"
            raise InputError(self.file, f"{part}.{block.name}", None, remedy)
        if block.kind in ("NORMAL_JUNCTION", "internal_junction", "BloodVesselJunction") and 0 in ends:
            remedy = f"has {ends[0]} inlets and {ends[1]} outlets; expected at least one inlet and one outlet"
            raise InputError(self.file, f"junctions.{block.name}", None, remedy)
        if block.kind in BOUNDARIES and not any(ends):
            raise InputError(self.file, f"boundary_conditions.{block.name}", None, "is connected to no vessel")
        if block.kind.startswith("ClosedLoop") and ends != (1, 1):
            where = f"boundary_conditions.{block.name}"
            remedy = "a closed-loop boundary condition needs a vessel before it and the heart after it"
            if block.name == HEART:
                where, remedy = f"closed_loop_blocks.{HEART}", "the heart needs blocks that return to it"
            raise InputError(self.file, where, ends, remedy)

    def _cap_unknowns(self) -> list[tuple[int, int]]:
        caps = []
        for vessel in self.network.vessels:
            ends = vessel.get("boundary_conditions", {})
            block = self.blocks[vessel["vessel_name"]]
            # With both ends at a boundary svZeroDSolver uses the outlet.
            if "outlet" in ends:
                caps.append((block.outlets[0], block.outlets[0] + 1))
            elif "inlet" in ends:
                caps.append((block.inlets[0], block.inlets[0] + 1))
        return caps


def _equations(block: Block) -> int:
    ends = len(block.inlets) + len(block.outlets)
    if block.kind in ("NORMAL_JUNCTION", "internal_junction", "BloodVesselJunction"):
        return ends
    fixed = {"FLOW": 1, "PRESSURE": 1, "RESISTANCE": 1, "ClosedLoopHeartAndPulmonary": 14}
    if block.kind.startswith("ClosedLoop"):
        fixed.setdefault(block.kind, 3)
    fixed |= dict.fromkeys(("ValveTanh", *CHAMBERS), 3)
    return fixed.get(block.kind, 2)


def _series_period(name: str, values: dict, parameters: dict) -> dict[str, float]:
    for key, spec in parameters.items():
        if spec.series and key != "t" and len(values[key]) > 1:
            return {f"{name}.t": values["t"][-1] - values["t"][0]}
    return {}
