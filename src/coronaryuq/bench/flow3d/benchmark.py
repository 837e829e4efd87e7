"""Benchmark `flow3d`: cost per sample and cycle, verification against exact solutions, mesh convergence."""

import argparse
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from coronaryuq.bench.flow3d import axisymmetric, bend, nozzle, tubes, unstructured
from coronaryuq.core.errors import InputError
from coronaryuq.core.units import BLOOD_DENSITY, BLOOD_VISCOSITY
from coronaryuq.flow3d.fem.cross_section import section_weights
from coronaryuq.flow3d.fem.discretisation import Discretisation
from coronaryuq.flow3d.fem.lanes import LANES
from coronaryuq.flow3d.mesh_study import MeshRuns, NotMeasured, compare
from coronaryuq.flow3d.numerical_error import numerical_error

MESHES = ((5, 75), (8, 90), (13, 127))
"""Cells over the radius and along the axis: about 7, 20 and 70 thousand nodes."""
NOZZLE_DATA = Path(__file__).parents[5] / "shared" / "data" / "fda-nozzle"
BENT = np.array([10.0, 50.0, 100.0, 200.0])
"""Reynolds numbers in a bend, see `bend.errors`."""
PEAK, STEPS_PER_CYCLE, PERIOD = 100.0, 800, 0.9
LENGTH = 5.0 * tubes.RADIUS
MEASURED_STEPS = 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument(
        "--data",
        metavar="FOLDER",
        help="also compute mesh convergence from FOLDER, with one folder per mesh of one patient, each with 3D records",
    )


def run(quick: bool, data: str | None = None) -> dict:
    """Measure costs, verify against exact solutions, and compute mesh convergence.

    Parameters
    ----------
    quick
        One small mesh with 8 samples instead of three with 1 and 16; no nozzle, stenosis or unstructured meshes.
    data
        Folder with one folder per mesh of the same patient, each with `mesh.json` and `batch*.jsonl` of the same
        samples; without it `convergence` is empty.

    Returns
    -------
    dict
        `meshes` and `own_lumens` (costs), `verification`, `convergence`. The nozzle's error is null if the
        laboratories' files are not in `../shared`.
    """
    converged = convergence(data) if data else []  # first, so that a wrong folder is reported at once
    meshes, lumens = [], []
    for rings, levels in MESHES[: 1 if quick else 3]:
        for samples in (LANES,) if quick else (1, 16):
            meshes.append(cost(rings, levels, samples))
            print(f"cost: {meshes[-1]}", file=sys.stderr, flush=True)
    for rings, levels in MESHES[: 1 if quick else 2]:
        lumens.append(cost_of_own_lumens(rings, levels))
        print(f"cost of own lumens: {lumens[-1]}", file=sys.stderr, flush=True)
    return {
        "quick": quick,
        "meshes": meshes,
        "own_lumens": lumens,
        "verification": verification(quick),
        "convergence": converged,
    }


def cost(rings: int, levels: int, samples: int) -> dict:
    """Return CPU time per sample and cycle of the solver's steps in a tube at 100 cm/s.

    A few steps are timed after compilation and scaled to a cycle; blocks of LANES run one after the other.
    """
    space = tubes.discretised(LENGTH, tubes.RADIUS, rings, levels, PERIOD / STEPS_PER_CYCLE)
    spent = _per_step(space, samples)
    return {
        "nodes": space.nodes,
        "tets": len(space.elements.tets),
        "samples": samples,
        "steps_per_cycle": STEPS_PER_CYCLE,
        "cpu_s_per_sample_cycle": round(spent * STEPS_PER_CYCLE, 3),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
        "factor_nonzeros": space.factor.nonzeros,
    }


def cost_of_own_lumens(rings: int, levels: int) -> dict:
    """Return CPU time per sample and cycle of `cost`'s tube with a radius for each sample, and with one for all.

    `set_up_cpu_s` is what a sample's own operators and factor cost, once per run.
    """
    dt = PERIOD / STEPS_PER_CYCLE
    begun = time.process_time()
    spaces = [tubes.discretised(LENGTH, tubes.RADIUS * r, rings, levels, dt) for r in np.linspace(0.85, 1.15, LANES)]
    own = Discretisation.of_lanes(spaces, spaces[0])
    set_up = (time.process_time() - begun) / LANES
    shared, each = (_per_step(space, LANES) * STEPS_PER_CYCLE for space in (spaces[0], own))
    return {
        "nodes": own.nodes,
        "steps_per_cycle": STEPS_PER_CYCLE,
        "cpu_s_per_sample_cycle_shared": round(shared, 3),
        "cpu_s_per_sample_cycle_own": round(each, 3),
        "ratio": round(each / shared, 2),
        "set_up_cpu_s": round(set_up, 3),
    }


def _per_step(space: Discretisation, samples: int) -> float:
    """Return the CPU time of a step per sample, in blocks of LANES that run one after the other, after compilation."""
    flow = np.full(LANES, PEAK / 2 * np.pi * tubes.RADIUS**2)
    blocks = [tubes.driven(space, lambda t: flow) for _ in range(-(-samples // LANES))]
    for stepper, caps in blocks:
        for _ in range(3):
            stepper.step(caps)
    begun = time.process_time()
    for _ in range(MEASURED_STEPS):
        for stepper, caps in blocks:
            stepper.step(caps)
    return (time.process_time() - begun) / MEASURED_STEPS / samples


def verification(quick: bool) -> dict:
    """Return errors against exact solutions on the finest mesh tried, and observed orders."""
    coarse, fine = (3, 5) if quick else (4, 8)
    steps = 80 if quick else 240
    flow = np.linspace(0.5, 2.0, LANES)
    tube = tubes.poiseuille(fine, flow)
    print(f"poiseuille: {np.abs(tube['drop']).max():.4f}", file=sys.stderr, flush=True)
    pulse = [tubes.womersley(fine, steps, alpha) for alpha in (2.0, 4.0)]
    ratios = np.concatenate([np.concatenate([p["gradient"], p["shear"]]) for p in pulse])
    print(f"womersley: {np.abs(np.abs(ratios) - 1).max():.4f}", file=sys.stderr, flush=True)
    errors = [tubes.manufactured(rings) for rings in (coarse, fine)]
    print(f"manufactured: {errors}", file=sys.stderr, flush=True)
    found: dict[str, Any] = {
        "rings": fine,
        "poiseuille_dp_error": float(np.abs(tube["drop"]).max()),
        "poiseuille_wss_rms": float(tube["shear_rms"].max()),
        "womersley_amplitude_error": float(np.abs(np.abs(ratios) - 1).max()),
        "womersley_phase_error_deg": float(np.abs(np.degrees(np.angle(ratios))).max()),
        "mms_velocity_order": float(np.log(errors[0] / errors[1]) / np.log(fine / coarse)),
        "mass_balance": float(tube["imbalance"].max()),
        "nozzle_axial_velocity_error": None,
    }
    if not quick and NOZZLE_DATA.is_dir():
        found["nozzle"] = against_laboratories(nozzle.solve())
        found["nozzle_axial_velocity_error"] = found["nozzle"]["axial_velocity_error"]
    if not quick:
        found["stenosis"] = stenosis()
        found["bend"] = {rings: {k: v.tolist() for k, v in bend.errors(rings, BENT).items()} for rings in (4, 6, 8)}
        found["wall_shear_unstructured"] = unstructured.wall_shear()
    return found


def against_laboratories(flow: nozzle.NozzleFlow) -> dict:
    """Compare the FDA nozzle's flow up to the jet's breakdown with the laboratories and the exact solution.

    Largest error of the axial velocity against the laboratories' mean and the exact solution; number of stations at
    which velocity (cm/s) and pressure (dyn/cm2) lie outside the laboratories' range, and by how much at most, for the
    solver and the exact solution.
    """
    laboratories = nozzle.measured(NOZZLE_DATA)
    found: dict[str, Any] = {"nodes": flow.nodes}
    exact = nozzle.reference()
    for name, curves in (("solver", flow), ("exact", exact)):
        read = nozzle.stations(curves, laboratories)
        for quantity in ("axial", "pressure"):
            outside = [station.outside() for station in read if station.quantity == quantity]
            found[f"{quantity}_{name}"] = {
                "stations": len(outside),
                "outside": sum(distance > 0 for distance in outside),
                "most_outside": max(outside),
            }
    axial = [s for s in nozzle.stations(flow, laboratories) if s.quantity == "axial"]
    found["axial_velocity_error"] = max(abs(station.error()) for station in axial)
    found["axial_velocity_error_exact"] = max(
        abs(station.value / float(np.interp(station.z, exact.z, exact.axial)) - 1.0) for station in axial
    )
    return found


def stenosis(
    rings: Sequence[int] = (4, 6, 8), flows: Sequence[float] = (0.4, 0.8, 1.6), levels: int = 120, cells: int = 12
) -> list[dict]:
    """Return relative errors of a stenosis' pressure drop against the axisymmetric flow, per flow (mL/s) and mesh."""
    length = 2.4
    exact = []
    for flow in flows:
        reference = axisymmetric.solve(
            tubes.narrowing, np.linspace(0, length, levels + 1), cells, flow, BLOOD_DENSITY, BLOOD_VISCOSITY
        )
        at = [float(np.interp(z, reference.z, reference.pressure)) for z in (0.4, 1.8)]
        exact.append(at[0] - at[1])
    rows = []
    for count in rings:
        space = tubes.discretised(length, tubes.narrowing, count, 20 * count, dt=1e-3)
        lanes = np.resize(np.asarray(flows, float), LANES)
        stepper = tubes.steady(space, lanes, time=0.25)
        drop = [mean_pressure(space, stepper, z) for z in (0.4, 1.8)]
        error = (drop[0] - drop[1])[: len(flows)] / np.array(exact) - 1.0
        rows.append({"rings": count, "nodes": space.nodes, "flow": list(flows), "drop_error": error.tolist()})
        print(f"stenosis: {rows[-1]}", file=sys.stderr, flush=True)
    return rows


def mean_pressure(space, stepper, z: float) -> np.ndarray:
    """Return the mean pressure (LANES,) over the cross-section at z."""
    centre, normal = np.array([0.0, 0.0, z]), np.array([0.0, 0.0, 1.0])
    nodes, weight, _ = section_weights(space.points, space.elements.tets, centre, normal)
    return (weight[:, None] * stepper.pressure[nodes]).sum(axis=0)


def convergence(data: str | Path) -> list[dict]:
    """Return quantities of interest on two or three meshes of one patient, as means over the common samples.

    Each has `means` by mesh and the numerical error of the second finest one (see `flow3d.numerical_error`).
    """
    meshes = [
        MeshRuns(found, sorted(found.parent.glob("batch*.jsonl"))) for found in sorted(Path(data).glob("*/mesh.json"))
    ]
    if not 2 <= len(meshes) <= 3:
        raise InputError(data, None, None, "expected two or three folders with mesh.json and batch*.jsonl")
    try:
        _, nodes, _, found = compare(meshes)
    except NotMeasured as reason:
        raise InputError(data, None, None, str(reason)) from None
    size = np.array(nodes, float) ** (-1 / 3)
    rows = []
    for name, every in found.items():
        quantity, _, branch = name.rpartition("_")
        error = asdict(numerical_error("mesh", size, every, len(nodes) - 2))
        means = every.mean(axis=1).tolist()
        rows.append({"quantity": quantity, "branch": branch, "nodes": nodes, "means": means} | error)
    return rows
