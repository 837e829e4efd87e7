"""Benchmark `trees`: the 0D engine on open trees with many outlets, compared with svZeroDSolver."""

import argparse
import json
import resource
import subprocess
import sys
import time

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.core import seeds
from coronaryuq.zerod.network.beds import beds, resistance_changes
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.svzerodsolver import program

OUTLETS, QUICK_OUTLETS = (10, 50, 200, 500, 1000), (10, 50)
SAMPLES, STEPS, CYCLES = 32, 200, 3
ROOT_RADIUS, BED_RESISTANCE = 0.2, 9000.0
"""Radius of the first vessel, cm, and resistance of all beds in parallel, dyn s/cm5."""
MEASURED = "from coronaryuq.bench.large_trees import measure; measure(*map(int, __import__('sys').argv[1:]))"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    default = " ".join(map(str, OUTLETS))
    parser.add_argument("--outlets", type=int, nargs="+", metavar="N", help=f"numbers of outlets (default: {default})")


def run(quick: bool = False, outlets: list[int] | None = None) -> dict:
    """Time the engine on bifurcating trees of R, L and C with coronary beds, each in a process of its own.

    Set-up is the CPU time from a network to the end of its first step, without compiling kernels. Ratios to
    svZeroDSolver are of CPU time on one core, in the same run; `quick` takes trees of 10 and 50 outlets.
    """
    compiled = [sys.executable, "-c", MEASURED]
    rows = []
    for number in outlets or (QUICK_OUTLETS if quick else OUTLETS):
        done = subprocess.run([*compiled, str(number)], stdout=subprocess.PIPE, check=True, encoding="utf-8")
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    return {"samples": SAMPLES, "steps_per_cycle": STEPS, "cycles": CYCLES, "trees": rows}


def open_tree(outlets: int) -> Network:
    """Return a bifurcating tree, radii by Murray's law, between an aortic pressure and coronary beds."""
    vessels: list[dict] = []
    beds_: list[dict] = []
    junctions: list[dict] = []

    def grow(number: int, ends: dict) -> int:
        share, k = number / outlets, len(vessels)
        radius = ROOT_RADIUS * share ** (1 / 3)
        values = {"R_poiseuille": 0.32 / (np.pi * radius**4), "L": 1.06 / (np.pi * radius**2), "C": 1e-6 * share}
        vessels.append(
            {"vessel_id": k, "vessel_length": 1.0, "vessel_name": f"branch{k}_seg0", "boundary_conditions": ends}
            | {"zero_d_element_type": "BloodVessel", "zero_d_element_values": values}
        )
        if number == 1:
            ends["outlet"] = f"BC_{k}"
            one = BED_RESISTANCE * outlets
            beds_.append({"bc_name": f"BC_{k}", "bc_type": "CORONARY", "bc_values": _bed(one, outlets)})
            return k
        children = [grow(part, {}) for part in (number - number // 2, number // 2)]
        junctions.append(
            {"junction_name": f"J{k}", "junction_type": "NORMAL_JUNCTION"}
            | {"inlet_vessels": [k], "outlet_vessels": children}
        )
        return k

    grow(outlets, {"inlet": "INFLOW"})
    aorta = {"t": [0.0, 0.2, 0.4, 1.0], "P": [1.0e5, 1.6e5, 1.3e5, 1.0e5]}
    simulation = {"number_of_cardiac_cycles": CYCLES, "number_of_time_pts_per_cardiac_cycle": STEPS + 1}
    return Network(
        {
            "simulation_parameters": simulation,
            "boundary_conditions": [{"bc_name": "INFLOW", "bc_type": "PRESSURE", "bc_values": aorta}, *beds_],
            "junctions": junctions,
            "vessels": vessels,
        }
    )


def _bed(resistance: float, outlets: int) -> dict:
    parts = {"Ra1": 0.32 * resistance, "Ra2": 0.52 * resistance, "Rv1": 0.16 * resistance}
    compliances = {"Ca": 2e-6 / outlets, "Cc": 1e-5 / outlets}
    return parts | compliances | {"t": [0.0, 0.3, 0.6, 1.0], "Pim": [2e4, 6e4, 3e4, 2e4], "P_v": 6e3}


def measure(outlets: int) -> None:
    """Measure a tree and print the result as JSON."""
    Engine(open_tree(2)).run_cycles(cycles=1, steps_per_cycle=2)
    before = _peak_mb()
    network, spent = open_tree(outlets), time.process_time()
    engine = Engine(network)
    engine.run_cycles(cycles=1, steps_per_cycle=1)
    setup = time.process_time() - spent
    random = seeds.generator(1, "bench", "trees")
    changes = resistance_changes(network, {bed: random.uniform(0.5, 2.0, SAMPLES) for bed in beds(network)})
    many, one = _us_per_step(engine, changes) / SAMPLES, _us_per_step(engine, {})
    peak, theirs = _peak_mb(), None
    if program.installed() is not None:
        network["simulation_parameters"] |= {"output_all_cycles": False, "output_mean_only": True}
        spent = time.process_time()
        program.simulate(network)
        theirs = (time.process_time() - spent) / (CYCLES * STEPS) * 1e6
    row = {
        "outlets": outlets,
        "unknowns": len(engine.unknowns),
        "setup_cpu_s": setup,
        "peak_rss_mb": peak,
        "rss_before_mb": before,
        "us_per_step_and_sample": many,
        "us_per_step_one_sample": one,
        "svzerod_us_per_step": theirs,
        "ratio_vs_svzerod": theirs and theirs / many,
        "ratio_vs_svzerod_one_sample": theirs and theirs / one,
    }
    print(json.dumps(row))


def _us_per_step(engine: Engine, changes: dict) -> float:
    engine.run_cycles(changes, cycles=1, steps_per_cycle=2)
    spent = time.process_time()
    engine.run_cycles(changes)
    return (time.process_time() - spent) / (CYCLES * STEPS) * 1e6


def _peak_mb() -> float:
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0, 1)
