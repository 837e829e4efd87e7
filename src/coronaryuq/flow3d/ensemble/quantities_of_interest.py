"""What is read from a running block: wall shear in the stenosis regions, distal pressure, cap flows, diagnostics."""

import numpy as np

from coronaryuq.core.jit import numba as nb
from coronaryuq.flow3d.ensemble.geometry import Geometry
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.elements import face_vectors
from coronaryuq.flow3d.fem.lanes import LANES, absolute, fma, load, splat, store
from coronaryuq.flow3d.fem.time_step import Stepper
from coronaryuq.flow3d.fem.wall_shear import WallShear


@nb.njit(cache=True, error_model="numpy")
def _courant(tets, grad, dt, u, highest):
    """Largest |u| Δt / h of each lane into highest (1, LANES), 2|u|/h = Σ|u·∇N|."""
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

    def __init__(self, geometry: Geometry, space: Discretisation, fields: bool):
        self.space, self.geometry = space, geometry
        self.wall = WallShear(space)
        place = np.full(space.nodes, -1)
        place[space.node_of] = np.arange(space.nodes)
        on_wall = np.full(space.nodes, -1)
        on_wall[self.wall.nodes] = np.arange(len(self.wall.nodes))
        self.regions = {}
        for name, triangles in geometry.regions.items():
            nodes = on_wall[place[triangles]]
            size = np.linalg.norm(face_vectors(geometry.points, triangles), axis=1)
            area = np.bincount(nodes.ravel(), np.repeat(size / 3.0, 3), len(self.wall.nodes))
            chosen = np.flatnonzero(area)
            self.regions[name] = (chosen, area[chosen])
        self.sections = {
            name: section_weights(space.points, space.tets, *plane, name)[:2] for name, plane in geometry.planes.items()
        }
        self.fields = fields
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
        """Read wall and planes; counts for `weight` seconds."""
        self.wall.sample(stepper, weight)
        pressure = stepper.pressure
        for name, (nodes, share) in self.sections.items():
            self.distal[name] += weight * (share[:, None] * pressure[nodes]).sum(axis=0)
        if self.fields:
            self.mean_velocity += weight * stepper.u
            self.mean_pressure += weight * pressure

    def diagnose(self, stepper: Stepper) -> None:
        """Courant number, and surface integrals of velocity against the caps' flows."""
        highest = np.empty((1, LANES))
        _courant(self.space.tets, self.space.grad, self.space.dt, stepper.u, highest)
        self.courant = np.maximum(self.courant, highest[0])
        largest = np.abs(stepper.cap_flow).max(axis=0)
        for c, cap in enumerate(self.space.caps):
            normal = (cap.normal[None, :, None] * stepper.u[cap.nodes]).sum(axis=1)
            flow = (cap.nodal_area[:, None] * normal).sum(axis=0)
            self.surface_mismatch = np.maximum(self.surface_mismatch, np.abs(flow - stepper.cap_flow[c]) / largest)

    def quantities(self) -> dict[str, np.ndarray]:
        """Quantities of interest over the cycle, each (LANES,)."""
        tawss, osi = self.wall.tawss(), self.wall.osi()
        aortic = self.aortic / self.steps
        out = {}
        for name, (nodes, area) in self.regions.items():
            key = name.lower()
            out[f"ffr_{key}"] = self.distal[name] / self.wall.time / aortic
            out[f"tawss_min_{key}"] = tawss[nodes].min(axis=0)
            out[f"osi_max_{key}"] = osi[nodes].max(axis=0)
            out[f"tawss_q01_{key}"] = area_quantile(tawss[nodes], area, 0.01)
            out[f"osi_q99_{key}"] = area_quantile(osi[nodes], area, 0.99)
            out[f"tawss_mean_{key}"] = (area[:, None] * tawss[nodes]).sum(axis=0) / area.sum()
            out[f"osi_mean_{key}"] = (area[:, None] * osi[nodes]).sum(axis=0) / area.sum()
            out[f"distal_pressure_{key}"] = self.distal[name] / self.wall.time
        out["aortic_pressure"] = aortic
        return out


def area_quantile(values: np.ndarray, area: np.ndarray, share: float) -> np.ndarray:
    """Value below which `share` of the area lies, (k, samples) → (samples,): linear between the nodes' midpoints."""
    out = np.empty(values.shape[1])
    for s in range(values.shape[1]):
        order = np.argsort(values[:, s], kind="stable")
        weight = area[order]
        middle = (np.cumsum(weight) - 0.5 * weight) / weight.sum()
        out[s] = np.interp(share, middle, values[order, s])
    return out
