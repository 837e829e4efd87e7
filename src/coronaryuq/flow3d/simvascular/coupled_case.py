"""What svSolver and svMultiPhysics share before a run: the coupled 0D side, the initial state, and names of faces."""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.vtk import write_vtk
from coronaryuq.flow3d.adapter import FlowModel, Sample
from coronaryuq.flow3d.mesh.generation import folder
from coronaryuq.flow3d.shapes import Shapes
from coronaryuq.flow3d.simvascular.program import RunFailed
from coronaryuq.flow3d.simvascular_settings import SimVascularSettings
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.network.numbering import Model
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.theta import theta_changes

NETWORK = "svzerod_3d_coupling.json"
MESH = "mesh-complete"
INITIAL = "initial.vtu"
ZEROD_DATA = "svZeroD_data"


@dataclass(frozen=True)
class CoupledCase(FlowModel):
    """What all samples share, with the mesh as a `mesh-complete` folder and the settings of the SimVascular codes.

    low_shear: wall shear stress below which it counts as low, dyn/cm2; shape: lumen of the sample, None: the mesh's.
    """

    mesh_folder: Path
    settings: SimVascularSettings
    low_shear: float
    shape: Shapes | None = None

    @classmethod
    def of(
        cls, model: FlowModel, mesh_folder: str | Path, settings: SimVascularSettings, low_shear: float
    ) -> "CoupledCase":
        shared = (model.domain, model.network, model.aorta, model.density, model.viscosity)
        return cls(*shared, Path(mesh_folder).resolve(), settings, low_shear, tree=model.tree, case=model.case)

    def drawn(self, sample: Sample, mesh_folder: Path) -> "CoupledCase":
        """Return the case with the lumen of a sample, whose mesh is written to `mesh_folder`; itself if it is known.

        Raises `RunFailed` if the sample's lumen has no valid mesh.
        """
        shapes = self.shapes({name: np.array([value]) for name, value in sample.theta.items()}, 1)
        if shapes is None:
            return self
        if shapes.reasons[0]:
            raise RunFailed(shapes.reasons[0])
        shutil.rmtree(mesh_folder, ignore_errors=True)
        if shapes.remeshed:
            mesh = shapes.remeshed[0].mesh
        else:
            mesh = replace(folder.read(self.mesh_folder), points=shapes.points[0])
        folder.write(mesh_folder, mesh)
        return replace(
            self,
            domain=shapes.domain(0, self.domain),
            mesh_folder=mesh_folder,
            shape=shapes,
            viscosity=float(shapes.viscosity[0]),
        )

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
        """Return the time steps of the last cycle's fields; raise `RunFailed` if the run stops before all cycles."""
        whole = self.settings.cycles * self.settings.steps_per_cycle
        if self.steps < whole:
            raise RunFailed(f"stopped after {self.steps} of {whole} steps (setting stop_after)")
        return [s for s in range(whole - self.settings.steps_per_cycle + 1, whole + 1) if s % self.stride == 0]


def begin(case: CoupledCase, sample: Sample, run: Path) -> None:
    """Make a fresh run directory with the mesh, the coupled 0D JSON and the initial field.

    Raises `RunFailed` if the 0D network has no periodic state for this sample.
    """
    shutil.rmtree(run, ignore_errors=True)
    run.mkdir(parents=True)
    (run / MESH).symlink_to(case.mesh_folder, target_is_directory=True)
    changes = theta_changes(case.network, {name: np.array([value]) for name, value in sample.theta.items()})
    loop = changes if case.shape is None else case.shape.start(changes, case.network)
    result = case.engine.run_to_periodic(loop, periodicity=Periodicity(tolerance=1e-5))
    if result.status[0] != "ok":
        raise RunFailed(f"0D start: {result.status[0]}")
    full = dict(zip(case.engine.state_names, result.state[0].tolist(), strict=True))
    network = coupled_json(case, changes, full)
    write_json(run / NETWORK, network)
    pressures = {
        cap: sum(weight * full[name] for weight, name in case.coupled.in_full_network(f"pressure:{place}"))
        for cap, place in case.coupled.place.items()
    }
    _initial_field(case, pressures, run / INITIAL)


def coupled_json(case: CoupledCase, changes: Mapping[str, np.ndarray], full: Mapping[str, float]) -> Network:
    """Return the 0D side for svZeroDSolver's library: this sample's values, starting from its periodic state."""
    beside = case.coupled.changes(changes)
    if case.shape is not None:
        beside = case.shape.beside(beside, case.coupled.network)
    own = {name: float(np.ravel(value)[0]) for name, value in beside.items()}
    network = with_changes(case.coupled.network, own).for_svzerodsolver()
    network["simulation_parameters"] = {
        "coupled_simulation": True,
        "number_of_time_pts": case.settings.zerod_points,
        "external_step_size": case.time_step,
        "output_all_cycles": True,
        "steady_initial": False,
        # The default, 1e-8 dyn/cm2, is below rounding error if a 3D code's first guess of a flow is far off.
        "absolute_tolerance": 1e-5,
        "maximum_nonlinear_iterations": 100,
    }
    start, rates = {}, {}
    for unknown in Model(network).variables:
        start[unknown] = float(sum(w * full[name] for w, name in case.coupled.in_full_network(unknown)))
        rates[unknown] = float(sum(w * full[name] for w, name in case.coupled.in_full_network(f"d_{unknown}")))
    network["initial_condition"], network["initial_condition_d"] = start, rates
    return network


def _initial_field(case: CoupledCase, pressures: Mapping[str, float], path: Path) -> None:
    """Write fluid at rest with the mean cap pressure in every piece, so that the first step does not overshoot."""
    import pyvista as pv
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    domain = case.domain
    n = len(domain.points)
    i, j = np.vstack([domain.tets[:, [0, k]] for k in (1, 2, 3)]).T
    _, label = connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)
    pressure = np.zeros(n)
    for piece in range(label.max() + 1):
        here = [value for cap, value in pressures.items() if label[domain.caps[cap][0, 0]] == piece]
        pressure[label == piece] = np.mean(here)
    grid = pv.UnstructuredGrid({pv.CellType.TETRA: domain.tets}, domain.points)
    grid.point_data["GlobalNodeID"] = np.arange(1, n + 1, dtype=np.int32)
    for name in ("pressure", "Pressure"):
        grid.point_data[name] = pressure
    for name in ("velocity", "Velocity"):
        grid.point_data[name] = np.zeros((n, 3))
    write_vtk(path, grid)


def face_files(case: CoupledCase) -> dict[str, tuple[int, str]]:
    """Return face name → ModelFaceID and file in the run directory, walls first."""
    mesh = folder.read(case.mesh_folder)
    return {name: (number, f"{MESH}/{folder.SURFACES}/{name}.vtp") for number, name in mesh.names.items()}


def check_names(case: CoupledCase, longest: int) -> None:
    """Raise `InputError` for a cap name that a code cannot read."""
    for cap in case.coupled.caps:
        if len(cap) > longest or any(c.isspace() for c in cap):
            raise InputError(
                "mesh.json", "faces", cap, f"the solver takes names of up to {longest} characters without spaces"
            )
