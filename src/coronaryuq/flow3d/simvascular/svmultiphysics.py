"""svMultiPhysics: `solver.xml` with the svZeroD coupling, and what the code writes."""

from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.records import Record
from coronaryuq.flow3d.adapter import Sample
from coronaryuq.flow3d.simvascular import coupled_case, results
from coronaryuq.flow3d.simvascular.code import SimVascularCode
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase
from coronaryuq.flow3d.simvascular.program import RunFailed, launch
from coronaryuq.flow3d.simvascular.templates import render

DECK = "solver.xml"
RESULT = "result"

TEMPLATE = """\
<svMultiPhysicsFile version="0.1">
  <GeneralSimulationParameters>
    <Continue_previous_simulation> false </Continue_previous_simulation>
    <Number_of_spatial_dimensions> 3 </Number_of_spatial_dimensions>
    <Number_of_time_steps> {{ case.steps }} </Number_of_time_steps>
    <Time_step_size> {{ case.time_step }} </Time_step_size>
    <Spectral_radius_of_infinite_time_step> 0.5 </Spectral_radius_of_infinite_time_step>
    <Searched_file_name_to_trigger_stop> STOP_SIM </Searched_file_name_to_trigger_stop>
    <Save_results_to_VTK_format> true </Save_results_to_VTK_format>
    <Name_prefix_of_saved_VTK_files> {{ result }} </Name_prefix_of_saved_VTK_files>
    <Increment_in_saving_VTK_files> {{ case.stride }} </Increment_in_saving_VTK_files>
    <Start_saving_after_time_step> {{ [case.stride, case.steps] | min }} </Start_saving_after_time_step>
    <Increment_in_saving_restart_files> {{ case.steps }} </Increment_in_saving_restart_files>
    <Convert_BIN_to_VTK_format> false </Convert_BIN_to_VTK_format>
    <Verbose> true </Verbose>
    <Warning> false </Warning>
    <Debug> false </Debug>
  </GeneralSimulationParameters>
  <Add_mesh name="lumen">
    <Mesh_file_path> {{ mesh }}/mesh-complete.mesh.vtu </Mesh_file_path>
    {% for name, (_, path) in faces.items() %}
    <Add_face name="{{ name }}">
      <Face_file_path> {{ path }} </Face_file_path>
    </Add_face>
    {% endfor %}
    <Initial_pressures_file_path> {{ initial }} </Initial_pressures_file_path>
    <Initial_velocities_file_path> {{ initial }} </Initial_velocities_file_path>
  </Add_mesh>
  <Add_equation type="fluid">
    <Coupled> true </Coupled>
    <Min_iterations> 1 </Min_iterations>
    <Max_iterations> {{ settings.iterations }} </Max_iterations>
    <Tolerance> {{ settings.tolerance }} </Tolerance>
    <Backflow_stabilization_coefficient> {{ settings.backflow_stabilisation }} </Backflow_stabilization_coefficient>
    <Density> {{ case.density }} </Density>
    <Viscosity model="Constant">
      <Value> {{ case.viscosity }} </Value>
    </Viscosity>
    <Output type="Spatial">
      <Velocity> true </Velocity>
      <Pressure> true </Pressure>
      <WSS> true </WSS>
    </Output>
    <LS type="NS">
      <Linear_algebra type="fsils">
        <Preconditioner> fsils </Preconditioner>
      </Linear_algebra>
      <Max_iterations> 10 </Max_iterations>
      <NS_GM_max_iterations> 3 </NS_GM_max_iterations>
      <NS_CG_max_iterations> 500 </NS_CG_max_iterations>
      <Tolerance> 0.001 </Tolerance>
      <NS_GM_tolerance> 0.001 </NS_GM_tolerance>
      <NS_CG_tolerance> 0.001 </NS_CG_tolerance>
      <Krylov_space_dimension> 50 </Krylov_space_dimension>
    </LS>
    <svZeroDSolver_interface>
      <Coupling_type> semi-implicit </Coupling_type>
      <Configuration_file> {{ network }} </Configuration_file>
      <Shared_library> {{ settings.zerod_library }} </Shared_library>
    </svZeroDSolver_interface>
    {% for name in faces %}
    <Add_BC name="{{ name }}">
      {% if name in case.coupled.caps %}
      <Type> Neu </Type>
      <Time_dependence> Coupled </Time_dependence>
      <Coupling_interface>
        <svZeroDSolver_block> {{ name }} </svZeroDSolver_block>
      </Coupling_interface>
      {% else %}
      <Type> Dir </Type>
      <Time_dependence> Steady </Time_dependence>
      <Value> 0.0 </Value>
      {% endif %}
    </Add_BC>
    {% endfor %}
  </Add_equation>
</svMultiPhysicsFile>
"""


class SvMultiPhysics(SimVascularCode):
    """Every cap a Neumann face coupled to svZeroDSolver's library, walls without slip; Newtonian, rigid."""

    name = "svmultiphysics"
    coupling = "svZeroD, semi-implicit"

    def prepare(self, sample: Sample, run: Path) -> None:
        coupled_case.begin(self.case, sample, run)
        write_text(run / DECK, deck(self.case))

    def commands(self) -> list[list[str]]:
        settings = self.case.settings
        return [launch(settings.mpi, self.tasks, settings.svmultiphysics, DECK)]

    def collect(self, run: Path, sample: Sample) -> Record:
        case = self.case
        folders = sorted(run.glob("*-procs"))
        if not folders:
            raise RunFailed("no N-procs folder: svMultiPhysics never started stepping")
        fields = results.Fields(case)
        order = None
        for step in case.frames():
            path = folders[-1] / f"{RESULT}_{step:03d}.vtu"
            data = results.load(path)
            if order is None:
                order = _order(data, case, path)
            pressure = results.field(data, "Pressure", path)[order]
            fields.add(pressure, results.field(data, "WSS", path)[order], path.name)
        beside = folders[-1] / coupled_case.ZEROD_DATA
        waves = results.histories(case, beside if beside.is_file() else run / coupled_case.ZEROD_DATA)
        return results.record(case, sample, fields, waves, self.solver)


def _order(data: Any, case: CoupledCase, path: Path) -> np.ndarray:
    """Return the rows of the result that hold the mesh's nodes; the writer gathers nodes by process."""
    from scipy.spatial import cKDTree

    points = case.domain.points
    if data.n_points != len(points):
        raise RunFailed(f"{path.name} has {data.n_points} nodes, the mesh {len(points)}")
    distance, order = cKDTree(np.asarray(data.points)).query(points)
    if distance.max() > 1e-5 * np.ptp(points):
        raise RunFailed(f"{path.name} does not lie on the mesh")
    return order


def deck(case: CoupledCase) -> str:
    """Return `solver.xml`."""
    return render(TEMPLATE, case, escape=True, result=RESULT)
