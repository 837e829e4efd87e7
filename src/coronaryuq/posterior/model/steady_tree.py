"""Steady flow through the coronary trees: nearly the mean flow of a 0D run, for a hundredth of its cost.

In a periodic state no vessel and no bed keeps blood, so that mean flows and mean pressures obey the steady equations
but for two things: the mean of Q |Q| exceeds that of the mean flow, and the pressure ahead of the trees follows the
heart. Both depend on the parameters weakly and smoothly.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.core.jit import njit
from coronaryuq.zerod.network.beds import beds
from coronaryuq.zerod.network.numbering import Model

ROUNDS, ENOUGH = 40, 1e-6
"""Iterations at most, and relative change of each flow at which they end."""
LEAST = 1e-6
"""Flow at least, over that of the whole pressure: a large negative coefficient leaves no outlet without flow."""


class SteadyTree:
    """The vessels ahead of coronary beds, at one constant pressure, as if no blood went elsewhere.

    Parameters
    ----------
    network, file
        A checked network and its file.
    names
        Beds whose flows are wanted.
    pressure
        Mean pressure ahead over that behind the beds, in the network's unit.
    """

    def __init__(self, network: Network, file: str | Path, names: list[str], pressure: float):
        self.pressure = pressure
        own, topology, known = Model(network, file).parameters, Topology(network), beds(network)
        inside = {vessel: not known.keys().isdisjoint(topology.outlets_below(vessel)) for vessel in topology.vessels}
        # Parents come before children. A vessel with two parents counts with the one found first.
        below = (vessel for root in topology.roots for vessel in topology.subtree(root))
        self.vessels = [vessel for vessel in dict.fromkeys(below) if inside[vessel]]
        place = {vessel: k for k, vessel in enumerate(self.vessels)}
        self.parent = np.full(len(self.vessels), -1)
        for vessel in reversed(self.vessels):
            for child in topology.children(vessel):
                if inside[child]:
                    self.parent[place[child]] = place[vessel]
        self.wanted = np.array([place[topology.vessel_of[name]] for name in names])
        # R, K and the bed's resistance of each vessel, and the parameters that they are the sums of.
        self.values = np.zeros((3, len(self.vessels)))
        self.places: dict[str, tuple[float, int, int]] = {}
        for k, vessel in enumerate(self.vessels):
            names_of = [(f"{vessel}.R_poiseuille", 0), (f"{vessel}.stenosis_coefficient", 1)]
            bed = known.get(topology.outlet_bc.get(vessel, ""))
            if bed is not None:
                names_of += [(f"{bed.name}.{name}", 2) for name in (bed.arterial, bed.myocardial[0], bed.venous)]
            for name, part in names_of:
                value = own.get(name, 0.0)
                self.values[part, k] += value
                self.places[name] = (value, part, k)

    def flows(self, changes: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the flows (n, N) of the wanted beds for changes (n,) of the network's parameters.

        All are positive, or none is a number: where a resistance is negative or infinite, as far in the tails of a
        normal law, no flow is steady.
        """
        n = max((np.size(values) for values in changes.values()), default=1)
        values = np.repeat(self.values[:, :, None], n, axis=2)
        for name, changed in changes.items():
            if name in self.places:
                own, part, k = self.places[name]
                values[part, k] += changed - own
        return _flows(self.parent, *values, self.pressure)[:, self.wanted]


@njit(cache=True)
def _flows(parent, linear, quadratic, behind, pressure):
    """Solve R Q + K Q |Q| in every vessel by Newton's method; a negative K, which gains pressure, by fixed point."""
    count, n = linear.shape
    flows = np.zeros((n, count))
    slope, offset = np.empty(count), np.empty(count)
    conductance, source, ahead = np.empty(count), np.empty(count), np.empty(count)
    for row in range(n):
        steady = True
        for _ in range(ROUNDS):
            # Pressure lost up to the bed is slope Q + offset.
            conductance[:], source[:] = 0.0, 0.0
            for v in range(count - 1, -1, -1):
                q, k = flows[row, v], quadratic[v, row]
                slope[v] = linear[v, row] + (2.0 * k * abs(q) if k > 0.0 else 0.0)
                offset[v] = -k * q * abs(q) if k > 0.0 else k * q * abs(q)
                further, rise = behind[v, row], 0.0
                if conductance[v] > 0.0:
                    further += 1.0 / conductance[v]
                    rise = source[v] / conductance[v]
                # From here on they are those from the vessel's start to the pressure behind all beds.
                ahead[v] = slope[v] + further
                if not 0.0 < ahead[v] < np.inf:
                    steady = False
                    break
                total = offset[v] + rise
                if parent[v] >= 0:
                    conductance[parent[v]] += 1.0 / ahead[v]
                    source[parent[v]] += total / ahead[v]
                source[v] = total
            if not steady:
                flows[row] = np.nan
                break
            change = 0.0
            for v in range(count):
                start = pressure if parent[v] < 0 else conductance[parent[v]]
                q = max((start - source[v]) / ahead[v], LEAST * pressure / ahead[v])
                # The pressure at its end, which its children start from.
                conductance[v] = start - slope[v] * q - offset[v]
                change = max(change, abs(q - flows[row, v]) / q)
                flows[row, v] = q
            if change < ENOUGH:
                break
    return flows
