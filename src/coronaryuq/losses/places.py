"""Where 3D and 0D can be compared, and between which of these places a 0D vessel lies."""

from collections.abc import Iterable
from dataclasses import dataclass

from coronaryuq.case.case_json import CaseStenosis
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.flow3d.mesh.coupling.cut_network import cut_network
from coronaryuq.flow3d.mesh.description import MeshDescription

RESISTANCE, QUADRATIC = "R_poiseuille", "stenosis_coefficient"


@dataclass(frozen=True)
class Place:
    """A mean pressure that both models have: at a cap where blood leaves the mesh, or distal to a stenosis.

    name: of the cap or the stenosis. output: its name in the records of 3D runs. location: the 0D connection `A:B`
    next to it, or behind it. resistance: of the part of a 0D vessel between the cap and that connection, dyn s/cm5.
    """

    name: str
    output: str
    location: str
    resistance: float


@dataclass(frozen=True)
class Edge:
    """0D vessels in series between two places, or branchings, of the 3D domain.

    vessels: from the first to the last. outside: fraction of each vessel's resistance that lies outside the domain;
    outside_quadratic: of its stenosis coefficient.
    carrier: the one with the largest resistance inside, where a quadratic loss of the edge is put.
    """

    vessels: tuple[str, ...]
    outside: tuple[float, ...]
    outside_quadratic: tuple[float, ...]
    carrier: str


def places(network: Network, mesh: MeshDescription, stenoses: Iterable[CaseStenosis]) -> list[Place]:
    """Return the places where the mean pressures of both models are compared, caps first.

    A cap where blood enters is none of them: its pressure comes from 0D.
    """
    topology, names = Topology(network), cut_network(network, mesh).connection
    found = []
    for cap, couples in mesh.caps.items():
        if couples.enters:
            continue
        output = f"mean_pressure:{names[cap]}"
        if not couples.cuts_vessel:
            found.append(Place(cap, output, f"{couples.upstream}:{couples.downstream}", 0.0))
            continue
        vessel = couples.upstream
        resistance = _share(mesh.cut[vessel].downstream, RESISTANCE) * network.vessel_values(vessel)[RESISTANCE]
        found.append(Place(cap, output, topology.outlet(vessel), resistance))
    found += [Place(s.name, f"distal_pressure_{s.name.lower()}", s.ffr, 0.0) for s in stenoses]
    return found


def edges(network: Network, mesh: MeshDescription, compared: Iterable[Place]) -> list[Edge]:
    """Return the 0D vessels of the 3D domain, in pieces of which each has one loss.

    Vessels that have no resistance of their own to change are left out.
    """
    topology, known = Topology(network), {place.location for place in compared}
    order = [name for root in topology.roots for name in topology.subtree(root)]
    inside = [
        name for name in order if name in {*mesh.replaces, *mesh.cut} and RESISTANCE in network.vessel_values(name)
    ]

    def begins(name: str) -> bool:
        feeding = [parent for parent in topology.parents(name) if parent in inside]
        if not feeding or topology.inlet(name) in known or topology.outlet(feeding[0]) in known:
            return True
        return len([child for child in topology.children(feeding[0]) if child in inside]) > 1

    found: list[list[str]] = []
    for name in inside:
        if begins(name):
            found.append([name])
        else:
            next(chain for chain in found if topology.parents(name)[0] == chain[-1]).append(name)
    return [_edge(network, mesh, chain) for chain in found]


def _edge(network: Network, mesh: MeshDescription, chain: list[str]) -> Edge:
    outside = {key: tuple(_outside(mesh, name, key) for name in chain) for key in (RESISTANCE, QUADRATIC)}
    within = [
        (1.0 - share) * network.vessel_values(name)[RESISTANCE]
        for name, share in zip(chain, outside[RESISTANCE], strict=True)
    ]
    return Edge(tuple(chain), outside[RESISTANCE], outside[QUADRATIC], chain[within.index(max(within))])


def _outside(mesh: MeshDescription, vessel: str, element: str) -> float:
    """Return the fraction of an element's value that lies outside the domain.

    That of an entrance follows from the speed at the cap, not from that along the vessel, and may exceed one.
    """
    cut = mesh.cut.get(vessel)
    return 0.0 if cut is None else min(1.0, _share(cut.upstream, element) + _share(cut.downstream, element))


def _share(part: dict[str, float] | None, element: str) -> float:
    return 0.0 if part is None else part[element]
