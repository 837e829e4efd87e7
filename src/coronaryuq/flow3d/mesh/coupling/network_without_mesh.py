"""The 0D network that is left when part of it is meshed: svZeroDSolver JSON with one coupling block to each cap."""

from collections.abc import Mapping

from coronaryuq.zerod.network.read import Network, copy_of, junction_sides, vessel_names

STUB = {"R_poiseuille": 0.0, "L": 0.0, "C": 0.0, "stenosis_coefficient": 0.0}
"""A vessel without resistance: svZeroDSolver couples to vessels and beds, but not to junctions."""


def remaining_network(network: Network, mesh: Mapping) -> Network:
    """Remove what `mesh` (the content of `mesh.json`) replaces; caps become coupling blocks of type FLOW named as
    they are.

    A cap that blood leaves 3D by is a coupling block at the "inlet" of what follows in 0D; one that it enters by is
    at the "outlet" of what comes before. A cut vessel keeps its name for the part that stays; where both parts
    stay, the downstream one is called NAME_downstream.
    """
    left = copy_of(network)
    names = vessel_names(network)
    number = {name: index for index, name in names.items()}
    caps = [face for face in mesh["faces"] if face["kind"] == "cap"]
    vessels, renamed = _vessels(network, mesh)
    stubs: dict[str, dict] = {}
    couplings = []
    for face in caps:
        couplings.append(_coupling(left, face, number, names, renamed, stubs))
    left["vessels"] = vessels + list(stubs.values())
    left["junctions"] = _junctions(network, mesh, names, number, renamed, stubs)
    used = {v for vessel in left["vessels"] for v in vessel.get("boundary_conditions", {}).values()}
    used |= {block["connected_block"] for block in couplings}
    left["boundary_conditions"] = [block for block in left["boundary_conditions"] if block["bc_name"] in used]
    for loop in left.get("closed_loop_blocks", []):
        at_heart = {c["couples"]["downstream"]: c["name"] for c in caps if c["couples"]["upstream"] == "J_heart_outlet"}
        loop["outlet_blocks"] = [at_heart.get(name, name) for name in loop["outlet_blocks"]]
    left["external_solver_coupling_blocks"] = couplings
    return left


def mid_vessel(face: Mapping) -> bool:
    """Whether a cap cuts a 0D vessel in the middle rather than a connection."""
    return face["couples"]["upstream"] == face["couples"]["downstream"]


def _vessels(network: Network, mesh: Mapping) -> tuple[list[dict], dict[str, tuple[str, int]]]:
    """Vessels that stay, and for a vessel of which both parts stay: name and id of the downstream one."""
    kept, renamed = [], {}
    free = max(vessel["vessel_id"] for vessel in network["vessels"]) + 1
    for vessel in copy_of(network)["vessels"]:
        name = vessel["vessel_name"]
        if name in mesh["replaces"]:
            continue
        parts = mesh["cut"].get(name)
        if parts is None:
            kept.append(vessel)
            continue
        if "upstream" in parts:
            kept.append(_part(vessel, parts["upstream"], "inlet"))
        if "downstream" in parts:
            part = _part(vessel, parts["downstream"], "outlet")
            if "upstream" in parts:
                part["vessel_name"], part["vessel_id"] = f"{name}_downstream", free
                renamed[name] = part["vessel_name"], free
                free += 1
            kept.append(part)
    return kept, renamed


def _part(vessel: Mapping, shares: Mapping[str, float], side: str) -> dict:
    """One side of a cut vessel: its elements scaled, and only the boundary condition on that side."""
    values = {key: value * shares.get(key, 1.0) for key, value in vessel["zero_d_element_values"].items()}
    part = {**vessel, "zero_d_element_values": values}
    part.pop("vessel_length", None)
    ends = {key: value for key, value in part.pop("boundary_conditions", {}).items() if key == side}
    return part | ({"boundary_conditions": ends} if ends else {})


def _coupling(left: Network, face: Mapping, number: Mapping, names: Mapping, renamed: Mapping, stubs: dict) -> dict:
    couples = face["couples"]
    enters = couples["flow"] == "in"
    block = couples["upstream"] if enters else couples["downstream"]
    if mid_vessel(face):
        connected = block if enters else renamed.get(block, (block,))[0]
    elif block == "J_heart_outlet":
        connected = "ClosedLoopHeartAndPulmonary"
    elif not enters and block in {bc["bc_name"] for bc in left["boundary_conditions"]}:
        connected = block
    else:
        connected = _add_stub(left, face["name"], block, enters, number, stubs)
    return {
        "name": face["name"],
        "type": "FLOW",
        "location": "outlet" if enters else "inlet",
        "connected_block": connected,
        "periodic": False,
        "values": {"t": [0.0, 1.0], "Q": [1.0, 1.0]},
    }


def _add_stub(left: Network, cap: str, block: str, enters: bool, number: Mapping, stubs: dict) -> str:
    name = f"stub_{cap}"
    stub = {
        "vessel_name": name,
        "vessel_id": max(number.values()) + 1 + len(number) + len(stubs),
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": dict(STUB),
    }
    if block in {bc["bc_name"] for bc in left["boundary_conditions"]}:
        stub["boundary_conditions"] = {"inlet" if enters else "outlet": block}
    stubs[cap] = stub
    return name


def _junctions(network: Network, mesh: Mapping, names, number, renamed, stubs) -> list[dict]:
    """Junctions that stay, with the vessels that stay; a cap at a junction takes part through its stub."""
    replaced, cut = set(mesh["replaces"]), mesh["cut"]
    kept = []
    for junction in copy_of(network).get("junctions", []):
        inlets, outlets = junction_sides(junction, names)
        inlets = [n for n in inlets if n not in replaced and (n not in cut or "downstream" in cut[n])]
        outlets = [n for n in outlets if n not in replaced and (n not in cut or "upstream" in cut[n])]
        inlet_ids = [renamed[n][1] if n in renamed else number[n] for n in inlets]
        outlet_ids = [number[n] for n in outlets]
        for face in mesh["faces"]:
            if face["kind"] == "cap" and face["name"] in stubs and not mid_vessel(face):
                if face["couples"]["upstream"] == junction["junction_name"]:
                    outlet_ids.append(stubs[face["name"]]["vessel_id"])
                if face["couples"]["downstream"] == junction["junction_name"]:
                    inlet_ids.append(stubs[face["name"]]["vessel_id"])
        if not inlet_ids and not outlet_ids:
            continue
        junction.pop("inlet_blocks", None)
        junction.pop("outlet_blocks", None)
        kept.append({**junction, "inlet_vessels": inlet_ids, "outlet_vessels": outlet_ids})
    return kept
