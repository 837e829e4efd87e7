"""Averages over a cycle of a running block: wall shear, distal pressure, cap flows, fields, diagnostics."""

import numpy as np

from coronaryuq.core.jit import njit
from coronaryuq.core.simd import absolute, fma, store
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES, load, splat
from coronaryuq.flow3d.fem.time_step import Stepper
from coronaryuq.flow3d.fem.wall_shear import WallShear
from coronaryuq.flow3d.mesh.read_mesh import Domain
from coronaryuq.flow3d.quantities import WallRegion, stenosis_quantities


@njit(cache=True, error_model="numpy")
def _courant(elements, dt, u, highest):
    """Write the largest |u| Δt / h of each lane into highest (1, LANES), with 2|u|/h = Σ|u·∇N|."""
    tets, grad, _ = elements
    top = splat(0.0)
    for e in range(tets.shape[0]):
        x, y, z = splat(0.0), splat(0.0), splat(0.0)
        for a in range(4):
            k = 3 * np.int64(tets[e, a])
            x, y, z = x + load(u, k), y + load(u, k + 1), z + load(u, k + 2)
        total = splat(0.0)
        for a in range(4):
            total = total + absolute(fma(grad[e, a, 2], z, fma(grad[e, a, 1], y, grad[e, a, 0] * x)))
        above = 0.5 * (total - top)
        top = top + (above + absolute(above))
    store(highest, 0, (0.125 * dt) * top)


class Observer:
    """Integrals over a cycle for LANES samples; `reset` starts a cycle, `quantities` ends it."""

    def __init__(self, domain: Domain, space: Discretisation, fields: bool, low_shear: float):
        self.space, self.fields, self.low_shear = space, fields, low_shear
        self.wall = WallShear(space)
        solver_node = np.full(space.nodes, -1)
        solver_node[space.node_of] = np.arange(space.nodes)
        wall_row = np.full(space.nodes, -1)
        wall_row[self.wall.nodes] = np.arange(len(self.wall.nodes))
        self.regions = {
            name: WallRegion.of(domain.points, triangles, wall_row[solver_node])
            for name, triangles in domain.regions.items()
        }
        self.sections = {
            name: section_weights(space.points, space.elements.tets, *plane, name)[:2]
            for name, plane in domain.planes.items()
        }
        self.reset()

    def reset(self) -> None:
        self.wall.reset()
        self.distal = {name: np.zeros(LANES) for name in self.sections}
        self.cap_flow = np.zeros((len(self.space.caps), LANES))
        self.cap_pressure = np.zeros_like(self.cap_flow)
        self.cap_flow_range = np.full((2, *self.cap_flow.shape), np.nan)
        self.aortic = np.zeros(LANES)
        self.steps = 0
        self.courant = np.zeros(LANES)
        self.imbalance = np.zeros(LANES)
        self.surface_mismatch = np.zeros(LANES)
        self.backflow_steps = np.zeros(LANES)
        self.unconverged_steps = np.zeros(LANES)
        self.sweeps = np.zeros(LANES)
        if self.fields:
            self.mean_velocity = np.zeros((self.space.nodes, 3, LANES))
            self.mean_pressure = np.zeros((self.space.nodes, LANES))

    def every_step(self, stepper: Stepper, aortic: np.ndarray) -> None:
        self.steps += 1
        self.cap_flow += stepper.cap_flow
        self.cap_pressure += stepper.cap_pressure
        self.cap_flow_range[0] = np.fmin(self.cap_flow_range[0], stepper.cap_flow)
        self.cap_flow_range[1] = np.fmax(self.cap_flow_range[1], stepper.cap_flow)
        self.aortic += aortic
        largest = np.abs(stepper.cap_flow).max(axis=0)
        self.imbalance = np.maximum(self.imbalance, np.abs(stepper.cap_flow.sum(axis=0)) / largest)
        self.backflow_steps += stepper.backflow_lanes
        self.unconverged_steps += stepper.unconverged
        self.sweeps += stepper.sweeps

    def at_wall_sample(self, stepper: Stepper, weight: float) -> None:
        """Add wall shear, pressure on the planes and fields with a weight of `weight` seconds."""
        self.wall.sample(stepper, weight)
        pressure = stepper.pressure
        for name, (nodes, share) in self.sections.items():
            self.distal[name] += weight * (share[:, None] * pressure[nodes]).sum(axis=0)
        if self.fields:
            self.mean_velocity += weight * stepper.u
            self.mean_pressure += weight * pressure

    def diagnose(self, stepper: Stepper) -> None:
        """Update the Courant number and the mismatch of surface integrals of velocity with the caps' flows."""
        highest = np.empty((1, LANES))
        _courant(self.space.elements, self.space.dt, stepper.u, highest)
        self.courant = np.maximum(self.courant, highest[0])
        largest = np.abs(stepper.cap_flow).max(axis=0)
        for c, cap in enumerate(self.space.caps):
            normal = (cap.normal[None, :, None] * stepper.u[cap.nodes]).sum(axis=1)
            flow = (cap.nodal_area[:, None] * normal).sum(axis=0)
            self.surface_mismatch = np.maximum(self.surface_mismatch, np.abs(flow - stepper.cap_flow[c]) / largest)

    def quantities(self) -> dict[str, np.ndarray]:
        """Return the quantities of interest over the cycle, each (LANES,)."""
        tawss, osi = self.wall.tawss(), self.wall.osi()
        aortic = self.aortic / self.steps
        quantities: dict[str, np.ndarray] = {}
        for name, region in self.regions.items():
            distal, rows = self.distal[name] / self.wall.time, region.rows
            quantities |= stenosis_quantities(name, distal, aortic, tawss[rows], osi[rows], region, self.low_shear)
        return quantities | {"aortic_pressure": aortic}

    def diagnostics(self, k: int) -> dict[str, float]:
        """Return the numerical diagnostics of lane k over the cycle."""
        return {
            "cfl": float(self.courant[k]),
            "mass_balance": float(self.imbalance[k]),
            "surface_flow_mismatch": float(self.surface_mismatch[k]),
            "backflow_steps": int(self.backflow_steps[k]),
            "momentum_sweeps_mean": float(self.sweeps[k] / self.steps),
            "momentum_unconverged_steps": int(self.unconverged_steps[k]),
        }

    def fields_of(self, k: int) -> dict[str, np.ndarray]:
        """Return cycle averages of lane k on the mesh's nodes; empty unless fields are kept."""
        if not self.fields:
            return {}
        node_of = self.space.node_of
        fields = {}
        for name, value in (("mean_velocity", self.mean_velocity), ("mean_pressure", self.mean_pressure)):
            fields[name] = np.empty(value.shape[:-1])
            fields[name][node_of] = value[..., k] / self.wall.time
        for name, value in (("TAWSS", self.wall.tawss()), ("OSI", self.wall.osi())):
            fields[name] = np.full(self.space.nodes, np.nan)
            fields[name][node_of[self.wall.nodes]] = value[:, k]
        fields["wall_faces"] = node_of[self.space.wall_faces]
        return fields
