"""One time step of LANES samples: momentum, caps coupled implicitly to their 0D sides, projection.

Second-order backward differences, convection by the velocity of the step's beginning, incremental pressure correction
(Guermond, Minev & Shen 2006) with the pressure stabilised by orthogonal subscales (Codina 2000). A convecting velocity
extrapolated to the step's end would be second-order, but at Courant numbers far above one it excites waves of a dozen
steps' length that look like the slow flow behind a stenosis.
The pressure is uniform on each cap and the tangential velocity zero; Q_i is the flux of the discrete continuity
equation, Q_i = ∫∇g_i·u − stabilisation, so that the flows of a connected domain sum to zero to rounding.
"""

from typing import Protocol

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.core.simd import fma, store
from coronaryuq.flow3d.fem import momentum, projection
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.inlet import InletProfile
from coronaryuq.flow3d.fem.lanes import LANES, entry, entry_of, load, rows, splat


class Coupling(Protocol):
    """The 0D side of the caps."""

    def advance(self, flow: np.ndarray, admittance: np.ndarray, pressure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return cap flows Q (out of the domain, mL/s) and pressures P (dyn/cm2), (caps, LANES), at the step's end.

        They satisfy the domain's Q = flow − admittance (P − pressure), admittance (caps, caps, 1 or LANES), together
        with the 0D side's own equations.
        """


@njit(cache=True, error_model="numpy")
def _begin(now, old, dt, start, rate):
    """Set the velocity to start from and its time derivative by backward differences if it stayed the same."""
    for i in range(now.shape[0]):
        for c in range(3):
            for s in range(LANES):
                difference = now[i, c, s] - old[i, c, s]
                start[i, c, s] = now[i, c, s]
                rate[i, c, s] = -0.5 * difference / dt


@njit(cache=True, error_model="numpy")
def _backflow(nodes, area, normal, strength, diagonal, u, r, matrix):
    """Damp inflow through outlets (Esmaily Moghadam et al. 2011); return which lanes had any."""
    lanes = np.zeros(LANES, np.int64)
    for k in range(nodes.shape[0]):
        i = nodes[k]
        for s in range(LANES):
            inflow = u[i, 0, s] * normal[0] + u[i, 1, s] * normal[1] + u[i, 2, s] * normal[2]
            if inflow < 0.0:
                lanes[s] = 1
                weight = strength * entry_of(area, k, s) * inflow
                for c in range(3):
                    r[i, c, s] += weight * u[i, c, s]
                matrix[diagonal[i], s] -= weight
    return lanes


@njit(cache=True, error_model="numpy")
def _cap_flux(lift, b, flux):
    caps = flux.shape[0]
    for c in range(caps):
        total = splat(0.0)
        for i in range(b.shape[0]):
            total = fma(entry(lift, caps * i + c), load(b, i), total)
        store(flux, c, total)


@njit(cache=True, error_model="numpy")
def _impose(near, weight, cap_start, cap_node, change, b):
    """Move the caps' known pressure change from the right-hand side to the caps' nodes."""
    caps = change.shape[0]
    for k in range(near.shape[0]):
        i = near[k]
        for c in range(caps):
            for s in range(LANES):
                b[i, s] -= entry_of(weight, caps * k + c, s) * change[c, s]
    for c in range(caps):
        for k in range(cap_start[c], cap_start[c + 1]):
            for s in range(LANES):
                b[cap_node[k], s] = change[c, s]


class Stepper:
    """State of LANES samples and the step that moves it.

    u, u_old, u_older: velocity (n, 3, LANES) cm/s now, one and two steps ago; pressure (n, LANES) dyn/cm2; both in the
    solver's node order. cap_pressure, cap_flow (caps, LANES): dyn/cm2, and mL/s out of the domain. force: body
    force per unit mass (n, 3, LANES), cm/s2, or None.
    """

    def __init__(
        self,
        space: Discretisation,
        backflow: float = 0.5,
        momentum_tolerance: float = 3e-3,
        momentum_sweeps: int = 60,
    ):
        self.space = space
        self.backflow = backflow
        self.momentum_tolerance, self.momentum_sweeps = momentum_tolerance, momentum_sweeps
        n = space.nodes
        self.u, self.u_old, self.u_older = (np.zeros((n, 3, LANES)) for _ in range(3))
        self.kinematic_pressure = np.zeros((n, LANES))
        self.projected_gradient = np.zeros((n, 3, LANES))
        self.cap_pressure = np.zeros((len(space.caps), LANES))
        self.cap_flow = np.zeros_like(self.cap_pressure)
        self.inlets = [InletProfile(space, cap) if cap.inlet else None for cap in space.caps]
        self._rate, self._r = np.zeros((n, 3, LANES)), np.zeros((n, 3, LANES))
        self._matrix = np.zeros((len(space.pattern.column), LANES), np.float32)
        self._delta = np.zeros((n, 3, LANES), np.float32)
        self._b = np.zeros((n, LANES))
        self._flux = np.zeros_like(self.cap_pressure)
        self._cap_start = np.concatenate([[0], np.cumsum([len(k) for k in space.cap_nodes])]).astype(np.int64)
        self._cap_node = np.concatenate(space.cap_nodes).astype(np.int64)
        self._inverse_mass = rows(1.0 / space.mass)
        self._nu = rows(space.nu[None])
        self._tau, self._lift, self._near_weight = rows(space.tau), rows(space.lift), rows(space.near_weight)
        self.force: np.ndarray | None = None
        self.sweeps = np.zeros(LANES, np.int64)
        self.backflow_lanes = np.zeros(LANES, np.int64)
        self.unconverged = np.zeros(LANES, bool)
        self.alive = np.ones((1, LANES))

    @property
    def pressure(self) -> np.ndarray:
        return self.space.density * self.kinematic_pressure

    def start(self, cap_pressure: np.ndarray, cap_flow: np.ndarray) -> None:
        """Start from fluid at rest except at the inlets, with pressure harmonic between the caps' (caps, LANES)."""
        space = self.space
        self.u[:] = 0.0
        self.cap_pressure[:] = cap_pressure
        self.cap_flow[:] = cap_flow
        for c, inlet in enumerate(self.inlets):
            if inlet is not None:
                inlet.start(-cap_flow[c])
                self._set_inlet(inlet)
        self.u_old[:] = self.u
        kinematic = cap_pressure / space.density
        self.kinematic_pressure[:] = 0.0
        self.projected_gradient[:] = 0.0
        self._b[:] = 0.0
        for i in range(len(space.caps)):  # summed in a fixed order for any number of samples
            self._b += space.lift[:, i] * kinematic[i]
        self._add_potential()

    def step(self, coupling: Coupling) -> None:
        """Advance all lanes by one time step, coupled to the 0D side."""
        space = self.space
        _begin(self.u, self.u_old, space.dt, self.u_older, self._rate)
        if self.force is not None:
            self._rate -= self.force
        momentum.system(
            space.elements, space.slot, space.tau_viscous, self._nu, space.mass_rate,
            self.u_older, self._rate, self.kinematic_pressure, space.constant, self._r, self._matrix,
        )  # fmt: skip
        self.backflow_lanes[:] = 0
        for cap in space.caps:
            if not cap.inlet:
                self.backflow_lanes |= _backflow(
                    cap.nodes, rows(cap.nodal_area), cap.normal, self.backflow, space.pattern.diagonal, self.u_older,
                    self._r, self._matrix,
                )  # fmt: skip
        self._delta[:] = 0.0
        for inlet in self.inlets:
            if inlet is not None:  # the flow at the step's end is still unknown
                nodes = inlet.cap.nodes
                self._delta[nodes] = self.u[nodes] - self.u_old[nodes]
        active = self.alive.copy()
        self.sweeps = momentum.gauss_seidel(
            space.pattern, space.motion, self._matrix, self._r, self._delta, active,
            self.momentum_tolerance, self.momentum_sweeps,
        )  # fmt: skip
        self.unconverged = active[0] > 0
        star = self.u_older
        star += self._delta
        projection.divergence(
            space.pattern, space.divergence, space.spread, star, self._tau, self.projected_gradient,
            self.kinematic_pressure, self._b,
        )  # fmt: skip
        _cap_flux(self._lift, self._b, self._flux)
        admittance = space.admittance / space.density
        flow, pressure = coupling.advance(self._flux, admittance, self.cap_pressure)
        change = (pressure - self.cap_pressure) / space.density
        _impose(space.near_caps, self._near_weight, self._cap_start, self._cap_node, change, self._b)
        space.factor.solve(self._b)
        self.cap_pressure[:] = pressure
        self.cap_flow[:] = flow
        self.u_older, self.u_old, self.u = self.u_old, self.u, star
        self._add_potential(factor=1.0 / space.mass_rate)
        for c, inlet in enumerate(self.inlets):
            if inlet is not None:
                inlet.advance(-flow[c])
                self._set_inlet(inlet)

    def drop(self, lane: int) -> None:
        """Zero a lane, so that its NaNs do not slow the others."""
        self.alive[0, lane] = 0.0
        for array in self.state().values():
            array[..., lane] = 0.0

    def state(self) -> dict[str, np.ndarray]:
        """Return the arrays that the next step depends on: views, not copies."""
        arrays = {
            "u": self.u,
            "u_old": self.u_old,
            "kinematic_pressure": self.kinematic_pressure,
            "projected_gradient": self.projected_gradient,
            "cap_pressure": self.cap_pressure,
            "cap_flow": self.cap_flow,
            "alive": self.alive,
        }
        for c, inlet in enumerate(self.inlets):
            if inlet is not None:
                arrays |= {f"inlet_{c}_now": inlet.now, f"inlet_{c}_old": inlet.old}
        return arrays

    def restore(self, kept: dict[str, np.ndarray]) -> None:
        """Resume from what `state` returned."""
        for name, array in self.state().items():
            array[:] = kept[name]

    def _add_potential(self, factor: float = 0.0) -> None:
        space = self.space
        self.kinematic_pressure += self._b
        projection.correct(
            space.pattern, space.gradient, self._b, self._inverse_mass, space.motion, factor, self.u,
            self.projected_gradient,
        )  # fmt: skip

    def _set_inlet(self, inlet: InletProfile) -> None:
        cap = inlet.cap
        self.u[cap.nodes] = -cap.normal[None, :, None] * inlet.now[:, None, :]
