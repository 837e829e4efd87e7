"""Benchmark `zerod`: speed of the 0D engine on a closed loop with 22 coronary outlets, compared with svZeroDSolver."""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from coronaryuq.bench.coronary_tree import synthetic_loop
from coronaryuq.case.network.network import Network
from coronaryuq.core import seeds
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.units import MMHG
from coronaryuq.zerod.network.beds import beds, resistance_changes
from coronaryuq.zerod.network.read import check_network, read_network, write_network
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.lanes import LANES
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.svzerodsolver import program

_SHARED = Path(__file__).parents[4] / "shared" / "data"
_PRESSURE_LIKE = ("R", "L", "E", "Kxp")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--network", metavar="FILE", help="svZeroDSolver JSON (default: a loop with 22 outlets)")


def run(
    quick: bool = False,
    network: str | None = None,
    samples: int | None = None,
    steps: int = 1000,
    cycles: int | None = None,
) -> dict:
    """Time the engine; ratios to svZeroDSolver are of CPU time on one core, in the same run.

    network: JSON file; by default the shared closed-loop-22 with svZeroDSolver's published heart parameters or, if that
    is not found, a synthetic loop of the same size. samples: 64 (quick: 32). steps: per cycle. cycles: 6 (quick: 2).
    """
    name, loop = _network(network)
    samples = samples or (32 if quick else 64)
    cycles = cycles or (2 if quick else 6)
    engine = Engine(loop, name)
    spent = time.process_time()
    engine.run_cycles(cycles=1, steps_per_cycle=16)
    first = time.process_time() - spent
    random = seeds.generator(1, "bench", "zerod")
    names = beds(loop)
    changes = resistance_changes(loop, {bed: random.uniform(0.5, 2.0, samples) for bed in names})
    places = [unknown for unknown in engine.unknowns if unknown.split(":")[-1] in names and unknown.startswith("flow")]
    quantities = [f"mean_{place}" for place in places] or [f"mean_{engine.unknowns[0]}"]
    engine.run_cycles(changes, quantities, cycles=1, steps_per_cycle=16)
    spent = time.process_time()
    result = engine.run_cycles(changes, quantities, cycles=cycles, steps_per_cycle=steps)
    marched = (time.process_time() - spent) / samples
    groups = -(-samples // LANES)
    base = engine.run_to_periodic(steps_per_cycle=steps)
    spent = time.process_time()
    periodic = engine.run_to_periodic(changes, quantities, start=base.state[0], steps_per_cycle=steps)
    settled = (time.process_time() - spent) / samples
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    theirs, periodic_theirs, difference = _against_svzerod(engine, loop, cycles, steps, settled)
    return {
        "network": name,
        "quick": quick,
        "vessels": len(loop.vessels),
        "unknowns": len(engine.unknowns),
        "samples": samples,
        "steps_per_cycle": steps,
        "cycles": cycles,
        "failed": int(np.sum(result.status != "ok")),
        "cpu_s_per_sample": marched,
        "steps_per_s": cycles * steps / marched,
        "newton_per_step": result.solves / (groups * cycles * steps),
        "newton_per_s": result.solves / groups / marched,
        "cpu_s_per_sample_periodic": settled,
        "cycles_periodic": float(periodic.cycles.mean()),
        "cycle_error": float(periodic.cycle_error.max()),
        "failed_periodic": int(np.sum(periodic.status != "ok")),
        "compile_s": first if quick else _compile_time(loop),
        "compile_cached": quick,
        "peak_rss_mb": peak,
        "svzerod_cpu_s_per_sample": theirs,
        "ratio_vs_svzerod": theirs / marched if theirs else None,
        "ratio_vs_svzerod_periodic": periodic_theirs,
        "max_rel_diff_svzerod": difference,
    }


def _network(path: str | None) -> tuple[str, Network]:
    if path:
        return Path(path).stem, read_network(path)
    tree, heart = _SHARED / "closed-loop-22", _SHARED / "svzerod-cases" / "closedLoopHeart_withCoronaries.json"
    if not (tree.is_dir() and heart.exists()):
        return "synthetic loop with 22 coronary outlets", synthetic_loop()
    network = Network(read_json(tree / "svzerod_tuning_cgs.json"))
    published = read_network(heart).heart["parameters"]
    network.heart["parameters"] = {
        name: _in_cgs(name, value) for name, value in published.items() if not name.startswith("_")
    }
    check_network(network, tree)
    return "closed-loop-22", network


def _in_cgs(name: str, value: float) -> float:
    """Convert a heart parameter from mmHg and mL to CGS."""
    if name.startswith(_PRESSURE_LIKE):
        return value * MMHG
    return value / MMHG if name in ("Cp", "Cpa") else value


def _against_svzerod(engine: Engine, network: Network, cycles: int, steps: int, settled: float):
    """Return CPU time of svZeroDSolver for a sample, its ratio at periodic accuracy, and the largest difference."""
    if program.installed() is None:
        return None, None, None
    brief = network.deep_copy()
    brief["simulation_parameters"] |= {
        "number_of_cardiac_cycles": cycles,
        "number_of_time_pts_per_cardiac_cycle": steps + 1,
        "output_all_cycles": False,
        "output_mean_only": True,
    }
    spent = _cpu()
    program.simulate(brief)
    spent = _cpu() - spent
    theirs = program.SvZeroD(network).run_cycles(waveforms=engine.unknowns, cycles=cycles, steps_per_cycle=steps)
    ours = engine.run_cycles(waveforms=engine.unknowns, cycles=cycles, steps_per_cycle=steps)
    difference = 0.0
    for name in engine.unknowns:
        here, there = ours.waveforms[name][0], theirs.waveforms[name][0]
        difference = max(difference, np.abs(here - there).max() / max(np.abs(there).max(), 1e-12))
    # svZeroDSolver only steps in time: to the same cycle error it needs as many cycles as our solver without
    # acceleration.
    plain = engine.run_to_periodic(periodicity=Periodicity(accelerate=False), steps_per_cycle=steps)
    return spent, spent / cycles * float(plain.cycles[0]) / settled, float(difference)


def _cpu() -> float:
    return sum(resource.getrusage(who).ru_utime for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


_COMPILE = """
import sys, time
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.solver.engine import Engine
engine = Engine(read_network(sys.argv[1]))
spent = time.process_time()
engine.run_cycles(cycles=1, steps_per_cycle=16)
print(time.process_time() - spent)
"""


def _compile_time(network: Network) -> float:
    """Return the CPU time of a first run in a new process with an empty kernel cache."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.json"
        write_network(path, network)
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        done = subprocess.run(
            [sys.executable, "-c", _COMPILE, str(path)], env=environment, stdout=subprocess.PIPE, check=True
        )
    return float(done.stdout)
