"""A coronary tree of resistors, solved exactly: what the 0D engine is to a campaign, at no cost."""

from dataclasses import dataclass

import numpy as np
import pytest


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


def targets_of(tree: ResistorTree, relative_sd: float = 0.2, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of target flows: r-hat's own conductance shares, neighbours anticorrelated."""
    total = tree.flows(np.ones((1, len(tree.beds))))[0].sum()
    mean = tree.weights * total
    n = len(mean)
    correlation = np.eye(n) - 0.25 * (np.eye(n, k=1) + np.eye(n, k=-1))
    deviation = relative_sd * mean
    return mean, correlation * np.outer(deviation, deviation)


@pytest.fixture
def tree() -> ResistorTree:
    return ResistorTree.of(6)
