"""0D networks as svZeroDSolver JSON: reading, checking and writing them.

A network that passes the checks can be solved; errors name the file, the block and the key at fault. The equations of
each element are in `zerod.solver.elements`.
"""

import sys
from pathlib import Path
from typing import Any

from coronaryuq.case.network.network import (
    AFTER_HEART,
    BEFORE_HEART,
    COPY_OF,
    ENTRANCE,
    GRAFTED,
    HEART,
    HEART_TYPE,
    LUMEN,
    NARROWED,
    UNCERTAIN,
    Network,
)
from coronaryuq.core.errors import InputError, similar
from coronaryuq.core.io.atomic import read_json, write_json
from coronaryuq.zerod.network.blocks import check_keys, check_shapes, check_values, finite, named, register
from coronaryuq.zerod.network.parameters import (
    ACTIVATIONS,
    BOUNDARIES,
    CHAMBERS,
    CLOSED_LOOP,
    COUPLINGS,
    IGNORED,
    JUNCTIONS,
    VALVES,
    VESSELS,
    Parameter,
)

_TOP = {
    "description",
    "simulation_parameters",
    "vessels",
    "boundary_conditions",
    "junctions",
    "closed_loop_blocks",
    "external_solver_coupling_blocks",
    "initial_condition",
    "initial_condition_d",
    "valves",
    "chambers",
    UNCERTAIN,
    LUMEN,
    NARROWED,
}
_SIMULATION = {
    "coupled_simulation": bool,
    "number_of_cardiac_cycles": int,
    "number_of_time_pts_per_cardiac_cycle": int,
    "number_of_time_pts": int,
    "external_step_size": float,
    "use_cycle_to_cycle_error": bool,
    "sim_cycle_to_cycle_percent_error": float,
    "absolute_tolerance": float,
    "maximum_nonlinear_iterations": int,
    "steady_initial": bool,
    "rho_infty": float,
    "output_variable_based": bool,
    "output_interval": int,
    "output_mean_only": bool,
    "output_derivative": bool,
    "output_all_cycles": bool,
    "cardiac_period": float,
    # Written by SimVascular's front end and ignored by svZeroDSolver.
    "model_name": str,
    "density": float,
    "viscosity": float,
}
_VESSEL = {"vessel_name", "vessel_id", "vessel_length", "boundary_conditions", "zero_d_element_type"}
_VESSEL |= {"zero_d_element_values"}
# Ours, for pullbacks, ignored by svZeroDSolver: where in the vessel behind it the loss of this one lies (cm), and radii
# (cm) at even distances, and the fraction of the stenosis coefficient that stands for the entrance from the aorta; and
# what a vessel that an effect added is for.
_VESSEL |= {"placed_in", "radii", ENTRANCE, GRAFTED}
_BOUNDARY = {"bc_name", "bc_type", "bc_values", COPY_OF}
_JUNCTION = {"junction_name", "junction_type", "junction_values", "areas"}
_JUNCTION |= {"inlet_vessels", "outlet_vessels", "inlet_blocks", "outlet_blocks"}
_LOOP = {"name", "outlet_blocks", "closed_loop_type", "cardiac_cycle_period", "parameters"}
_VALVE, _CHAMBER = {"name", "type", "params"}, {"name", "type", "values", "activation_function"}
_COUPLING = {"name", "type", "location", "connected_block", "periodic", "values"}


def read_network(path: str | Path) -> Network:
    """Read an svZeroDSolver JSON file and check it; `InputError` names file, block, key and value."""
    return check_network(read_json(path), path)


def write_network(path: str | Path, network: Network) -> None:
    """Check a network and write it as svZeroDSolver JSON."""
    check_network(network, path)
    write_json(path, network)


def check_network(content: Any, file: str | Path = "network") -> Network:
    """Check that the engine knows every block, key and value, and that the blocks fit together.

    Parameters
    ----------
    content : dict
        svZeroDSolver JSON.
    file : str or Path
        Name for error messages.

    Returns
    -------
    Network
        `content` itself if it is one already.

    Raises
    ------
    InputError
        At the first fault; names block, key and value.
    """
    if not isinstance(content, dict):
        raise InputError(file, None, None, "expected a JSON object with simulation_parameters, vessels, ...")
    network = content if isinstance(content, Network) else Network(content)
    check_keys(network, _TOP | IGNORED[""], file, "")
    for required in ("simulation_parameters", "boundary_conditions"):
        if required not in network:
            raise InputError(file, required, None, "missing")
    if not isinstance(network["simulation_parameters"], dict):
        raise InputError(file, "simulation_parameters", network["simulation_parameters"], "expected an object")
    check_shapes(network, file)
    _check_simulation(network["simulation_parameters"], file)
    names: dict[str, str] = {}
    for vessel in named(network, "vessels", "vessel_name", file):
        _check_vessel(vessel, names, file)
    for block in named(network, "external_solver_coupling_blocks", "name", file):
        _check_coupling(block, names, file)
    for block in named(network, "boundary_conditions", "bc_name", file):
        _check_boundary(block, names, file)
    for valve in named(network, "valves", "name", file):
        register(valve, "name", "type", VALVES, names, file, "valves")
        check_keys(valve, _VALVE, file, f"valves.{valve['name']}")
        check_values(valve, "params", VALVES[valve["type"]], file, f"valves.{valve['name']}")
    for chamber in named(network, "chambers", "name", file):
        _check_chamber(chamber, names, file)
    if len(network.vessel_names) < len(network.vessels):
        raise InputError(file, "vessels", None, "two vessels share a vessel_id; give each vessel its own vessel_id")
    for junction in named(network, "junctions", "junction_name", file):
        _check_junction(junction, names, network, file)
    _check_closed_loop(network, names, file)
    _check_references(network, names, file)
    return network


def print_notes(network: Network, file: str | Path) -> None:
    """Print possible mistakes that svZeroDSolver accepts in a checked network, one line each, on standard error.

    Negative resistances, and keys that svZeroDSolver ignores.
    """
    negative = [
        f"{name}.{key} = {value:g}"
        for _, name, _, values in network.elements()
        for key, given in values.items()
        if key.startswith("R")  # every such parameter is a resistance, and no other is
        for value in (given if isinstance(given, list) else [given])
        if value < 0
    ]
    if negative:
        more = f" (and {len(negative) - 1} more)" if len(negative) > 1 else ""
        print(f"note: {file}: {negative[0]}: negative resistance{more}", file=sys.stderr)
    for part, known in IGNORED.items():
        entries = network.get(part, []) if part else [network]
        for key in sorted(known & {key for entry in entries for key in entry}):
            where = f"{part}.{key}" if part else key
            print(f"note: {file}: {where}: ignored, as svZeroDSolver does", file=sys.stderr)


def _check_simulation(block: dict, file) -> None:
    where = "simulation_parameters"
    check_keys(block, set(_SIMULATION), file, where)
    for key, kind in _SIMULATION.items():
        if key not in block:
            continue
        value = block[key]
        fits = {
            bool: isinstance(value, bool),
            int: finite(value) and float(value).is_integer(),
            float: finite(value),
            str: isinstance(value, str),
        }[kind]
        if not fits:
            raise InputError(file, f"{where}.{key}", value, f"expected a {kind.__name__}")
    needed = ["number_of_cardiac_cycles", "number_of_time_pts_per_cardiac_cycle"]
    if block.get("coupled_simulation", False):
        needed = ["number_of_time_pts"]
    for key in needed:
        if key not in block:
            raise InputError(file, f"{where}.{key}", None, "missing")
        if block[key] < (2 if "time_pts" in key else 1):
            raise InputError(file, f"{where}.{key}", block[key], "too small")
    if not 0.0 <= block.get("rho_infty", 0.5) <= 1.0:
        raise InputError(file, f"{where}.rho_infty", block["rho_infty"], "expected a spectral radius from 0 to 1")
    for key in ("absolute_tolerance", "maximum_nonlinear_iterations", "output_interval", "external_step_size"):
        if key in block and block[key] <= 0:
            raise InputError(file, f"{where}.{key}", block[key], "expected a positive number")


def _check_vessel(vessel: dict, names: dict[str, str], file) -> None:
    name = register(vessel, "vessel_name", "zero_d_element_type", VESSELS, names, file, "vessels")
    where = f"vessels.{name}"
    check_keys(vessel, _VESSEL | IGNORED["vessels"], file, where)
    if not isinstance(vessel.get("vessel_id"), int) or isinstance(vessel.get("vessel_id"), bool):
        raise InputError(file, f"{where}.vessel_id", vessel.get("vessel_id"), "expected an integer")
    check_values(vessel, "zero_d_element_values", VESSELS[vessel["zero_d_element_type"]], file, where)
    _check_course(vessel, file, where)
    for side in vessel.get("boundary_conditions", {}):
        if side not in ("inlet", "outlet"):
            raise InputError(file, f"{where}.boundary_conditions", side, "expected inlet or outlet")


def _check_course(vessel: dict, file, where: str) -> None:
    """Check what a vessel's entry says of the course of the pressure along it."""
    radii = vessel.get("radii", [1.0, 1.0])
    if not isinstance(radii, list) or len(radii) < 2 or not all(finite(radius) and radius > 0.0 for radius in radii):
        raise InputError(file, f"{where}.radii", None, "expected at least two positive radii (cm) at even distances")
    share = vessel.get(ENTRANCE, 0.0)
    if not finite(share) or not 0.0 <= share <= 1.0:
        raise InputError(file, f"{where}.{ENTRANCE}", share, "expected a fraction of the stenosis coefficient, 0 to 1")
    extent = vessel.get("placed_in", {"start": 0.0, "end": 0.0})
    ends: list = [extent.get("start"), extent.get("end")] if isinstance(extent, dict) else [None]
    if not all(finite(end) for end in ends) or not 0.0 <= ends[0] <= ends[1]:
        raise InputError(file, f"{where}.placed_in", None, "expected {start: , end: }, cm in the vessel behind it")


def _check_boundary(block: dict, names: dict[str, str], file) -> None:
    name = register(block, "bc_name", "bc_type", BOUNDARIES, names, file, "boundary_conditions")
    check_keys(block, _BOUNDARY, file, f"boundary_conditions.{name}")
    check_values(block, "bc_values", BOUNDARIES[block["bc_type"]], file, f"boundary_conditions.{name}")


def _check_chamber(chamber: dict, names: dict[str, str], file) -> None:
    name = register(chamber, "name", "type", CHAMBERS, names, file, "chambers")
    where = f"chambers.{name}"
    check_keys(chamber, _CHAMBER, file, where)
    check_values(chamber, "values", CHAMBERS[chamber["type"]], file, where)
    activation = chamber.get("activation_function", {})
    kind = activation.get("type")
    if kind not in ACTIVATIONS:
        remedy = f"unknown activation function; known: {', '.join(ACTIVATIONS)}"
        raise InputError(file, f"{where}.activation_function.type", kind, remedy)
    parameters = {"type": Parameter(name=True), **ACTIVATIONS[kind]}
    check_values(chamber, "activation_function", parameters, file, where)


def _check_coupling(block: dict, names: dict[str, str], file) -> None:
    name = register(block, "name", "type", COUPLINGS, names, file, "external_solver_coupling_blocks")
    where = f"external_solver_coupling_blocks.{name}"
    check_keys(block, _COUPLING, file, where)
    check_values(block, "values", COUPLINGS[block["type"]], file, where)
    if block.get("location") not in ("inlet", "outlet"):
        raise InputError(file, f"{where}.location", block.get("location"), "expected inlet or outlet")
    if not isinstance(block.get("connected_block"), str):
        raise InputError(file, f"{where}.connected_block", block.get("connected_block"), "expected a block's name")


def _check_junction(block: dict, names: dict[str, str], network: Network, file) -> None:
    name = register(block, "junction_name", "junction_type", JUNCTIONS, names, file, "junctions")
    where = f"junctions.{name}"
    check_keys(block, _JUNCTION, file, where)
    for side in ("inlet", "outlet"):
        if f"{side}_vessels" in block:
            for number in block[f"{side}_vessels"]:
                if number not in network.vessel_names:
                    raise InputError(file, f"{where}.{side}_vessels", number, "no vessel has this vessel_id")
        elif f"{side}_blocks" not in block:
            raise InputError(file, f"{where}.{side}_vessels", None, "missing")
    parameters = JUNCTIONS[block["junction_type"]]
    if not parameters:
        if block.get("junction_values"):
            check_keys(block["junction_values"], set(), file, f"{where}.junction_values")
        return
    inlets, outlets = network.junction_sides(block)
    if block["junction_type"] == "BloodVesselJunction" and len(inlets) != 1:
        raise InputError(file, f"{where}.inlet_vessels", inlets, "a BloodVesselJunction has one inlet")
    values = block.get("junction_values", {})
    check_keys(values, set(parameters), file, f"{where}.junction_values")
    for key, spec in parameters.items():
        if key not in values and not spec.required:
            continue
        numbers = values.get(key)
        if not isinstance(numbers, list) or len(numbers) != len(outlets) or not all(map(finite, numbers)):
            raise InputError(
                file,
                f"{where}.junction_values.{key}",
                numbers,
                f"expected a list of {len(outlets)} numbers, one per outlet",
            )


def _check_closed_loop(network: Network, names: dict[str, str], file) -> None:
    blocks = network.get("closed_loop_blocks", [])
    if len(blocks) > 1:
        raise InputError(
            file, "closed_loop_blocks", len(blocks), "only one ClosedLoopHeartAndPulmonary can be included"
        )
    for block in blocks:
        where = f"closed_loop_blocks.{HEART}"
        check_keys(block, _LOOP, file, where)
        kind = block.get("closed_loop_type")
        if kind not in CLOSED_LOOP:
            raise InputError(
                file, f"{where}.closed_loop_type", kind, f"unknown element; known: {', '.join(CLOSED_LOOP)}"
            )
        check_values(block, "parameters", CLOSED_LOOP[kind], file, where)
        period = block.get("cardiac_cycle_period")
        if not finite(period) or period <= 0:
            raise InputError(file, f"{where}.cardiac_cycle_period", period, "expected a positive time in s")
        if not isinstance(block.get("outlet_blocks"), list) or not block["outlet_blocks"]:
            raise InputError(
                file, f"{where}.outlet_blocks", block.get("outlet_blocks"), "expected a list of block names"
            )
        for name in (HEART, BEFORE_HEART, AFTER_HEART):
            if name in names:
                raise InputError(
                    file, names[name], name, "this name belongs to the closed-loop heart; rename the block"
                )
            names[name] = where
    if not blocks:
        for block in network.boundary_conditions:
            if block["bc_type"].startswith("ClosedLoop"):
                where = f"boundary_conditions.{block['bc_name']}.bc_type"
                raise InputError(file, where, block["bc_type"], "needs a ClosedLoopHeartAndPulmonary block")


def _unknown(target: object, names: dict[str, str]) -> str:
    """State that a block is missing, with similar names."""
    return f"no block has this name; {similar(target, names)}".removesuffix("; ")


def _check_references(network: Network, names: dict[str, str], file) -> None:
    for vessel in network.vessels:
        for side, target in vessel.get("boundary_conditions", {}).items():
            if target not in names:
                where = f"vessels.{vessel['vessel_name']}.boundary_conditions.{side}"
                raise InputError(file, where, target, _unknown(target, names))
    for junction in network.junctions:
        for side in ("inlet_blocks", "outlet_blocks"):
            for target in junction.get(side, []):
                if target not in names:
                    raise InputError(
                        file, f"junctions.{junction['junction_name']}.{side}", target, _unknown(target, names)
                    )
    for block in network.get("closed_loop_blocks", []):
        for target in block["outlet_blocks"]:
            if target not in names:
                raise InputError(file, f"closed_loop_blocks.{HEART}.outlet_blocks", target, _unknown(target, names))
    for valve in network.valves:
        for side in ("upstream_block", "downstream_block"):
            if valve["params"][side] not in names:
                raise InputError(
                    file,
                    f"valves.{valve['name']}.params.{side}",
                    valve["params"][side],
                    _unknown(valve["params"][side], names),
                )
    for block in network.couplings:
        target = block["connected_block"]
        if target not in names and target != HEART_TYPE:
            where = f"external_solver_coupling_blocks.{block['name']}.connected_block"
            raise InputError(file, where, target, _unknown(target, names))
    for part in ("initial_condition", "initial_condition_d"):
        for key, value in network.get(part, {}).items():
            if not key.startswith("_") and not finite(value):
                raise InputError(file, f"{part}.{key}", value, "expected a number")
