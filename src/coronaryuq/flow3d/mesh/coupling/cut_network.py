"""The 0D side of a coupled run: the remaining network, and how its unknowns map to those of the full network.

The full network's periodic state is where a coupled run starts from, and its names are those of the results.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from coronaryuq.case.network.network import AFTER_HEART, HEART_TYPE, Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.mesh.coupling.network_without_mesh import remaining_network
from coronaryuq.flow3d.mesh.description import MeshDescription

WeightedSum = list[tuple[float, str]]
"""Weights and unknowns of the full network."""


@dataclass(frozen=True)
class CutNetwork:
    """A 0D network with a 3D domain taken out.

    Parameters
    ----------
    network
        svZeroDSolver JSON with one FLOW coupling block per cap.
    caps
        Cap names, in the order of the mesh's faces.
    connection
        Cap → connection `A:B` of the full network that it cuts.
    place
        Cap → its connection in the remaining network.
    pressures, flows
        Cap → pressure (weighted) and flow of the full network at the cap, by connection.
    parts
        Vessel of the full network that the domain replaces or cuts → its parts that stay, each a vessel's name and the
        fraction of each element's value that lies in it.
    """

    network: Network
    caps: list[str]
    connection: dict[str, str]
    place: dict[str, str]
    pressures: dict[str, WeightedSum]
    flows: dict[str, str]
    parts: dict[str, list[tuple[str, Mapping[str, float]]]]

    @cached_property
    def _blocks(self) -> set[str]:
        return {element.name for element in self.network.elements()}

    def changes(self, changes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return changes of the full network for the remaining one; what lies in the 3D domain is left out."""
        found = {}
        for name, value in changes.items():
            block, _, parameter = name.rpartition(".")
            for part, shares in self.parts.get(block, [(block, {})]):
                if part in self._blocks:
                    found[f"{part}.{parameter}"] = value * shares[parameter] if parameter in shares else value
        return found

    def in_full_network(self, unknown: str) -> WeightedSum:
        """Return the full network's unknowns that give one of the remaining network, such as `pressure:A:B`.

        A leading `d_`, for the time derivative, is kept.
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

    def in_cut_network(self, unknown: str) -> str:
        """Return the remaining network's name of an unknown of the full one; a cut connection is found at its cap."""
        kind, _, place = unknown.partition(":")
        cap = next((cap for cap, connection in self.connection.items() if connection == place), None)
        return unknown if cap is None else f"{kind}:{self.place[cap]}"


def cut_network(network: Network, mesh: MeshDescription, file: str = "mesh.json") -> CutNetwork:
    """Take a meshed domain out of a network; raise `InputError` if the network lacks a vessel that it replaces."""
    known = set(network.vessel_names.values())
    for name in [*mesh.replaces, *mesh.cut]:
        if name not in known:
            raise InputError(file, "replaces", name, "the network has no such vessel; regenerate the mesh")
    left, topology = remaining_network(network, mesh), Topology(network)
    blocks = {block["name"]: block["connected_block"] for block in left.couplings}
    connection, place, pressures, flows = {}, {}, {}, {}
    for cap, couples in mesh.caps.items():
        beside = AFTER_HEART if blocks[cap] == HEART_TYPE else blocks[cap]
        place[cap] = f"{beside}:{cap}" if couples.enters else f"{cap}:{beside}"
        if couples.cuts_vessel:
            vessel = couples.upstream
            before, after = topology.inlet(vessel), topology.outlet(vessel)
            outside = mesh.cut[vessel].upstream if couples.enters else mesh.cut[vessel].downstream
            if outside is None:
                raise InputError(file, f"cut.{vessel}", None, f"lacks the side of cap {cap}; regenerate the mesh")
            share = outside["R_poiseuille"] if couples.enters else 1.0 - outside["R_poiseuille"]
            connection[cap] = place[cap]
            pressures[cap] = [(1.0 - share, before), (share, after)]
            flows[cap] = before if couples.enters else after
        else:
            connection[cap] = flows[cap] = f"{couples.upstream}:{couples.downstream}"
            pressures[cap] = [(1.0, connection[cap])]
    parts: dict[str, list[tuple[str, Mapping[str, float]]]] = {name: [] for name in mesh.replaces}
    for name, cut in mesh.cut.items():
        both = cut.upstream is not None and cut.downstream is not None
        sides = ((name, cut.upstream), (f"{name}_downstream" if both else name, cut.downstream))
        parts[name] = [(part, shares) for part, shares in sides if shares is not None]
    return CutNetwork(left, list(place), connection, place, pressures, flows, parts)
