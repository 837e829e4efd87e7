"""Compare CPU time per cycle on one mesh: svSolver, svMultiPhysics, and the ensemble solver with sixteen samples.

    python -m coronaryuq.bench.flow3d.same_mesh results/laptop svsolver:12 svmultiphysics:4

prints one JSON object. Needs a campaign's folder with its mesh and tuned loop; the programs on the PATH;
SVZEROD_INTERFACE, the path of svZeroDSolver's library; SIMVASCULAR_MPI, the launcher (default mpiexec). The number
after a program is the number of its time steps that are timed, on one rank, after the first ones, and scaled to a
cycle.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from coronaryuq.core.command_line import run_with_settings
from coronaryuq.core.errors import InputError
from coronaryuq.flow3d.adapter import Batch, Sample
from coronaryuq.flow3d.ensemble.ensemble import Ensemble
from coronaryuq.flow3d.settings import Settings
from coronaryuq.flow3d.simvascular.coupled_case import CoupledCase
from coronaryuq.flow3d.simvascular.program import RunFailed, execute
from coronaryuq.flow3d.stage import SIMVASCULAR
from coronaryuq.zerod.network.beds import SCALING
from coronaryuq.zerod.theta import theta_changes

SAMPLES = 16
UNTIMED = 3
"""Steps at the start of an external run that are not timed: reading the mesh, and fluid still at rest."""
CYCLES = 2


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m coronaryuq.bench.flow3d.same_mesh", description=__doc__)
    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="results folder of a campaign")
    parser.add_argument("programs", metavar="PROGRAM:STEPS", nargs="*", help=f"PROGRAM: {' or '.join(SIMVASCULAR)}")
    parser.add_argument("--settings", default="{}", metavar="JSON", help="block `flow3d` of the configuration")
    given = parser.parse_args()
    return run_with_settings(
        lambda settings: print(json.dumps(compare(given.campaign, given.programs, settings))), Settings, given.settings
    )


def compare(campaign: Path, programs: list[str], settings: Settings) -> dict:
    """Return CPU seconds per sample and cycle of every program and of the ensemble solver, and their ratios."""
    wanted = [chosen(program) for program in programs]
    settings = settings.model_copy(
        update={"min_cycles": CYCLES, "max_cycles": CYCLES, "checkpoints": False, "fields": 0}
    )
    external = settings.simvascular.model_copy(
        update={
            "zerod_library": os.environ.get("SVZEROD_INTERFACE", settings.simvascular.zerod_library),
            "mpi": os.environ.get("SIMVASCULAR_MPI", settings.simvascular.mpi),
        }
    )
    batch = Batch(
        campaign / "case" / "case.json", campaign / "calibration" / "hyperaemia.json",
        campaign / "mesh" / "mesh-complete", campaign / "mesh" / "mesh.json", campaign / "samples" / "pilot.csv", 0, 0,
        campaign / "case" / "tree.vtp",
    )  # fmt: skip
    case = CoupledCase.of(batch.read_model(), batch.mesh_folder, external, settings.low_shear)
    ours = ensemble_cost(case, settings)
    print(ours, file=sys.stderr, flush=True)
    found = {"nodes": len(case.domain.points), "tets": len(case.domain.tets), "ensemble": ours}
    for name, steps in wanted:
        try:
            cost = external_cost(case, name, steps)
        except RunFailed as error:
            raise InputError(name, None, None, str(error)) from None
        cost["ratio"] = cost["cpu_s_per_cycle"] / ours["cpu_s_per_sample_cycle"]
        print({name: cost}, file=sys.stderr, flush=True)
        found[name] = cost
    return found


def chosen(program: str) -> tuple[str, int]:
    """Return name and steps of PROGRAM:STEPS."""
    name, _, steps = program.partition(":")
    if name not in SIMVASCULAR or not steps.isdigit() or int(steps) < 1:
        raise InputError("PROGRAM:STEPS", None, program, "expected program and number of steps, as in svsolver:12")
    return name, int(steps)


def ensemble_cost(case: CoupledCase, settings: Settings) -> dict:
    """Time whole runs from the 0D state, including wall shear and the 0D side."""
    ensemble = Ensemble(case, settings)
    changes = theta_changes(case.network, {SCALING: np.linspace(0.8, 1.2, SAMPLES)})
    few = settings.model_copy(update={"steps_per_cycle": 100, "ramp_cycles": 0.02, "max_cycles": 0, "refinements": 0})
    Ensemble(case, few).run(changes, SAMPLES)
    begun = time.process_time()
    outcomes = ensemble.run(changes, SAMPLES)
    spent = time.process_time() - begun
    cycles = settings.ramp_cycles + CYCLES
    return {
        "samples": SAMPLES,
        "ok": sum(outcome.ok for outcome in outcomes),
        "steps_per_cycle": settings.steps_per_cycle,
        "cpu_s_per_sample_cycle": spent / SAMPLES / cycles,
        "cpu_s_per_sample_step": spent / SAMPLES / cycles / settings.steps_per_cycle,
    }


def external_cost(case: CoupledCase, name: str, steps: int) -> dict:
    """Time two runs, one of them `steps` longer; the difference counts."""
    spent = []
    for stop in (UNTIMED, UNTIMED + steps):
        solver = SIMVASCULAR[name](replace(case, settings=case.settings.model_copy(update={"stop_after": stop})))
        with tempfile.TemporaryDirectory(prefix="coronaryuq-") as folder:
            run = Path(folder).resolve() / "run"
            solver.prepare(Sample("s", 0, {SCALING: 1.0}), run)
            for line in solver.commands():
                before = os.times()
                execute(line, run, case.settings.time_limit)
                after = os.times()
                if getattr(case.settings, name) in line:
                    break
        spent.append((after.children_user - before.children_user) + (after.children_system - before.children_system))
    per_step = (spent[1] - spent[0]) / steps
    settings = case.settings
    return {
        "steps_timed": steps,
        "steps_per_cycle": settings.steps_per_cycle,
        "nonlinear_tolerance": settings.tolerance,
        "iterations_at_most": settings.iterations,
        "cpu_s_per_step": per_step,
        "cpu_s_per_cycle": per_step * settings.steps_per_cycle,
    }


if __name__ == "__main__":
    sys.exit(main())
