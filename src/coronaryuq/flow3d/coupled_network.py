"""The 0D network around a 3D domain: what the mesh replaces is taken out, each cap becomes a FLOW block.

The result is svZeroDSolver JSON with `external_solver_coupling_blocks`, the form in which the SimVascular solvers want
their 0D side as well.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from coronaryuq.errors import InputError
from coronaryuq.zerod.network import Network, copy_of

Source = list[tuple[float, str]]


@dataclass(frozen=True)
class CoupledCase:
    """network: the coupled JSON. caps: names of the FLOW blocks, those of the mesh's caps.

    connection: cap → `A:B`, the 0D connection that it stands for. sources: `A:B` of the coupled network → weights and
    connections `A:B` of the full one whose pressure and flow it starts from, where the name is not the same.
    """

    network: Network
    caps: list[str]
    connection: dict[str, str]
    sources: dict[str, dict[str, Source]] = field(default_factory=dict)

    def source(self, unknown: str) -> Source:
        """Weights and unknowns of the full network for an unknown of the coupled one, such as `pressure:A:B`."""
        kind, _, place = unknown.partition(":")
        rate, kind = ("d_", kind[2:]) if kind.startswith("d_") else ("", kind)
        if place in self.sources and kind in ("flow", "pressure"):
            return [(weight, f"{rate}{kind}:{other}") for weight, other in self.sources[place][kind]]
        return [(1.0, unknown)]

    def renamed(self, unknown: str) -> str:
        """Name in the coupled network of an unknown of the full one; a connection that became a cap is found there."""
        kind, _, place = unknown.partition(":")
        for block in self.network["external_solver_coupling_blocks"]:
            name = block["name"]
            if self.connection[name] == place:
                sides = (
                    (name, block["connected_block"])
                    if block["location"] == "inlet"
                    else (block["connected_block"], name)
                )
                if block["connected_block"] == "ClosedLoopHeartAndPulmonary":
                    sides = ("J_heart_outlet", name)
                return f"{kind}:{sides[0]}:{sides[1]}"
        return unknown


def couple(network: Network, mesh: Mapping, file: str = "mesh.json") -> CoupledCase:
    """Take the 3D domain out of a network. mesh: `caps`, `replaces`, `cut` as in mesh.json."""
    network = copy_of(network)
    vessels = {vessel["vessel_name"]: vessel for vessel in network["vessels"]}
    for name in [*mesh["replaces"], *mesh["cut"]]:
        if name not in vessels:
            raise InputError(file, "replaces", name, "the network has no such vessel; mesh the case again")
    upstream, downstream = _connected(network)
    gone = {vessels[name]["vessel_id"] for name in mesh["replaces"]}
    next_id = max(vessel["vessel_id"] for vessel in network["vessels"]) + 1
    sources: dict[str, dict[str, Source]] = {}
    stubs: dict[tuple[str, str], str] = {}
    kept = [vessel for vessel in network["vessels"] if vessel["vessel_id"] not in gone]
    for name, sides in mesh["cut"].items():
        whole = vessels[name]
        kept.remove(whole)
        for side, share in sides.items():
            stub = copy_of(whole)
            stub["vessel_name"] = f"{name}_{side}"
            values = stub["zero_d_element_values"]
            for key in values:
                values[key] *= share.get(key, 0.0)
            ends = stub.pop("boundary_conditions", {})
            near = "inlet" if side == "upstream" else "outlet"
            if near in ends:
                stub["boundary_conditions"] = {near: ends[near]}
            if side == "downstream":
                stub["vessel_id"] = next_id
                _replace(network, whole["vessel_id"], next_id, "inlet_vessels")
                next_id += 1
                far = downstream[name]
                sources[f"{stub['vessel_name']}:{far}"] = _both([(1.0, f"{name}:{far}")])
            else:
                far = upstream[name]
                sources[f"{far}:{stub['vessel_name']}"] = _both([(1.0, f"{far}:{name}")])
            stubs[name, side] = stub["vessel_name"]
            kept.append(stub)
        if "upstream" not in sides:
            gone.add(whole["vessel_id"])
        if "downstream" not in sides:
            _replace(network, whole["vessel_id"], None, "inlet_vessels")
    network["vessels"] = kept
    _junctions(network, gone)
    blocks, connection = [], {}
    for cap, ends in mesh["caps"].items():
        into = ends["flow"] == "in"
        name = ends["upstream"]
        if ends["upstream"] == ends["downstream"]:
            side = "upstream" if into else "downstream"
            beside = stubs[name, side]
            share = mesh["cut"][name][side]["R_poiseuille"]
            before, after = f"{upstream[name]}:{name}", f"{name}:{downstream[name]}"
            weights = (1.0 - share, share) if into else (share, 1.0 - share)
            pressure = [(weights[0], before), (weights[1], after)]
            source = {"flow": [(1.0, before if into else after)], "pressure": pressure}
            connection[cap] = f"{beside}:{cap}" if into else f"{cap}:{beside}"
        else:
            connection[cap] = f"{ends['upstream']}:{ends['downstream']}"
            beside = ends["upstream"] if into else ends["downstream"]
            source = _both([(1.0, connection[cap])])
        sources[f"{beside}:{cap}" if into else f"{cap}:{beside}"] = source
        for loop in network.get("closed_loop_blocks", []):
            if beside == "J_heart_outlet":
                loop["outlet_blocks"] = [cap if b == ends["downstream"] else b for b in loop["outlet_blocks"]]
                beside = "ClosedLoopHeartAndPulmonary"
            loop["outlet_blocks"] = [stubs.get((b, "upstream"), b) for b in loop["outlet_blocks"]]
        blocks.append(
            {
                "name": cap,
                "type": "FLOW",
                "location": "outlet" if into else "inlet",
                "connected_block": beside,
                "periodic": False,
                "values": {"t": [0.0, 1.0], "Q": [1.0, 1.0]},
            }
        )
    network["external_solver_coupling_blocks"] = blocks
    return CoupledCase(network, list(mesh["caps"]), connection, sources)


def _both(source: Source) -> dict[str, Source]:
    return {"flow": source, "pressure": source}


def _connected(network: Network) -> tuple[dict[str, str], dict[str, str]]:
    """The block before and the block behind each vessel, by the vessel's name."""
    names = {vessel["vessel_id"]: vessel["vessel_name"] for vessel in network["vessels"]}
    upstream, downstream = {}, {}
    for vessel in network["vessels"]:
        ends = vessel.get("boundary_conditions", {})
        if "inlet" in ends:
            upstream[vessel["vessel_name"]] = ends["inlet"]
        if "outlet" in ends:
            downstream[vessel["vessel_name"]] = ends["outlet"]
    for junction in network.get("junctions", []):
        for vessel in junction.get("inlet_vessels", []):
            downstream[names[vessel]] = junction["junction_name"]
        for vessel in junction.get("outlet_vessels", []):
            upstream[names[vessel]] = junction["junction_name"]
    for loop in network.get("closed_loop_blocks", []):
        for vessel in loop["outlet_blocks"]:
            upstream[vessel] = "J_heart_outlet"
    return upstream, downstream


def _replace(network: Network, old: int, new: int | None, side: str) -> None:
    for junction in network.get("junctions", []):
        listed = junction.get(side, [])
        junction[side] = [new if k == old else k for k in listed if new is not None or k != old]


def _junctions(network: Network, gone: set[int]) -> None:
    kept = []
    for junction in network.get("junctions", []):
        before = len(junction["inlet_vessels"]) + len(junction["outlet_vessels"])
        for side in ("inlet_vessels", "outlet_vessels"):
            junction[side] = [k for k in junction[side] if k not in gone]
        left = len(junction["inlet_vessels"]) + len(junction["outlet_vessels"])
        if left or not before:
            kept.append(junction)
    network["junctions"] = kept
