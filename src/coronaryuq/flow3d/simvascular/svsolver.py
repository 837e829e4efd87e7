"""svSolver with svZeroD coupling: `.svpre`, `solver.inp`, `svZeroD_interface.dat`, and the results by svpost."""

from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.records import Record
from coronaryuq.flow3d.adapter import Sample
from coronaryuq.flow3d.mesh.generation.folder import EXTERIOR, VOLUME, WALLS
from coronaryuq.flow3d.simvascular import coupled_case, results
from coronaryuq.flow3d.simvascular.code import SimVascularCode
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase
from coronaryuq.flow3d.simvascular.program import RunFailed, launch
from coronaryuq.flow3d.simvascular.templates import render

PREPROCESSOR = "case.svpre"
DECK = "solver.inp"
INTERFACE = "svZeroD_interface.dat"
ALL_VTU, ALL_VTP = "all_results.vtu", "all_results.vtp"
LONGEST_NAME, LONGEST_PATH = 50, 160
"""Characters that svSolver's Fortran reads of a block name and of a path."""


PREPROCESSOR_TEMPLATE = """\
mesh_and_adjncy_vtu {{ mesh }}/{{ volume }}
set_surface_id_vtp {{ mesh }}/{{ exterior }} 1
{% for number, path in caps.values() %}
set_surface_id_vtp {{ path }} {{ number }}
{% endfor %}
fluid_density {{ case.density }}
fluid_viscosity {{ case.viscosity }}
read_pressure_velocity_vtu {{ initial }}
{% for _, path in caps.values() %}
pressure_vtp {{ path }} 0
{% endfor %}
noslip_vtp {{ mesh }}/{{ walls }}
write_numstart 0
write_geombc geombc.dat.1
write_restart restart.0.1
"""

DECK_TEMPLATE = """\
Density: {{ case.density }}
Viscosity: {{ case.viscosity }}
Number of Timesteps: {{ case.steps }}
Time Step Size: {{ case.time_step }}
Number of Timesteps between Restarts: {{ case.stride }}
Number of Force Surfaces: 1
Surface ID's for Force Calculation: 1
Force Calculation Method: Velocity Based
Print Average Solution: True
Print Error Indicators: False
Time Varying Boundary Conditions From File: False
Step Construction: {{ (["0 1"] * settings.iterations) | join(" ") }}
Number of Coupled Surfaces: {{ caps | length }}
Pressure Coupling: P-Implicit
Number of Neumann Surfaces: {{ caps | length }}
List of Neumann Surfaces: {{ caps.values() | map("first") | join(" ") }}
Use svZeroD for Boundary Conditions: True
Write svZeroD data: True
Backflow Stabilization Coefficient: {{ settings.backflow_stabilisation }}
Residual Control: True
Residual Criteria: {{ settings.tolerance }}
{# The default gives up on the first steps, far from the solution. #}
Residual Tolerance: 1e12
Minimum Required Iterations: {{ [2, settings.iterations] | min }}
svLS Type: NS
Number of Krylov Vectors per GMRES Sweep: 100
Number of Solves per Left-hand-side Formation: 1
Tolerance on Momentum Equations: 0.05
Tolerance on Continuity Equations: 0.05
Tolerance on svLS NS Solver: 0.05
Maximum Number of Iterations for svLS NS Solver: 10
Maximum Number of Iterations for svLS Momentum Loop: 4
Maximum Number of Iterations for svLS Continuity Loop: 400
Time Integration Rule: Second Order
Time Integration Rho Infinity: 0.5
Flow Advection Form: Convective
Quadrature Rule on Interior: 2
Quadrature Rule on Boundary: 3
"""

INTERFACE_TEMPLATE = """\
svZeroD interface library
{{ settings.zerod_library }}

svZeroD input file
{{ zerod_input }}

svZeroD coupling blocks and surface IDs
{% for name, (number, _) in caps.items() %}
{{ name }} {{ number }}
{% endfor %}

Initialize external coupling block flows
0

External coupling block flows
0.0

Initialize external coupling block pressures
0

External coupling block pressures
0.0

"""


class SvSolver(SimVascularCode):
    """Every cap a Neumann surface coupled to svZeroDSolver's library (P-Implicit), walls without slip."""

    name = "svsolver"
    coupling = "svZeroD, P-Implicit"

    def __init__(self, case: CoupledCase, tasks: int = 1):
        super().__init__(case, tasks)
        coupled_case.check_names(case, LONGEST_NAME)

    def prepare(self, sample: Sample, run: Path) -> None:
        coupled_case.begin(self.case, sample, run)
        write_text(run / PREPROCESSOR, preprocessor(self.case))
        write_text(run / DECK, deck(self.case))
        write_text(run / INTERFACE, interface(self.case, run))

    def commands(self) -> list[list[str]]:
        case, settings = self.case, self.case.settings
        first, last = _written(case)
        folder = f"{self.tasks}-procs_case" if self.tasks > 1 else "."
        post = [settings.svpost, "-indir", folder, "-outdir", ".", "-start", str(first), "-stop", str(last)]
        post += ["-incr", str(case.stride), "-sim_units_cm", "-vtkcombo", "-vtu", ALL_VTU, "-vtp", ALL_VTP, "-all"]
        return [[settings.svpre, PREPROCESSOR], launch(settings.mpi, self.tasks, settings.svsolver, DECK), post]

    def collect(self, run: Path, sample: Sample) -> Record:
        case = self.case
        frames = case.frames()
        volume, wall = results.load(run / ALL_VTU), results.load(run / ALL_VTP)
        nodes = _nodes(wall, case, run / ALL_VTP)
        place = np.argsort(_nodes(volume, case, run / ALL_VTU))
        if len(place) != len(case.domain.points):
            raise RunFailed(f"{ALL_VTU} has {len(place)} nodes, the mesh {len(case.domain.points)}")
        fields = results.Fields(case)
        for step in frames:
            pressure = results.field(volume, f"pressure_{step:05d}", run / ALL_VTU)[place]
            shear = np.zeros((len(case.domain.points), 3))
            shear[nodes] = results.field(wall, f"vWSS_{step:05d}", run / ALL_VTP)
            fields.add(pressure, shear, f"step {step}")
        waves = results.histories(case, _histories(run))
        return results.record(case, sample, fields, waves, self.solver)


def _nodes(data: Any, case: CoupledCase, path: Path) -> np.ndarray:
    """Return the mesh node of every point (k,) of a file by svpost."""
    ids = results.field(data, "GlobalNodeID", path).astype(np.int64) - 1
    if ids.min() < 0 or ids.max() >= len(case.domain.points):
        raise RunFailed(f"{path.name} has nodes that are not in the mesh")
    return ids


def _histories(run: Path) -> Path:
    """Return the file of 0D histories: in N-procs_case/ of a parallel run, beside the deck of a serial one."""
    files = [folder / coupled_case.ZEROD_DATA for folder in (*sorted(run.glob("*-procs_case")), run)]
    return next((file for file in files if file.is_file()), files[-1])


def _written(case: CoupledCase) -> tuple[int, int]:
    """Return first and last step that svpost gathers: the last cycle, or as far as a trial goes."""
    last = case.steps - case.steps % case.stride
    first = max(case.stride, last - case.settings.steps_per_cycle + case.stride)
    return first, last


def preprocessor(case: CoupledCase) -> str:
    """Return `case.svpre`: surfaces by ModelFaceID, fluid at rest under the pressure of the 0D state."""
    return render(PREPROCESSOR_TEMPLATE, case, volume=VOLUME, exterior=EXTERIOR, walls=WALLS)


def deck(case: CoupledCase) -> str:
    """Return `solver.inp`."""
    return render(DECK_TEMPLATE, case)


def interface(case: CoupledCase, run: Path) -> str:
    """Return `svZeroD_interface.dat`, with absolute paths because svSolver works in N-procs_case/.

    Flows and pressures are not initialised here: the network's JSON holds the initial state.
    """
    network = str(run / coupled_case.NETWORK)
    for field, path in (("run directory", network), ("zerod_library", case.settings.zerod_library)):
        if len(path) > LONGEST_PATH:
            raise InputError(INTERFACE, field, path, f"svSolver reads {LONGEST_PATH} characters; use a shorter path")
    return render(INTERFACE_TEMPLATE, case, zerod_input=network)
