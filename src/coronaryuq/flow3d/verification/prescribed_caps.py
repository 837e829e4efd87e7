"""Caps with a linear relation between pressure and flow: prescribed pressure, flow or resistance."""

from collections.abc import Callable

import numpy as np


class LinearCaps:
    """α_i P_i + β_i Q_i = γ_i(t) on every cap, Q out of the domain.

    α, β: (caps,) or (caps, samples). value(time): γ (caps, samples). A pressure is α = 1, β = 0; a flow α = 0, β = 1;
    a resistance P = P_d + R Q is α = 1, β = −R, γ = P_d.
    """

    def __init__(
        self,
        alpha: np.ndarray,
        beta: np.ndarray,
        value: Callable[[float], np.ndarray],
        dt: float,
    ):
        self.alpha, self.beta, self.value, self.dt = np.asarray(alpha, float), np.asarray(beta, float), value, dt
        self.time = 0.0

    def advance(self, flow: np.ndarray, admittance: np.ndarray, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return flows and pressures (caps, samples) at the end of a step; see `fem.time_step.Coupling`."""
        self.time += self.dt
        caps, samples = flow.shape
        alpha = np.broadcast_to(self.alpha.reshape(caps, -1), (caps, samples)).T
        beta = np.broadcast_to(self.beta.reshape(caps, -1), (caps, samples)).T
        known = np.broadcast_to(self.value(self.time), (caps, samples))
        own = np.broadcast_to(admittance.reshape(caps, caps, -1), (caps, caps, samples))
        matrix = alpha[:, :, None] * np.eye(caps) - beta[:, :, None] * own.transpose(2, 0, 1)
        carried = flow + np.einsum("ijs,js->is", own, pressure)
        new = np.linalg.solve(matrix, (known - beta.T * carried).T[:, :, None])[:, :, 0].T
        return carried - np.einsum("ijs,js->is", own, new), new
