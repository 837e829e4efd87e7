"""Averages over a cycle of a running block: wall shear, pressures, cap flows, fields, diagnostics."""

from collections.abc import Mapping, Sequence

import numpy as np

from coronaryuq.case.lowest_ffr import FfrPlaces, lowest_ffr
from coronaryuq.core.jit import njit
from coronaryuq.core.simd import absolute, fma, store
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES, entry, load, splat
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
            h = 12 * e + 3 * a
            total = total + absolute(fma(entry(grad, h + 2), z, fma(entry(grad, h + 1), y, entry(grad, h) * x)))
        above = 0.5 * (total - top)
        top = top + (above + absolute(above))
    store(highest, 0, (0.125 * dt) * top)


def _joined(sections: Sequence[tuple[np.ndarray, np.ndarray, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes (k,) of some sections, and each section's weights on them, (k, sections)."""
    nodes = np.unique(np.concatenate([nodes for nodes, _, _ in sections]))
    weights = np.zeros((len(nodes), len(sections)))
    for column, (own, weight, _) in enumerate(sections):
        weights[np.searchsorted(nodes, own), column] = weight
    return nodes, weights


def _samples(geometries: int) -> list[slice]:
    """Return the samples of each geometry: all of the only one, or one each."""
    return [slice(None)] if geometries == 1 else [slice(k, k + 1) for k in range(geometries)]


class Observer:
    """Integrals over a cycle for LANES samples; `reset` starts a cycle, `quantities` ends it.

    places: where the lowest FFR of each artery is sought.
    """

    def __init__(
        self,
        domain: Domain,
        space: Discretisation,
        fields: bool,
        low_shear: float,
        places: Mapping[str, FfrPlaces] | None = None,
    ):
        self.space, self.fields, self.low_shear = space, fields, low_shear
        self.places = places or {}
        self.wall = WallShear(space)
        solver_node = np.full(space.nodes, -1)
        solver_node[space.node_of] = np.arange(space.nodes)
        wall_row = np.full(space.nodes, -1)
        wall_row[self.wall.nodes] = np.arange(len(self.wall.nodes))
        geometries = range(space.places.shape[-1])
        mesh_points = np.empty_like(space.places)
        mesh_points[space.node_of] = space.places
        self.regions = {
            name: [WallRegion.of(mesh_points[..., k], triangles, wall_row[solver_node]) for k in geometries]
            for name, triangles in domain.regions.items()
        }
        self.distal_sections, self.proximal_sections = (
            {
                name: _joined(
                    [section_weights(space.places[..., k], space.elements.tets, *plane, name) for k in geometries]
                )
                for name, plane in planes.items()
            }
            for planes in (domain.planes, domain.proximal_planes)
        )
        self.reset()

    @property
    def ends(self) -> list[str]:
        """0D pressures whose mean `every_step` takes, beside that of the aorta."""
        return [end for of in self.places.values() for end in of.ends]

    def reset(self) -> None:
        self.wall.reset()
        self.distal = {name: np.zeros(LANES) for name in self.distal_sections}
        self.proximal = {name: np.zeros(LANES) for name in self.proximal_sections}
        self.at_ends = np.zeros((len(self.ends), LANES))
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

    def every_step(self, stepper: Stepper, aortic: np.ndarray, at_ends: np.ndarray) -> None:
        """Add a step, with the aortic pressure (LANES,) and those of the `ends`, (ends, LANES)."""
        self.steps += 1
        self.cap_flow += stepper.cap_flow
        self.cap_pressure += stepper.cap_pressure
        self.cap_flow_range[0] = np.fmin(self.cap_flow_range[0], stepper.cap_flow)
        self.cap_flow_range[1] = np.fmax(self.cap_flow_range[1], stepper.cap_flow)
        self.aortic += aortic
        self.at_ends += at_ends
        largest = np.abs(stepper.cap_flow).max(axis=0)
        self.imbalance = np.maximum(self.imbalance, np.abs(stepper.cap_flow.sum(axis=0)) / largest)
        self.backflow_steps += stepper.backflow_lanes
        self.unconverged_steps += stepper.unconverged
        self.sweeps += stepper.sweeps

    def at_wall_sample(self, stepper: Stepper, weight: float) -> None:
        """Add wall shear, pressure on the planes and fields with a weight of `weight` seconds."""
        self.wall.sample(stepper, weight)
        pressure = stepper.pressure
        for sums, sections in ((self.distal, self.distal_sections), (self.proximal, self.proximal_sections)):
            for name, (nodes, share) in sections.items():
                sums[name] += weight * (share * pressure[nodes]).sum(axis=0)
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
            flow = (cap.nodal_area * normal).sum(axis=0)
            self.surface_mismatch = np.maximum(self.surface_mismatch, np.abs(flow - stepper.cap_flow[c]) / largest)

    def quantities(self) -> dict[str, np.ndarray]:
        """Return the quantities of interest over the cycle, each (LANES,)."""
        tawss, osi = self.wall.tawss(), self.wall.osi()
        aortic = self.aortic / self.steps
        quantities: dict[str, np.ndarray] = {}
        for name, regions in self.regions.items():
            distal = self.distal[name] / self.wall.time
            proximal = self.proximal[name] / self.wall.time if name in self.proximal else None
            own = [
                stenosis_quantities(
                    name, distal[k], aortic[k], tawss[region.rows, k], osi[region.rows, k], region, self.low_shear,
                    None if proximal is None else proximal[k],
                )
                for region, k in zip(regions, _samples(len(regions)), strict=True)
            ]  # fmt: skip
            quantities |= {key: np.concatenate([one[key] for one in own]) for key in own[0]}
        at_ends = dict(zip(self.ends, self.at_ends / self.steps / aortic, strict=True))
        at_stenoses = {name: quantities[f"ffr_{name.lower()}"] for name in self.regions}
        return quantities | {"aortic_pressure": aortic} | lowest_ffr(self.places, at_ends, at_stenoses)

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
