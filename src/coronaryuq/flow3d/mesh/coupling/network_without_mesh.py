"""The 0D network that is left when part of it is meshed: svZeroDSolver JSON with one coupling block per cap."""

from collections.abc import Mapping

from coronaryuq.case.network.network import AFTER_HEART, HEART_TYPE, Network
from coronaryuq.flow3d.mesh.description import Couples, MeshDescription

STUB = {"R_poiseuille": 0.0, "L": 0.0, "C": 0.0, "stenosis_coefficient": 0.0}
"""A vessel without resistance: svZeroDSolver couples to vessels and beds, but not to junctions."""


def remaining_network(network: Network, mesh: MeshDescription) -> Network:
    """Return the network without what the mesh replaces; each cap becomes a FLOW coupling block of the same name.

    A cap where blood leaves 3D is a coupling block at the "inlet" of the 0D block behind it; one where blood enters is
    at the "outlet" of the block before it. A cut vessel keeps its name for the part that stays; where both parts stay,
    the downstream one is called NAME_downstream.
    """
    left = network.deep_copy()
    number = {name: index for index, name in network.vessel_names.items()}
    vessels, renamed = _vessels(network, mesh)
    stubs: dict[str, dict] = {}
    couplings = [_coupling(left, cap, couples, number, renamed, stubs) for cap, couples in mesh.caps.items()]
    left["vessels"] = vessels + list(stubs.values())
    left["junctions"] = _junctions(network, mesh, number, renamed, stubs)
    used = {v for vessel in left["vessels"] for v in vessel.get("boundary_conditions", {}).values()}
    used |= {block["connected_block"] for block in couplings}
    left["boundary_conditions"] = [block for block in left["boundary_conditions"] if block["bc_name"] in used]
    at_heart = {c.downstream: cap for cap, c in mesh.caps.items() if c.upstream == AFTER_HEART}
    if left.closed_loop:
        left.heart["outlet_blocks"] = [at_heart.get(name, name) for name in left.heart["outlet_blocks"]]
    left["external_solver_coupling_blocks"] = couplings
    return left


def _vessels(network: Network, mesh: MeshDescription) -> tuple[list[dict], dict[str, tuple[str, int]]]:
    """Return the vessels that stay, and name and id of the downstream part of vessels of which both parts stay."""
    kept, renamed = [], {}
    free = max(network.vessel_names) + 1
    for vessel in network.deep_copy().vessels:
        name = vessel["vessel_name"]
        if name in mesh.replaces:
            continue
        parts = mesh.cut.get(name)
        if parts is None:
            kept.append(vessel)
            continue
        if parts.upstream is not None:
            kept.append(_part(vessel, parts.upstream, "inlet"))
        if parts.downstream is not None:
            part = _part(vessel, parts.downstream, "outlet")
            if parts.upstream is not None:
                part["vessel_name"], part["vessel_id"] = f"{name}_downstream", free
                renamed[name] = part["vessel_name"], free
                free += 1
            kept.append(part)
    return kept, renamed


def _part(vessel: Mapping, shares: Mapping[str, float], side: str) -> dict:
    """Return one side of a cut vessel: its elements scaled, and only the boundary condition on that side."""
    values = {key: value * shares.get(key, 1.0) for key, value in vessel["zero_d_element_values"].items()}
    part = {**vessel, "zero_d_element_values": values}
    part.pop("vessel_length", None)
    ends = {key: value for key, value in part.pop("boundary_conditions", {}).items() if key == side}
    return part | ({"boundary_conditions": ends} if ends else {})


def _coupling(
    left: Network, cap: str, couples: Couples, number: Mapping[str, int], renamed: Mapping, stubs: dict[str, dict]
) -> dict:
    block = couples.upstream if couples.enters else couples.downstream
    if couples.cuts_vessel:
        connected = block if couples.enters else renamed.get(block, (block,))[0]
    elif block == AFTER_HEART:
        connected = HEART_TYPE
    elif not couples.enters and block in {bc["bc_name"] for bc in left.boundary_conditions}:
        connected = block
    else:
        stubs[cap] = _stub(left, cap, block, couples.enters, max(number.values()) + 1 + len(number) + len(stubs))
        connected = stubs[cap]["vessel_name"]
    return {
        "name": cap,
        "type": "FLOW",
        "location": "outlet" if couples.enters else "inlet",
        "connected_block": connected,
        "periodic": False,
        "values": {"t": [0.0, 1.0], "Q": [1.0, 1.0]},
    }


def _stub(left: Network, cap: str, block: str, enters: bool, number: int) -> dict:
    stub = {
        "vessel_name": f"stub_{cap}",
        "vessel_id": number,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": dict(STUB),
    }
    if block in {bc["bc_name"] for bc in left.boundary_conditions}:
        stub["boundary_conditions"] = {"inlet" if enters else "outlet": block}
    return stub


def _junctions(
    network: Network, mesh: MeshDescription, number: Mapping, renamed: Mapping, stubs: Mapping
) -> list[dict]:
    """Return the junctions that stay, with the vessels that stay; a cap at a junction joins it through its stub."""
    no_inlet = {name for name, parts in mesh.cut.items() if parts.downstream is None} | set(mesh.replaces)
    no_outlet = {name for name, parts in mesh.cut.items() if parts.upstream is None} | set(mesh.replaces)
    kept = []
    for junction in network.deep_copy().junctions:
        inlets, outlets = network.junction_sides(junction)
        inlet_ids = [renamed[n][1] if n in renamed else number[n] for n in inlets if n not in no_inlet]
        outlet_ids = [number[n] for n in outlets if n not in no_outlet]
        for cap, stub in stubs.items():
            if mesh.caps[cap].upstream == junction["junction_name"]:
                outlet_ids.append(stub["vessel_id"])
            if mesh.caps[cap].downstream == junction["junction_name"]:
                inlet_ids.append(stub["vessel_id"])
        if not inlet_ids and not outlet_ids:
            continue
        junction.pop("inlet_blocks", None)
        junction.pop("outlet_blocks", None)
        kept.append({**junction, "inlet_vessels": inlet_ids, "outlet_vessels": outlet_ids})
    return kept
