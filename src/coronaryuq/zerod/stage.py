"""Rule function of the 0D stage: a chunk of samples in, one row per sample out."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from coronaryuq.case.case_json import CaseSummary, read_case
from coronaryuq.case.lowest_ffr import PRESSURE, ffr_places, lowest_ffr
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import replacing
from coronaryuq.core.records import FAILED, OK
from coronaryuq.core.remote_model import RemoteModel
from coronaryuq.core.units import MMHG
from coronaryuq.zerod.network.read import read_network
from coronaryuq.zerod.settings import Settings
from coronaryuq.zerod.solver.periodic import Periodicity
from coronaryuq.zerod.solver.result import Result
from coronaryuq.zerod.svzerodsolver import choose
from coronaryuq.zerod.theta import Theta, read_theta

KINDS = ("flow", "pressure")
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

    network_path: tuned loop at hyperaemia. samples_csv: `sample`, one column per bed (multiplier of r-hat),
    `R_cor_scaling`, and one per uncertain parameter. Columns out: sample, status (ok or failed), reason, cpu_s, cycles,
    cycle_error, refinement, then
    mean, min and max of flow (mL/s) and pressure (dyn/cm2) at the aorta and at each stenosis' root, inlet and outlet
    and at the outlets that perfuse the LV, then ffr_X and pressure_drop_X (mmHg) of every stenosis and lowest_ffr_X of
    every artery. Values do not depend on how samples are cut into chunks, because every sample starts from the
    network's own periodic state. A failed sample is a row without values.
    """
    model = LoopModel if settings.backend != "umbridge" else UmbridgeModel
    solver = model(network_path, case_path, settings)
    theta = read_theta(samples_csv, first, count, solver.network, network_path)
    batches = range(0, count, settings.batch)
    table = pd.concat([solver.run(theta.iloc[begin : begin + settings.batch]) for begin in batches], ignore_index=True)
    with replacing(out_parquet) as beside:
        table.to_parquet(beside, index=False)


class LoopModel:
    """The tuned loop as a function of θ: the quantities that the campaign measures of it.

    Parameters
    ----------
    network_path, case_path
        The tuned loop at hyperaemia, svZeroDSolver JSON, and `case.json`.
    settings
        Of the 0D runs.

    Attributes
    ----------
    network, theta
        The loop, and what θ changes in it.
    outputs
        Names of the quantities: flows in mL/s, pressures in dyn/cm2, FFR, pressure drops in mmHg.

    Raises
    ------
    InputError
        If a file is missing or malformed, or if a place of the case is not in the network.
    """

    def __init__(self, network_path: str | Path, case_path: str | Path, settings: Settings):
        self.network, self.settings = read_network(network_path), settings
        self.theta = Theta(self.network, network_path)
        case = read_case(case_path)
        solver = choose.make(settings.backend, self.network, network_path)
        renamed = self.theta.mixtures.renamed
        places = locations(case, solver.unknowns, case_path, renamed)
        self._ratios = {name: renamed.get(at, at) for name, at in ffr_locations(case).items()}
        measured = [f"{statistic}_{kind}:{at}" for at in places for kind in KINDS for statistic in STATISTICS]
        more = [f"mean_pressure:{at}" for at in self._ratios.values()]
        self._quantities = list(dict.fromkeys([*measured, *more]))
        self._drops = {
            f"pressure_drop_{s.name.lower()}": tuple(f"mean_{PRESSURE}{renamed.get(at, at)}" for at in (s.flow, s.ffr))
            for s in case.stenoses
        }
        self._places = ffr_places(case, solver.unknowns)
        self._ends = {end: f"mean_{end}" for of in self._places.values() for end in of.ends}
        # Not every outlet's pressure is written: the columns of the tables are those that were measured so far.
        self._read = list(dict.fromkeys([*self._quantities, *self._ends.values()]))
        lowest = [f"lowest_ffr_{artery.lower()}" for artery in self._places]
        self.outputs = [*self._quantities, *self._ratios, *self._drops, *lowest]
        self._aorta = f"mean_pressure:{case.aorta.pressure}"
        fixed: dict[str, Any] = {"steps_per_cycle": settings.steps_per_cycle, "threads": settings.threads}
        self._march: Callable[..., Result]
        if settings.periodic:
            periodicity = Periodicity(settings.tolerance, settings.cycles)
            self._march = partial(solver.run_to_periodic, periodicity=periodicity, **fixed)
        else:
            self._march = partial(solver.run_cycles, cycles=settings.cycles, **fixed)
        self._start = self._march({}).state[0] if settings.periodic else None

    def run(self, theta: pd.DataFrame) -> pd.DataFrame:
        """Run a batch: a table of θ with `sample` in, one row of `run_chunk`'s columns per sample out."""
        inputs = {name: theta[name].to_numpy() for name in theta.columns if name != "sample"}
        spent = time.process_time()
        result = self._march(self.theta.changes(inputs), self._read, start=self._start)
        spent = (time.process_time() - spent) / len(theta)
        ok = result.status == OK
        frame = {
            "sample": theta["sample"].to_numpy(),
            "status": np.where(ok, OK, FAILED),
            "reason": np.where(ok, "", result.status),
            "cpu_s": np.full(len(theta), spent),
            "cycles": result.cycles,
            "cycle_error": result.cycle_error,
            "refinement": result.refinement,
        }
        frame |= {name: np.where(ok, result.values[name], np.nan) for name in self._quantities}
        frame |= {name: np.where(ok, value, np.nan) for name, value in self._derived(result.values).items()}
        return pd.DataFrame(frame)

    def _derived(self, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return what is computed of the mean pressures: FFR, pressure drops, lowest FFR of each artery."""
        aorta = values[self._aorta]
        ffr = {name: values[f"mean_{PRESSURE}{at}"] / aorta for name, at in self._ratios.items()}
        drops = {name: (values[before] - values[beyond]) / MMHG for name, (before, beyond) in self._drops.items()}
        at_ends = {end: values[mean] / aorta for end, mean in self._ends.items()}
        at_stenoses = {of: ffr[f"ffr_{of.lower()}"] for artery in self._places.values() for of in artery.stenoses}
        return ffr | drops | lowest_ffr(self._places, at_ends, at_stenoses)


class UmbridgeModel:
    """A 0D model on an UM-Bridge server, as `LoopModel`; the server defines the case."""

    def __init__(self, network_path: str | Path, case_path: str | Path, settings: Settings):
        self.network = read_network(network_path)
        self._model = RemoteModel(settings.umbridge, settings.umbridge.model or "zerod", "zerod.umbridge")
        self.outputs = self._model.outputs

    def run(self, theta: pd.DataFrame) -> pd.DataFrame:
        """Run a batch; the CPU time is the waiting time per sample, because the server does not report its own."""
        names = [name for name in theta.columns if name != "sample"]
        begun = time.perf_counter()
        answers = self._model.evaluate(theta[names].to_numpy(), names)
        spent = (time.perf_counter() - begun) / len(theta)
        ok = np.array([not isinstance(answer, str) for answer in answers])
        values = np.array([[np.nan] * len(self.outputs) if isinstance(a, str) else a for a in answers])
        frame = {
            "sample": theta["sample"].to_numpy(),
            "status": np.where(ok, OK, FAILED),
            "reason": [answer if isinstance(answer, str) else "" for answer in answers],
            "cpu_s": np.full(len(theta), spent),
        }
        return pd.DataFrame(frame | dict(zip(self.outputs, values.T, strict=True)))


def ffr_locations(case: CaseSummary) -> dict[str, str]:
    """Return for each FFR, such as `ffr_lad`, the 0D location distal to the stenosis."""
    return {f"ffr_{stenosis.name.lower()}": stenosis.ffr for stenosis in case.stenoses}


def locations(
    case: CaseSummary, unknowns: list[str], file: str | Path = "case.json", renamed: Mapping[str, str] | None = None
) -> list[str]:
    """Return the 0D locations "A:B" whose flow and pressure are recorded; `InputError` if one is missing.

    renamed: the case's names of locations → those in this network.
    """
    now = renamed or {}
    known = [name.removeprefix("flow:") for name in unknowns if name.startswith("flow:")]
    found = [case.aorta.pressure]
    for stenosis in case.stenoses:
        found += [now.get(at, at) for at in (stenosis.root, stenosis.flow, stenosis.ffr)]
        found += [at for at in known if stenosis.vessel in at.split(":")]
        found += [at for at in known if at.split(":")[1] == stenosis.outlet]
    perfusing = {outlet.bc for outlet in case.lv_outlets}
    found += [at for at in known if at.split(":")[1] in perfusing]
    for at in found:
        if at not in known:
            raise InputError(file, "location", at, "the 0D network has no such connection")
    return list(dict.fromkeys(found))
