"""Pullbacks with something hidden: an LAD of four segments, of which one has a stenosis, or a wire that drifted.

A stenosis is a vessel of its own in the truth, anywhere within a segment of the searched model. The truth is simulated
by svZeroDSolver or by our engine with other numerics, with beds, conditions and vessels off.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NoReturn

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from coronaryuq.bench.discrepancy.open_loop_tree import left_coronary
from coronaryuq.bench.discrepancy.trial import analyse
from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.case.settings import STENOSIS_LOSS
from coronaryuq.core import units
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import write_csv
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition, as_entry, write_conditions
from coronaryuq.discrepancy.data.measurements import COLUMNS, PULLBACK_COLUMNS, Measured
from coronaryuq.discrepancy.data.pullbacks import ALONG, path_of
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.discrepancy.inference.read_problem import make_problem
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.pullback import OF_WIRE, Pullback
from coronaryuq.zerod.network.period import period_of

PATH = f"left_main{ALONG}lad"
VESSELS = {
    "left_main": (1.5, 0.20),
    "lad_seg0": (2.5, 0.165),
    "lad_seg1": (3.0, 0.14),
    "lad_seg2": (2.5, 0.125),
    "lad": (3.0, 0.11),
}
"""Length and radius, cm, of the vessels on the path, in their order."""
CONDITIONS = {
    condition.name: condition
    for condition in (
        Condition("rest"),
        Condition("hyperaemia", coronary_resistance_scale=0.25),
        Condition("half dilated", coronary_resistance_scale=0.5, held_out=True),
    )
}
PULLED_UNDER = "hyperaemia"
FLOWS, FLOW_SD = ("J0:lad_seg0", "J0:lcx", "J1:diagonal"), 0.08
"""Mean flows measured in every condition, and their relative standard deviation."""
SPACING, PRESSURE_SD, NOISE_LENGTH = 0.2, 1.0, 0.5
"""Distance of readings (cm), their standard deviation (mmHg) and the correlation length of their noise (cm)."""
BEGINS, USUAL_DRIFT, CHECK_SD = 0.5, 1.0, 0.5
"""Course and standard deviation (mmHg) of the usual drift, and that of its check."""
NATURES = {"own": Nature("own", vessels=0.05), "svzerod": Nature("svzerod", vessels=0.05)}


@dataclass(frozen=True)
class Hidden:
    """What is hidden.

    Attributes
    ----------
    stenosis
        Distance of its centre along the path, cm; None without one.
    open_area
        Area of its throat over that of the vessel.
    narrowed
        Vessel whose resistance is larger by `factor`; None without one.
    drift
        Of the wire at the end, mmHg, in addition to the usual one.
    """

    stenosis: float | None = None
    open_area: float = 0.28
    length: float = 0.8
    narrowed: str | None = None
    factor: float = 8.0
    drift: float = 0.0

    @property
    def vessel(self) -> str | None:
        """Vessel of the stenosis in the searched model."""
        if self.stenosis is None:
            return self.narrowed
        ends = np.cumsum([length for length, _ in VESSELS.values()])
        return list(VESSELS)[int(np.searchsorted(ends, self.stenosis))]


@dataclass(frozen=True)
class Wire:
    """How the pullback is recorded. checked: whether its table has a drift check."""

    quantity: str = "pressure"
    statistic: str = "mean"
    checked: bool = False


def model() -> Network:
    """Return the searched model: the benchmark's left coronary tree with an LAD of four segments."""
    network = left_coronary()
    others = {vessel["vessel_name"]: vessel for vessel in network.vessels}
    ends = {"left_main": {"inlet": "AORTA"}, "lad": {"outlet": "BC_lad"}}
    vessels = [_vessel(name, length, radius, ends.get(name)) for name, (length, radius) in VESSELS.items()]
    vessels += [others["diagonal"], others["lcx"]]
    return _connected(network, vessels)


def truth_of(hidden: Hidden) -> Network:
    """Return the model with what is hidden in the vessels."""
    network = model()
    vessels = list(network.vessels)
    names = [vessel["vessel_name"] for vessel in vessels]
    if hidden.narrowed is not None:
        network.vessel_values(hidden.narrowed)["R_poiseuille"] *= hidden.factor
    if hidden.stenosis is not None:
        name = str(hidden.vessel)
        length, radius = VESSELS[name]
        behind = sum(VESSELS[other][0] for other in list(VESSELS)[: list(VESSELS).index(name)])
        first = hidden.stenosis - behind - hidden.length / 2
        rest = length - first - hidden.length
        if min(first, rest) <= 0.0:
            raise ValueError(f"the stenosis does not fit into {name}")
        area = np.pi * radius**2
        throat = _vessel(f"{name}_throat", hidden.length, radius * hidden.open_area**0.5)
        loss = STENOSIS_LOSS * units.BLOOD_DENSITY / (2 * area**2) * (1 / hidden.open_area - 1) ** 2
        throat["zero_d_element_values"] |= {"stenosis_coefficient": loss, "C": 0.0}
        number, whole = names.index(name), network.vessel(name)
        parts = [_vessel(f"{name}_ahead", first, radius), throat, _vessel(name, rest, radius)]
        for end, part in (("inlet", parts[0]), ("outlet", parts[-1])):
            if end in whole.get("boundary_conditions", {}):
                part["boundary_conditions"] = {end: whole["boundary_conditions"][end]}
        vessels[number : number + 1] = parts
    return _connected(network, vessels)


def _vessel(name: str, length: float, radius: float, ends: dict[str, str] | None = None) -> dict:
    area = np.pi * radius**2
    values = {
        "R_poiseuille": 8 * units.BLOOD_VISCOSITY * np.pi * length / area**2,
        "L": units.BLOOD_DENSITY * length / area,
        "C": 3e-7 * length * area,
    }
    vessel = {
        "vessel_name": name,
        "vessel_length": length,
        "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": values,
    }
    return vessel | ({"boundary_conditions": ends} if ends else {})


def _connected(network: Network, vessels: Sequence[dict]) -> Network:
    """Return the network of vessels in a row, the last two of which are the diagonal and the circumflex."""
    vessels = [vessel | {"vessel_id": number} for number, vessel in enumerate(vessels)]
    names = [vessel["vessel_name"] for vessel in vessels]
    row, diagonal, circumflex = names[:-2], names[-2], names[-1]
    beside = {"lad_seg0": [diagonal], "left_main": [circumflex]}
    order = sorted(range(len(row) - 1), key=lambda k: row[k] not in beside)
    junctions = [
        {
            "junction_name": f"J{number}",
            "junction_type": "NORMAL_JUNCTION",
            "inlet_vessels": [k],
            "outlet_vessels": [k + 1, *(names.index(name) for name in beside.get(row[k], ()))],
        }
        for number, k in enumerate(order)
    ]
    return Network({**network, "vessels": vessels, "junctions": junctions})


def write_case(hidden: Hidden, wire: Wire, seed: int, folder: Path, program: str = "own") -> None:
    """Write `model.json`, `measurements.csv` and `conditions.yaml` of a case.

    Parameters
    ----------
    hidden, wire
        What is hidden, and how the pullback is recorded.
    seed
        Of the subject, the usual drift and the noise.
    folder
        Folder for the files.
    program
        Key of `NATURES`: what simulates the truth.

    Raises
    ------
    FloatingPointError
        If the truth does not run.
    """
    nature, network = NATURES[program], truth_of(hidden)
    problem = make_problem(network, CONDITIONS, _blank(network, wire), Settings())
    forward = problem.forward
    simulation = nature.simulation(nature.body(network, seed), CONDITIONS, forward.anatomy)
    z = np.array([nature.nuisance(parameter, forward.anatomy, seed) for parameter in forward.nuisances])
    values = replace(forward, simulation=simulation).predict(z)[0]
    if not np.isfinite(values).all():
        raise FloatingPointError("the truth does not run")
    random = generator(seed, "discrepancy", "pullback", "noise")
    drift = hidden.drift + USUAL_DRIFT * float(random.standard_normal())
    rows: list[tuple] = []
    for series, exact in zip(forward.measured, forward.split(values[None, :]), strict=True):
        rows += _readings(series, exact[0], drift, random)
    if wire.checked:
        reading = drift + CHECK_SD * float(random.standard_normal())
        rows.append((PULLED_UNDER, "drift", PATH, "mean", "", reading, CHECK_SD, "mmHg", "", ""))
    write_json(folder / "model.json", model())
    write_csv(folder / "measurements.csv", pd.DataFrame(rows, columns=[*COLUMNS, *PULLBACK_COLUMNS]))
    write_conditions(folder, {name: as_entry(condition) for name, condition in CONDITIONS.items()}, {})


def _blank(network: Network, wire: Wire) -> list[Measured]:
    """Return the measured series of a truth, of size one."""
    topology, measured = Topology(network), []
    one = np.ones(1)
    for name, condition in CONDITIONS.items():
        period = period_of(apply_condition(network, condition))
        for location in FLOWS:
            ahead = location.split(":")[0] + ":" + next(iter(_starts(topology, location.split(":")[1])))
            measured.append(Measured(name, "flow", ahead, "mean", None, period, one, one))
        if name != PULLED_UNDER:
            measured.append(Measured(name, "pressure", "lad:BC_lad", "mean", None, period, one, one))
            continue
        path = path_of(topology, PATH, _fail)
        length = sum(topology.length(vessel) for vessel in path)
        distance = np.arange(0.0, length + 1e-9, SPACING)
        weight = BEGINS + (1.0 - BEGINS) * (distance.max() - distance) / np.ptp(distance)
        pullback = Pullback(path, distance, length, units.MMHG * weight, USUAL_DRIFT, NOISE_LENGTH)
        many = np.ones(distance.size)
        quantity = f"{OF_WIRE}{wire.quantity}"
        measured.append(Measured(name, quantity, PATH, wire.statistic, None, period, many, many, pullback=pullback))
    return measured


def _starts(topology: Topology, vessel: str) -> list[str]:
    """Return the first part of a vessel, which has several if it has a stenosis."""
    ahead = f"{vessel}_ahead"
    return [ahead if ahead in topology.vessels else vessel]


def _fail(field: str, value: object, remedy: str) -> NoReturn:
    raise ValueError(f"{field} = {value}: {remedy}")


def _readings(series: Measured, exact: np.ndarray, drift: float, random: np.random.Generator) -> list[tuple]:
    location = series.location.replace("_ahead", "")
    if series.pullback is None:
        unit, scale = ("mL/s", 1.0) if series.quantity == "flow" else ("mmHg", units.MMHG)
        sd = FLOW_SD * abs(float(exact[0])) if series.quantity == "flow" else PRESSURE_SD * units.MMHG
        value = exact[0] + sd * random.standard_normal()
        key = (series.condition, series.quantity, location, series.statistic)
        return [(*key, "", value / scale, sd / scale, unit, "", "")]
    pullback = series.pullback
    apart = np.abs(np.subtract.outer(pullback.distance, pullback.distance)) / NOISE_LENGTH
    noise = np.linalg.cholesky(np.exp(-apart)) @ random.standard_normal(exact.size)
    ratio = series.table_quantity == "ratio"
    per_mmhg, unit = (1.0 / (pullback.root_pressure / units.MMHG), "1") if ratio else (1.0, "mmHg")
    values = exact / (1.0 if ratio else units.MMHG)
    values = values + per_mmhg * (PRESSURE_SD * noise + drift * pullback.drift / units.MMHG)
    key = (series.condition, series.table_quantity, location, series.statistic)
    return [
        (*key, "", value, PRESSURE_SD * per_mmhg, unit, x / units.MM, "mm")
        for value, x in zip(values, pullback.distance, strict=True)
    ]


def answers(hidden: Hidden, wire: Wire, seeds: range, program: str = "own") -> Counter[str]:
    """Search a case per seed and count answers: effects at places, "nothing", or "outside" with the best effects."""
    found: Counter[str] = Counter()
    for seed in seeds:
        with TemporaryDirectory() as name, threadpool_limits(1):
            write_case(hidden, wire, seed, Path(name), program)
            discovery = analyse(Path(name))
            words = " and ".join(f"{effect.name} at {place}" for effect, place in discovery.hypothesis)
            found[f"outside; {words}" if discovery.outside_library else words if discovery.named else "nothing"] += 1
    return found
