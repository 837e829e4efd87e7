"""Rule function of the 0D stage: a chunk of samples in, one row per sample out."""

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from coronaryuq.case.case_json import CaseSummary, read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import replacing
from coronaryuq.core.records import FAILED, OK
from coronaryuq.zerod.network.beds import read_theta, theta_changes
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.result import Result
from coronaryuq.zerod.svzerodsolver import choose

STATISTICS = ("mean", "min", "max")


def run_chunk(
    network_path: str | Path,
    case_path: str | Path,
    samples_csv: str | Path,
    first: int,
    count: int,
    settings: Settings,
    out_parquet: str | Path,
) -> None:
    """Run samples `first` to `first + count` of a table of θ and write one row each.

    network_path: tuned loop at hyperaemia. samples_csv: `sample`, one column per bed (multiplier of r-hat), and
    `R_cor_scaling`. Columns out: sample, status (ok or failed), reason, cpu_s, cycles, cycle_error, refinement, then
    mean, min and max of flow (mL/s) and pressure (dyn/cm2) at the aorta and at each stenosis' root, inlet and outlet
    and at the outlets that perfuse the LV, then ffr_X. Values do not depend on how samples are cut into chunks, because
    every sample starts from the network's own periodic state. A failed sample is a row without values.
    """
    network = read_network(network_path)
    case = read_case(case_path)
    theta = read_theta(samples_csv, first, count, network, network_path)
    solver = choose.make(settings.backend, network, network_path)
    places, ratios = locations(case, solver.unknowns, case_path), ffr_locations(case)
    quantities = [
        f"{statistic}_{kind}:{at}" for at in places for kind in ("flow", "pressure") for statistic in STATISTICS
    ]
    quantities += [f"mean_pressure:{at}" for at in ratios.values() if f"mean_pressure:{at}" not in quantities]
    fixed: dict[str, Any] = {"steps_per_cycle": settings.steps_per_cycle, "threads": settings.threads}
    run: Callable[..., Result]
    if settings.periodic:
        run = partial(solver.run_to_periodic, periodicity=Periodicity(settings.tolerance, settings.cycles), **fixed)
    else:
        run = partial(solver.run_cycles, cycles=settings.cycles, **fixed)
    start = run({}).state[0] if settings.periodic else None
    aorta = f"mean_pressure:{case.aorta.pressure}"
    frames = []
    for begin in range(0, count, settings.batch):
        part = theta.iloc[begin : begin + settings.batch]
        changes = theta_changes(network, {name: part[name].to_numpy() for name in part.columns if name != "sample"})
        spent = time.process_time()
        result = run(changes, quantities, start=start)
        spent = (time.process_time() - spent) / len(part)
        ok = result.status == OK
        frame = {
            "sample": part["sample"].to_numpy(),
            "status": np.where(ok, OK, FAILED),
            "reason": np.where(ok, "", result.status),
            "cpu_s": np.full(len(part), spent),
            "cycles": result.cycles,
            "cycle_error": result.cycle_error,
            "refinement": result.refinement,
        }
        frame |= {name: np.where(ok, result.values[name], np.nan) for name in quantities}
        frame |= {
            name: np.where(ok, result.values[f"mean_pressure:{at}"] / result.values[aorta], np.nan)
            for name, at in ratios.items()
        }
        frames.append(pd.DataFrame(frame))
    with replacing(out_parquet) as beside:
        pd.concat(frames, ignore_index=True).to_parquet(beside, index=False)


def ffr_locations(case: CaseSummary) -> dict[str, str]:
    """`ffr_lad` and the like → 0D location distal to the stenosis, whose mean pressure over the aorta's is FFR."""
    return {f"ffr_{stenosis.name.lower()}": stenosis.ffr for stenosis in case.stenoses}


def locations(case: CaseSummary, unknowns: list[str], file: str | Path = "case.json") -> list[str]:
    """0D locations "A:B" whose flow and pressure are measured, each once; `InputError` for one that is not there."""
    known = [name.removeprefix("flow:") for name in unknowns if name.startswith("flow:")]
    found = [case.aorta.pressure]
    for stenosis in case.stenoses:
        found += [stenosis.root, stenosis.flow, stenosis.ffr]
        found += [at for at in known if stenosis.vessel in at.split(":")]
        found += [at for at in known if at.split(":")[1] == stenosis.outlet]
    perfusing = {outlet.bc for outlet in case.lv_outlets}
    found += [at for at in known if at.split(":")[1] in perfusing]
    for at in found:
        if at not in known:
            raise InputError(file, "location", at, "the 0D network has no such connection")
    return list(dict.fromkeys(found))
