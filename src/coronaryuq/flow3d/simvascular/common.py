"""What svSolver and svMultiPhysics share: the coupled 0D side, the initial state, and reading quantities of
interest.
"""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from coronaryuq.case import case_json
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.vtk import write_vtk
from coronaryuq.core.records import Record
from coronaryuq.flow3d.ensemble.coupled_network import CoupledCase, couple
from coronaryuq.flow3d.ensemble.geometry import Geometry, read_geometry
from coronaryuq.flow3d.ensemble.quantities_of_interest import area_quantile
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.fem.elements import face_vectors
from coronaryuq.flow3d.mesh.generation import folder
from coronaryuq.flow3d.simvascular.adapter import RunFailed, Sample
from coronaryuq.flow3d.simvascular_settings import SimVascularSettings
from coronaryuq.zerod.network.beds import theta_changes
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.network.read import Network, copy_of, read_network
from coronaryuq.zerod.solver.engine import Engine

NETWORK = "svzerod_3d_coupling.json"
MESH = "mesh-complete"
INITIAL = "initial.vtu"
ZEROD_DATA = "svZeroD_data"


@dataclass(frozen=True)
class Case:
    """What all samples share. network: the tuned loop at hyperaemia; mesh_dir: `mesh-complete/`; density, viscosity
    CGS.
    """

    name: str
    network: Network
    geometry: Geometry
    mesh_dir: Path
    aorta: str
    density: float
    viscosity: float
    settings: SimVascularSettings

    @cached_property
    def engine(self) -> Engine:
        return Engine(self.network)

    @cached_property
    def coupled(self) -> CoupledCase:
        return couple(self.network, self.geometry.description)

    @property
    def period(self) -> float:
        return self.engine.model.period

    @property
    def time_step(self) -> float:
        return self.period / self.settings.steps_per_cycle

    @property
    def steps(self) -> int:
        """Time steps of a run; `stop_after` ends it early."""
        whole = self.settings.cycles * self.settings.steps_per_cycle
        return whole if self.settings.stop_after is None else min(whole, self.settings.stop_after)

    @property
    def stride(self) -> int:
        """Time steps from one written field to the next."""
        return max(1, self.settings.steps_per_cycle // self.settings.frames_per_cycle)

    def frames(self) -> list[int]:
        """Time steps of the fields of the last cycle. Raises RunFailed when the run ends before a whole cycle."""
        whole = self.settings.cycles * self.settings.steps_per_cycle
        if self.steps < whole:
            raise RunFailed(f"stopped after {self.steps} of {whole} steps, as the settings say (stop_after)")
        return [s for s in range(whole - self.settings.steps_per_cycle + 1, whole + 1) if s % self.stride == 0]


def read_case(
    case_path: str | Path, network_json: str | Path, mesh_dir: str | Path, mesh_json: str | Path, settings
) -> Case:
    """Read what all samples share; `InputError` names the file at fault."""
    case = case_json.read_case(case_path, "name", "aorta.pressure", "density", "viscosity")
    return Case(
        name=case["name"],
        network=read_network(network_json),
        geometry=read_geometry(mesh_dir, mesh_json),
        mesh_dir=Path(mesh_dir).resolve(),
        aorta=case["aorta"]["pressure"],
        density=case["density"],
        viscosity=case["viscosity"],
        settings=settings,
    )


def begin(case: Case, sample: Sample, run: Path) -> dict[str, float]:
    """Fresh run directory with the mesh, the coupled 0D JSON and the initial field; returns the initial cap pressures.

    Raises RunFailed when the 0D network has no periodic state for this sample.
    """
    shutil.rmtree(run, ignore_errors=True)
    run.mkdir(parents=True)
    (run / MESH).symlink_to(case.mesh_dir, target_is_directory=True)
    changes = theta_changes(case.network, {name: np.array([value]) for name, value in sample.theta.items()})
    result = case.engine.run(changes, periodic=True, tolerance=1e-5)
    if result.status[0] != "ok":
        raise RunFailed(f"0D start: {result.status[0]}")
    full = dict(zip(case.engine.state_names, result.state[0].tolist(), strict=True))
    network = coupled_json(case, changes, full)
    write_json(run / NETWORK, network)
    pressures = {
        cap: sum(weight * full[name] for weight, name in case.coupled.source(f"pressure:{case.coupled.place[cap]}"))
        for cap in case.coupled.caps
    }
    _initial_field(case, pressures, run / INITIAL)
    return pressures


def coupled_json(case: Case, changes: Mapping[str, np.ndarray], full: Mapping[str, float]) -> Network:
    """The 0D side as svZeroDSolver's library wants it: this sample's resistances, starting from its periodic state."""
    network = copy_of(case.coupled.network)
    blocks = {block["bc_name"]: block["bc_values"] for block in network["boundary_conditions"]}
    for name, value in changes.items():
        block, parameter = name.rsplit(".", 1)
        if block in blocks:
            blocks[block][parameter] = float(np.ravel(value)[0])
    network["simulation_parameters"] = {
        "coupled_simulation": True,
        "number_of_time_pts": case.settings.zerod_points,
        "external_step_size": case.time_step,
        "output_all_cycles": True,
        "steady_initial": False,
        # In CGS the default, 1e-8 dyn/cm2, is below rounding as soon as a 3D code's first guess of a flow is far off.
        "absolute_tolerance": 1e-5,
        "maximum_nonlinear_iterations": 100,
    }
    start, rates = {}, {}
    for unknown in Model(network).variables:
        start[unknown] = float(sum(w * full[name] for w, name in case.coupled.source(unknown)))
        rates[unknown] = float(sum(w * full[name] for w, name in case.coupled.source(f"d_{unknown}")))
    network["initial_condition"], network["initial_condition_d"] = start, rates
    return network


def _initial_field(case: Case, pressures: Mapping[str, float], path: Path) -> None:
    """Fluid at rest; in every piece the mean pressure of its caps, so that the first step does not overshoot."""
    import pyvista as pv
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    geometry = case.geometry
    n = len(geometry.points)
    i, j = np.vstack([geometry.tets[:, [0, k]] for k in (1, 2, 3)]).T
    _, label = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)
    pressure = np.zeros(n)
    for piece in range(label.max() + 1):
        here = [value for cap, value in pressures.items() if label[geometry.caps[cap][0, 0]] == piece]
        pressure[label == piece] = np.mean(here)
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: geometry.tets}, geometry.points)
    grid.point_data["GlobalNodeID"] = np.arange(1, n + 1, dtype=np.int32)
    for name in ("pressure", "Pressure"):
        grid.point_data[name] = pressure
    for name in ("velocity", "Velocity"):
        grid.point_data[name] = np.zeros((n, 3))
    write_vtk(path, grid)


class Fields:
    """Pressure and wall shear stress of the last cycle, gathered frame by frame, and what is derived from them."""

    def __init__(self, case: Case):
        self.case = case
        geometry = case.geometry
        self.sections = {
            name: section_weights(geometry.points, geometry.tets, *plane, name)[:2]
            for name, plane in geometry.planes.items()
        }
        self.distal = dict.fromkeys(self.sections, 0.0)
        self.vector = np.zeros((len(geometry.points), 3))
        self.size = np.zeros(len(geometry.points))
        self.count = 0

    def add(self, pressure: np.ndarray, shear: np.ndarray, where: str) -> None:
        """One frame: nodal pressure (n,) and wall shear stress vectors (n, 3), zero off the wall."""
        if not (np.isfinite(pressure).all() and np.isfinite(shear).all()):
            raise RunFailed(f"{where} holds values that are not finite: the run blew up")
        for name, (nodes, share) in self.sections.items():
            self.distal[name] += float(share @ pressure[nodes])
        self.vector += shear
        self.size += np.linalg.norm(shear, axis=1)
        self.count += 1

    def quantities(self, aortic: float) -> dict[str, float]:
        """Quantities of interest under the names of the record; aortic: mean aortic pressure, dyn/cm2."""
        geometry = self.case.geometry
        tawss = self.size / self.count
        osi = 0.5 * (1.0 - np.linalg.norm(self.vector, axis=1) / np.maximum(self.size, 1e-300))
        out = {"aortic_pressure": aortic}
        for name, pressure in self.distal.items():
            out[f"distal_pressure_{name.lower()}"] = pressure / self.count
            out[f"ffr_{name.lower()}"] = pressure / self.count / aortic
        for name, triangles in geometry.regions.items():
            size = np.linalg.norm(face_vectors(geometry.points, triangles), axis=1)
            area = np.bincount(triangles.ravel(), np.repeat(size / 3.0, 3), len(geometry.points))
            nodes = np.flatnonzero(area)
            key, weight = name.lower(), area[nodes]
            out[f"tawss_min_{key}"] = float(tawss[nodes].min())
            out[f"osi_max_{key}"] = float(osi[nodes].max())
            out[f"tawss_q01_{key}"] = float(area_quantile(tawss[nodes, None], weight, 0.01)[0])
            out[f"osi_q99_{key}"] = float(area_quantile(osi[nodes, None], weight, 0.99)[0])
            out[f"tawss_mean_{key}"] = float(weight @ tawss[nodes] / weight.sum())
            out[f"osi_mean_{key}"] = float(weight @ osi[nodes] / weight.sum())
        return out


def histories(case: Case, path: Path) -> dict[str, np.ndarray]:
    """0D histories that a 3D code wrote: unknown → values at the steps of the last cycle."""
    try:
        lines = path.read_text().splitlines()
    except OSError:
        raise RunFailed(f"{path.name} is missing: the 0D side never ran") from None
    names = lines[0].split()[1:] if lines else []
    try:
        table = np.array([[float(word) for word in line.split()] for line in lines[1:]])
    except ValueError:
        raise RunFailed(f"{path.name} is truncated or holds no numbers") from None
    # The file gives the state after a step under the time before it.
    if table.ndim != 2 or table.shape[1] != len(names) + 1 or len(table) < case.steps:
        raise RunFailed(f"{path.name} is truncated: {len(table)} of {case.steps} steps")
    last = table[-case.settings.steps_per_cycle :, 1:]
    if not np.isfinite(last).all():
        raise RunFailed(f"{path.name} holds values that are not finite: the 0D side blew up")
    return {name: last[:, k] for k, name in enumerate(names)}


def cap_quantities(case: Case, waves: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Mean, smallest and largest flow and mean pressure at the caps, under the names of the 0D connections."""
    out = {}
    for cap in case.coupled.caps:
        flow, pressure = waves[f"flow:{case.coupled.place[cap]}"], waves[f"pressure:{case.coupled.place[cap]}"]
        connection = case.coupled.connection[cap]
        out[f"mean_flow:{connection}"] = float(flow.mean())
        out[f"min_flow:{connection}"], out[f"max_flow:{connection}"] = float(flow.min()), float(flow.max())
        out[f"mean_pressure:{connection}"] = float(pressure.mean())
    return out


def aortic_pressure(case: Case, waves: Mapping[str, np.ndarray]) -> float:
    """Mean aortic pressure of the last cycle, dyn/cm2."""
    return float(waves[case.coupled.renamed(f"pressure:{case.aorta}")].mean())


def record(
    case: Case, sample: Sample, fields: Fields, waves: Mapping[str, np.ndarray], solver: Mapping[str, str]
) -> Record:
    """The record of a run that ended well. fields, waves: of its last cycle; solver: name and version."""
    return Record(
        sample.name,
        dict(sample.theta),
        fields.quantities(aortic_pressure(case, waves)) | cap_quantities(case, waves),
        solver=dict(solver),
        cost={"cycles": case.settings.cycles, "steps": case.steps},
        diagnostics={"steps_per_cycle": case.settings.steps_per_cycle, "frames": fields.count},
    )


def load(path: Path):
    """A VTK file that a 3D code wrote; RunFailed when it is missing or truncated."""
    import pyvista as pv

    if not path.is_file():
        raise RunFailed(f"{path.name} is missing: the run ended early")
    with open(path, "rb") as opened:
        opened.seek(max(0, path.stat().st_size - 200))
        if b"</VTKFile>" not in opened.read():
            raise RunFailed(f"{path.name} is truncated")
    data = pv.read(path)
    if data.n_points == 0:
        raise RunFailed(f"{path.name} holds no points")
    return data


def field(data, name: str, path: Path) -> np.ndarray:
    if name not in data.point_data:
        raise RunFailed(f"{path.name} has no field {name}; it has {', '.join(data.point_data) or 'none'}")
    return np.asarray(data.point_data[name], float)


def face_files(case: Case) -> dict[str, tuple[int, str]]:
    """Face name → ModelFaceID and file in the run directory, walls first."""
    mesh = folder.read(case.mesh_dir)
    return {name: (number, f"{MESH}/{folder.SURFACES}/{name}.vtp") for number, name in mesh.names.items()}


def check_names(case: Case, longest: int) -> None:
    for cap in case.coupled.caps:
        if len(cap) > longest or any(c.isspace() for c in cap):
            raise InputError(
                "mesh.json", "faces", cap, f"the solver takes names up to {longest} characters, without spaces"
            )
