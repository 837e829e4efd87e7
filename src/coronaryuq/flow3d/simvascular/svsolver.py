"""svSolver with svZeroD coupling: `.svpre`, `solver.inp`, `svZeroD_interface.dat`, and what svpost makes of its
results.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_text
from coronaryuq.core.records import Record
from coronaryuq.flow3d.mesh.generation.folder import EXTERIOR, VOLUME, WALLS
from coronaryuq.flow3d.simvascular import common
from coronaryuq.flow3d.simvascular.adapter import RunFailed, Sample, launch

PREPROCESSOR = "case.svpre"
DECK = "solver.inp"
INTERFACE = "svZeroD_interface.dat"
ALL_VTU, ALL_VTP = "all_results.vtu", "all_results.vtp"
LONGEST_NAME, LONGEST_PATH = 50, 160
"""Characters that svSolver's Fortran reads of a block name and of a path."""


class SvSolver:
    """Every cap a Neumann surface coupled to svZeroDSolver's library (P-Implicit), walls without slip."""

    def __init__(self, case: common.Case):
        self.case = case
        self.solver: Mapping[str, str] = {"name": "svsolver", "coupling": "svZeroD, P-Implicit"}
        common.check_names(case, LONGEST_NAME)

    def prepare(self, sample: Sample, folder: Path) -> Path:
        run = Path(folder).resolve()
        common.begin(self.case, sample, run)
        write_text(run / PREPROCESSOR, preprocessor(self.case))
        write_text(run / DECK, deck(self.case))
        write_text(run / INTERFACE, interface(self.case, run))
        return run

    def command(self, run: Path, tasks: int) -> list[list[str]]:
        case, settings = self.case, self.case.settings
        first, last = _written(case)
        results = f"{tasks}-procs_case" if tasks > 1 else "."
        post = [settings.svpost, "-indir", results, "-outdir", ".", "-start", str(first), "-stop", str(last)]
        post += ["-incr", str(case.stride), "-sim_units_cm", "-vtkcombo", "-vtu", ALL_VTU, "-vtp", ALL_VTP, "-all"]
        return [
            [settings.svpre, PREPROCESSOR],
            launch(settings.mpi, tasks, settings.svsolver, DECK),
            post,
        ]

    def collect(self, run: Path, sample: Sample) -> Record:
        case = self.case
        frames = case.frames()
        volume, wall = common.load(run / ALL_VTU), common.load(run / ALL_VTP)
        nodes = _nodes(wall, case, run / ALL_VTP)
        place = np.argsort(_nodes(volume, case, run / ALL_VTU))
        if len(place) != len(case.geometry.points):
            raise RunFailed(f"{ALL_VTU} has {len(place)} nodes, the mesh {len(case.geometry.points)}")
        fields = common.Fields(case)
        for step in frames:
            pressure = common.field(volume, f"pressure_{step:05d}", run / ALL_VTU)[place]
            shear = np.zeros((len(case.geometry.points), 3))
            shear[nodes] = common.field(wall, f"vWSS_{step:05d}", run / ALL_VTP)
            fields.add(pressure, shear, f"step {step}")
        waves = common.histories(case, _histories(run))
        return common.record(case, sample, fields, waves, self.solver)


def _nodes(data, case: common.Case, path: Path) -> np.ndarray:
    """Mesh node of every point (k,) of a file by svpost."""
    ids = common.field(data, "GlobalNodeID", path).astype(np.int64) - 1
    if ids.min() < 0 or ids.max() >= len(case.geometry.points):
        raise RunFailed(f"{path.name} has nodes that the mesh has not")
    return ids


def _histories(run: Path) -> Path:
    """The 0D histories: in N-procs_case/ of a parallel run, beside the deck of a serial one."""
    found = [*sorted(run.glob("*-procs_case")), run]
    return next((f / common.ZEROD_DATA for f in found if (f / common.ZEROD_DATA).is_file()), run / "svZeroD_data")


def _written(case: common.Case) -> tuple[int, int]:
    """First and last step that svpost gathers: the fields of the last cycle, or of a trial as far as it goes."""
    last = case.steps - case.steps % case.stride
    first = max(case.stride, last - case.settings.steps_per_cycle + case.stride)
    return first, last


def preprocessor(case: common.Case) -> str:
    """`case.svpre`: surfaces by ModelFaceID, fluid at rest under the pressure of the 0D state."""
    caps = {name: entry for name, entry in common.face_files(case).items() if name in case.coupled.caps}
    lines = [
        f"mesh_and_adjncy_vtu {common.MESH}/{VOLUME}",
        f"set_surface_id_vtp {common.MESH}/{EXTERIOR} 1",
        *(f"set_surface_id_vtp {path} {number}" for number, path in caps.values()),
        f"fluid_density {case.density!r}",
        f"fluid_viscosity {case.viscosity!r}",
        f"read_pressure_velocity_vtu {common.INITIAL}",
        *(f"pressure_vtp {path} 0" for _, path in caps.values()),
        f"noslip_vtp {common.MESH}/{WALLS}",
        "write_numstart 0",
        "write_geombc geombc.dat.1",
        "write_restart restart.0.1",
    ]
    return "\n".join(lines) + "\n"


def deck(case: common.Case) -> str:
    """`solver.inp`."""
    settings = case.settings
    faces = common.face_files(case)
    caps = [str(faces[name][0]) for name in case.coupled.caps]
    entries = {
        "Density": case.density,
        "Viscosity": case.viscosity,
        "Number of Timesteps": case.steps,
        "Time Step Size": case.time_step,
        "Number of Timesteps between Restarts": case.stride,
        "Number of Force Surfaces": 1,
        "Surface ID's for Force Calculation": 1,
        "Force Calculation Method": "Velocity Based",
        "Print Average Solution": "True",
        "Print Error Indicators": "False",
        "Time Varying Boundary Conditions From File": "False",
        "Step Construction": " ".join(["0 1"] * settings.iterations),
        "Number of Coupled Surfaces": len(caps),
        "Pressure Coupling": "P-Implicit",
        "Number of Neumann Surfaces": len(caps),
        "List of Neumann Surfaces": " ".join(caps),
        "Use svZeroD for Boundary Conditions": "True",
        "Write svZeroD data": "True",
        "Backflow Stabilization Coefficient": settings.backflow_stabilisation,
        "Residual Control": "True",
        "Residual Criteria": settings.tolerance,
        # The default gives up on the first steps, far from the solution.
        "Residual Tolerance": "1e12",
        "Minimum Required Iterations": min(2, settings.iterations),
        "svLS Type": "NS",
        "Number of Krylov Vectors per GMRES Sweep": 100,
        "Number of Solves per Left-hand-side Formation": 1,
        "Tolerance on Momentum Equations": 0.05,
        "Tolerance on Continuity Equations": 0.05,
        "Tolerance on svLS NS Solver": 0.05,
        "Maximum Number of Iterations for svLS NS Solver": 10,
        "Maximum Number of Iterations for svLS Momentum Loop": 4,
        "Maximum Number of Iterations for svLS Continuity Loop": 400,
        "Time Integration Rule": "Second Order",
        "Time Integration Rho Infinity": 0.5,
        "Flow Advection Form": "Convective",
        "Quadrature Rule on Interior": 2,
        "Quadrature Rule on Boundary": 3,
    }
    return "".join(f"{name}: {value}\n" for name, value in entries.items())


def interface(case: common.Case, run: Path) -> str:
    """`svZeroD_interface.dat`: absolute paths, because svSolver works in N-procs_case/; the 0D state is the JSON's
    own.
    """
    faces = common.face_files(case)
    network = str(run / common.NETWORK)
    for field, path in (("run directory", network), ("zerod_library", case.settings.zerod_library)):
        if len(path) > LONGEST_PATH:
            raise InputError(INTERFACE, field, path, f"svSolver reads {LONGEST_PATH} characters; use a shorter path")
    blocks = [f"{name} {faces[name][0]}" for name in case.coupled.caps]
    items = [
        ("svZeroD interface library", [case.settings.zerod_library]),
        ("svZeroD input file", [network]),
        ("svZeroD coupling blocks and surface IDs", blocks),
        ("Initialize external coupling block flows", ["0"]),
        ("External coupling block flows", ["0.0"]),
        ("Initialize external coupling block pressures", ["0"]),
        ("External coupling block pressures", ["0.0"]),
    ]
    return "".join("\n".join([header, *values, "", ""]) for header, values in items)
