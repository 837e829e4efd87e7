"""The 0D network around a 3D domain, and where each of its unknowns is found in the full network.

The full network's periodic state is where a coupled run starts from.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.coupling.network_without_mesh import mid_vessel, remaining_network
from coronaryuq.zerod.network.read import Network

Source = list[tuple[float, str]]


@dataclass(frozen=True)
class CoupledCase:
    """network: svZeroDSolver JSON with a FLOW block per cap. caps: their names, in the order of the mesh's faces.

    connection: cap → the 0D connection `A:B` that it stands for. place: cap → that connection in the coupled network.
    """

    network: Network
    caps: list[str]
    connection: dict[str, str]
    place: dict[str, str]
    pressures: dict[str, Source]
    flows: dict[str, str]

    def source(self, unknown: str) -> Source:
        """Weights and unknowns of the full network for an unknown of the coupled one, such as `pressure:A:B`.

        A leading `d_`, for its rate, is kept.
        """
        kind, _, place = unknown.partition(":")
        if kind.removeprefix("d_") not in ("flow", "pressure"):
            return [(1.0, unknown)]
        sides = [side.removeprefix("stub_") for side in place.split(":")]
        cap = next((side for side in sides if side in self.connection), None)
        if cap is None:
            return [(1.0, ":".join([kind, *(side.removesuffix("_downstream") for side in sides)]))]
        if kind.endswith("flow"):
            return [(1.0, f"{kind}:{self.flows[cap]}")]
        return [(weight, f"{kind}:{other}") for weight, other in self.pressures[cap]]

    def renamed(self, unknown: str) -> str:
        """Name in the coupled network of an unknown of the full one; a connection that became a cap is found there."""
        kind, _, place = unknown.partition(":")
        cap = next((cap for cap, connection in self.connection.items() if connection == place), None)
        return unknown if cap is None else f"{kind}:{self.place[cap]}"


def couple(network: Network, mesh: Mapping, file: str = "mesh.json") -> CoupledCase:
    """Take the 3D domain that `mesh` (the content of mesh.json) describes out of a network."""
    known = {vessel["vessel_name"] for vessel in network["vessels"]}
    for name in [*mesh["replaces"], *mesh["cut"]]:
        if name not in known:
            raise InputError(file, "replaces", name, "the network has no such vessel; mesh the case again")
    left = remaining_network(network, mesh)
    upstream, downstream = _beside(network)
    blocks = {block["name"]: block for block in left["external_solver_coupling_blocks"]}
    connection, place, pressures, flows = {}, {}, {}, {}
    for face in mesh["faces"]:
        if face["kind"] != "cap":
            continue
        cap, couples = face["name"], face["couples"]
        enters = couples["flow"] == "in"
        beside = blocks[cap]["connected_block"]
        if beside == "ClosedLoopHeartAndPulmonary":
            beside = "J_heart_outlet"
        place[cap] = f"{beside}:{cap}" if enters else f"{cap}:{beside}"
        if mid_vessel(face):
            vessel = couples["upstream"]
            before, after = f"{upstream[vessel]}:{vessel}", f"{vessel}:{downstream[vessel]}"
            outside = mesh["cut"][vessel]["upstream" if enters else "downstream"]["R_poiseuille"]
            share = outside if enters else 1.0 - outside
            connection[cap] = place[cap]
            pressures[cap] = [(1.0 - share, before), (share, after)]
            flows[cap] = before if enters else after
        else:
            connection[cap] = flows[cap] = f"{couples['upstream']}:{couples['downstream']}"
            pressures[cap] = [(1.0, connection[cap])]
    return CoupledCase(left, list(place), connection, place, pressures, flows)


def _beside(network: Network) -> tuple[dict[str, str], dict[str, str]]:
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
