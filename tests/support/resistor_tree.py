"""A coronary tree of resistors, solved exactly: what the 0D engine is to a campaign, at no cost."""

from dataclasses import dataclass

import numpy as np

from coronaryuq.case.network.network import Network


@dataclass(frozen=True)
class ResistorTree:
    """Aortic pressure (dyn/cm2), a shared resistance, then epicardial vessels and beds in parallel (dyn s/cm5)."""

    pressure: float
    shared: float
    epicardial: np.ndarray
    beds: np.ndarray

    @classmethod
    def of(cls, count: int, seed: int = 0) -> "ResistorTree":
        random = np.random.default_rng(seed)
        beds = 4.0e4 * count / 6 * random.uniform(0.5, 2.0, size=count)
        return cls(1.2e5, 1.5e3, beds * random.uniform(0.03, 0.25, size=count), beds)

    @property
    def weights(self) -> np.ndarray:
        return (1 / self.beds) / np.sum(1 / self.beds)

    def flows(self, multipliers: np.ndarray) -> np.ndarray:
        conductance = 1.0 / (self.epicardial + multipliers * self.beds)
        node = self.pressure / (1.0 + self.shared * conductance.sum(axis=1, keepdims=True))
        return node * conductance


class Shared(ResistorTree):
    """A tree whose shared resistance changes with the column after the multipliers."""

    def flows(self, inputs):
        n = len(self.beds)
        factor = inputs[:, n:] if inputs.shape[1] > n else 1.0
        conductance = 1.0 / (self.epicardial + inputs[:, :n] * self.beds)
        return self.pressure / (1.0 + self.shared * factor * conductance.sum(axis=1, keepdims=True)) * conductance


def targets_of(tree: ResistorTree, relative_sd: float = 0.2, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of target flows: r-hat's own conductance shares, neighbours anticorrelated."""
    total = tree.flows(np.ones((1, len(tree.beds))))[0].sum()
    mean = tree.weights * total
    n = len(mean)
    correlation = np.eye(n) - 0.25 * (np.eye(n, k=1) + np.eye(n, k=-1))
    deviation = relative_sd * mean
    return mean, correlation * np.outer(deviation, deviation)


def network_of(tree: ResistorTree) -> Network:
    """The same tree as a 0D network, with beds of capacitors that a steady flow fills and forgets."""
    beds = [
        {
            "bc_name": f"BC_{i}", "bc_type": "CORONARY",
            "bc_values": {
                "Ra1": 0.3 * r, "Ra2": 0.5 * r, "Rv1": 0.2 * r, "Ca": 1e-7, "Cc": 1e-6, "P_v": 0.0,
                "t": [0.0, 1.0], "Pim": [1e3, 1e3],
            },
        }
        for i, r in enumerate(tree.beds)
    ]  # fmt: skip
    aorta = {"bc_name": "AORTA", "bc_type": "PRESSURE", "bc_values": {"P": [tree.pressure] * 2, "t": [0.0, 1.0]}}

    def vessel(number: int, name: str, resistance: float, **ends: str) -> dict:
        return {
            "vessel_id": number, "vessel_name": name, "vessel_length": 1.0, "boundary_conditions": ends,
            "zero_d_element_type": "BloodVessel", "zero_d_element_values": {"R_poiseuille": resistance},
        }  # fmt: skip

    branches = [vessel(i + 1, f"v{i}", r, outlet=f"BC_{i}") for i, r in enumerate(tree.epicardial)]
    return Network({
        "simulation_parameters": {
            "number_of_cardiac_cycles": 5, "number_of_time_pts_per_cardiac_cycle": 21, "absolute_tolerance": 1e-9,
        },
        "boundary_conditions": [aorta, *beds],
        "junctions": [{
            "junction_name": "J0", "junction_type": "NORMAL_JUNCTION",
            "inlet_vessels": [0], "outlet_vessels": list(range(1, len(branches) + 1)),
        }],
        "vessels": [vessel(0, "root", tree.shared, inlet="AORTA"), *branches],
    })  # fmt: skip
