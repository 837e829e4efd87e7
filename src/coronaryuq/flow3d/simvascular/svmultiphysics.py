"""svMultiPhysics: `solver.xml` with the svZeroD coupling, and what it writes."""

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.records import Record
from coronaryuq.flow3d.simvascular import common
from coronaryuq.flow3d.simvascular.adapter import RunFailed, Sample, launch

DECK = "solver.xml"
RESULT = "result"


class SvMultiPhysics:
    """Every cap a Neumann face coupled to svZeroDSolver's library, walls without slip; Newtonian, rigid."""

    def __init__(self, case: common.Case):
        self.case = case
        self.solver: Mapping[str, str] = {"name": "svmultiphysics", "coupling": "svZeroD, semi-implicit"}

    def prepare(self, sample: Sample, folder: Path) -> Path:
        run = Path(folder)
        common.begin(self.case, sample, run)
        root = deck(self.case)
        ElementTree.indent(root)
        write_text(run / DECK, ElementTree.tostring(root, encoding="unicode") + "\n")
        return run

    def command(self, run: Path, tasks: int) -> list[list[str]]:
        settings = self.case.settings
        return [launch(settings.mpi, tasks, settings.svmultiphysics, DECK)]

    def collect(self, run: Path, sample: Sample) -> Record:
        case = self.case
        found = sorted(run.glob("*-procs"))
        if not found:
            raise RunFailed("no N-procs folder: svMultiPhysics never started stepping")
        results = found[-1]
        fields = common.Fields(case)
        order = None
        for step in case.frames():
            path = results / f"{RESULT}_{step:03d}.vtu"
            data = common.load(path)
            if order is None:
                order = _order(data, case, path)
            pressure = common.field(data, "Pressure", path)[order]
            fields.add(pressure, common.field(data, "WSS", path)[order], path.name)
        waves = common.histories(case, _histories(run, results))
        return common.record(case, sample, fields, waves, self.solver)


def _histories(run: Path, results: Path) -> Path:
    beside = results / common.ZEROD_DATA
    return beside if beside.is_file() else run / common.ZEROD_DATA


def _order(data, case: common.Case, path: Path) -> np.ndarray:
    """Rows of the result that hold the mesh's nodes; the writer gathers nodes by process."""
    from scipy.spatial import cKDTree

    if data.n_points != len(case.geometry.points):
        raise RunFailed(f"{path.name} has {data.n_points} nodes, the mesh {len(case.geometry.points)}")
    distance, order = cKDTree(np.asarray(data.points)).query(case.geometry.points)
    if distance.max() > 1e-5 * np.ptp(case.geometry.points):
        raise RunFailed(f"{path.name} does not lie on the mesh")
    return order


def deck(case: common.Case) -> ElementTree.Element:
    """`solver.xml` as an element tree."""
    settings = case.settings
    faces = common.face_files(case)
    root = ElementTree.Element("svMultiPhysicsFile", version="0.1")
    _fill(
        ElementTree.SubElement(root, "GeneralSimulationParameters"),
        Continue_previous_simulation="false",
        Number_of_spatial_dimensions=3,
        Number_of_time_steps=case.steps,
        Time_step_size=repr(case.time_step),
        Spectral_radius_of_infinite_time_step=0.5,
        Searched_file_name_to_trigger_stop="STOP_SIM",
        Save_results_to_VTK_format="true",
        Name_prefix_of_saved_VTK_files=RESULT,
        Increment_in_saving_VTK_files=case.stride,
        Start_saving_after_time_step=min(case.stride, case.steps),
        Increment_in_saving_restart_files=case.steps,
        Convert_BIN_to_VTK_format="false",
        Verbose="true",
        Warning="false",
        Debug="false",
    )
    mesh = ElementTree.SubElement(root, "Add_mesh", name="lumen")
    _fill(mesh, Mesh_file_path=f"{common.MESH}/mesh-complete.mesh.vtu")
    for name, (_, path) in faces.items():
        _fill(ElementTree.SubElement(mesh, "Add_face", name=name), Face_file_path=path)
    _fill(
        mesh, Initial_pressures_file_path=common.INITIAL, Initial_velocities_file_path=common.INITIAL
    )  # fmt: skip
    equation = ElementTree.SubElement(root, "Add_equation", type="fluid")
    _fill(
        equation,
        Coupled="true",
        Min_iterations=1,
        Max_iterations=settings.iterations,
        Tolerance=settings.tolerance,
        Backflow_stabilization_coefficient=settings.backflow_stabilisation,
        Density=case.density,
    )
    _fill(ElementTree.SubElement(equation, "Viscosity", model="Constant"), Value=case.viscosity)
    _fill(
        ElementTree.SubElement(equation, "Output", type="Spatial"),
        Velocity="true",
        Pressure="true",
        WSS="true",
    )
    linear = ElementTree.SubElement(equation, "LS", type="NS")
    algebra = ElementTree.SubElement(linear, "Linear_algebra", type="fsils")
    _fill(algebra, Preconditioner="fsils")
    _fill(
        linear,
        Max_iterations=10,
        NS_GM_max_iterations=3,
        NS_CG_max_iterations=500,
        Tolerance=1e-3,
        NS_GM_tolerance=1e-3,
        NS_CG_tolerance=1e-3,
        Krylov_space_dimension=50,
    )
    _fill(
        ElementTree.SubElement(equation, "svZeroDSolver_interface"),
        Coupling_type="semi-implicit",
        Configuration_file=common.NETWORK,
        Shared_library=settings.zerod_library,
    )
    for name in faces:
        condition = ElementTree.SubElement(equation, "Add_BC", name=name)
        if name in case.coupled.caps:
            _fill(condition, Type="Neu", Time_dependence="Coupled")
            _fill(ElementTree.SubElement(condition, "Coupling_interface"), svZeroDSolver_block=name)
        else:
            _fill(condition, Type="Dir", Time_dependence="Steady", Value=0.0)
    return root


def _fill(parent: ElementTree.Element, **entries) -> None:
    for name, value in entries.items():
        ElementTree.SubElement(parent, name).text = f" {value} "
