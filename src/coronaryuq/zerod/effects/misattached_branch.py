"""Branch that the model attaches to the wrong vessel: a wiring error of the model, not an effect in the patient."""

from collections.abc import Sequence

import networkx as nx
import numpy as np

from coronaryuq.case.network.network import GRAFTED, Network
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.base import ConditionState, Parameter, Series, Values
from coronaryuq.zerod.effects.grafting import (
    add_vessel,
    attach,
    detach_outlet,
    grafted,
    grafted_name,
    locations_renamed,
    open_end,
    put_ahead,
)
from coronaryuq.zerod.effects.wiring_error import WiringError

FROM = " from "
"""Between the branch and the vessel of a place."""
TAG = "origin"
"""Suffix of the vessel that replaces the start of a branch."""
CLOSED = 1e3
"""Resistance of a connection that carries almost nothing, over pressure per flow of its branch.

The solver chooses its pivots for the branch where it is in the model. Where it has moved, flows rounded at 1e-16 become
pressures rounded at CLOSED times 1e-16 of the root's, and Newton's method has to get below its tolerance all the same.
"""
PARTIAL = 0.1
"""Resistance of both connections where a branch arises half from either node, in the same unit."""
FARTHEST = 2
"""Number of branchings from the stated to the true origin of a branch, at most."""


class MisattachedBranch(WiringError):
    """Branch that arises elsewhere than in the model. Places: BRANCH from VESSEL, at the end of which it arises."""

    name = "misattached_branch"
    formula = "P at the start of the branch = P at the end of the vessel, which carries its flow, where s = 1"
    source = "error in the order of the branches or in the connections of the network"
    signature = "flows between the stated and the true origin differ by that of the branch, in every condition"
    native = "the outlet vessels of two junctions"
    grafted = True
    parameters = (Parameter("share", "1", "lognormal", 1.0, 0.05, "1 if the branch arises there, and nowhere else"),)

    def places(self, anatomy: Anatomy, observed: Sequence[Series] = ()) -> list[str]:
        return [f"{name}{FROM}{vessel}" for name in anatomy.coronary_vessels for vessel in _origins(anatomy, name)]

    def insert(self, network: Network, place: str, anatomy: Anatomy) -> Network:
        branch, vessel = place.split(FROM)
        if not grafted(network, f"{branch}_{TAG}"):
            network = put_ahead(network, _first(anatomy, branch), TAG, stem=f"{branch}_{TAG}")
        network, junction, _ = open_end(network, vessel, TAG)
        closed = CLOSED * anatomy.pressure / anatomy.flow_scale(branch)
        number = add_vessel(network, _stem(place), {"R_poiseuille": closed})
        attach(network, junction, "outlet", number)
        attach(network, _start(network, branch), "inlet", number)
        return network

    def aliases(self, place: str, anatomy: Anatomy) -> dict[str, str]:
        branch, vessel = place.split(FROM)
        renamed = locations_renamed(anatomy, vessel, TAG)
        if not grafted(anatomy.network, f"{branch}_{TAG}"):
            first = _first(anatomy, branch)
            renamed[anatomy.inlet(first)] = f"{_start(anatomy.network, branch)}:{first}"
        return renamed

    def changes(
        self, network: Network, place: str, sizes: Values, anatomy: Anatomy, condition: ConditionState
    ) -> Values:
        branch, _ = place.split(FROM)
        unit = PARTIAL * anatomy.pressure / anatomy.flow_scale(branch)
        share = np.clip(np.asarray(sizes["share"], dtype=float), PARTIAL / CLOSED, 1.0 - PARTIAL / CLOSED)
        return {
            f"{grafted_name(network, f'{branch}_{TAG}')}.R_poiseuille": unit * share / (1.0 - share),
            f"{grafted_name(network, _stem(place))}.R_poiseuille": unit * (1.0 - share) / share,
        }

    def statement(self, place: str) -> str:
        return "{} arises from the end of {}".format(*place.split(FROM))

    def corrected(self, network: Network, place: str) -> tuple[Network, dict[str, str]]:
        branch, vessel = place.split(FROM)
        stated = Anatomy(network).upstream[branch]
        network, true, renamed = open_end(network, vessel, TAG)
        detach_outlet(network, stated, branch)
        attach(network, true, "outlet", network.vessel(branch)["vessel_id"])
        return network, renamed | {f"{stated}:{branch}": f"{true}:{branch}"}


def _stem(place: str) -> str:
    branch, vessel = place.split(FROM)
    return f"{branch}_at_{vessel}"


def _start(network: Network, branch: str) -> str:
    """Return the name of the junction where a branch begins that can be attached elsewhere."""
    return f"J_{grafted_name(network, f'{branch}_{TAG}')}"


def _first(anatomy: Anatomy, branch: str) -> str:
    """Return the first of the vessels that other effects added ahead of a branch; the branch if there are none."""
    parents = anatomy.parents(branch)
    while len(parents) == 1 and GRAFTED in anatomy.vessels[parents[0]] and len(anatomy.children(parents[0])) == 1:
        branch, parents = parents[0], anatomy.parents(parents[0])
    return branch


def _origins(anatomy: Anatomy, branch: str) -> list[str]:
    """Return the vessels from the end of which a branch may arise instead: ends that branch, near its own origin."""
    if not any(len(anatomy.children(parent)) > 1 for parent in anatomy.parents(branch)):
        return []
    downstream = set(anatomy.subtree(branch))
    graph = nx.Graph()
    for name in anatomy.vessels:
        if name not in downstream:
            graph.add_edge(anatomy.upstream[name], anatomy.downstream[name])
    ends = {name: anatomy.downstream[name] for name in anatomy.vessels if len(anatomy.children(name)) > 1}
    branching = set(ends.values())
    distances = nx.single_source_dijkstra_path_length(
        graph, anatomy.upstream[branch], FARTHEST, weight=lambda _, end, __: int(end in branching)
    )
    return [name for name, end in ends.items() if name not in downstream and distances.get(end, 0) > 0]
