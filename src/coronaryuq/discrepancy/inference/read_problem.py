"""From files to a problem: network, conditions and measurements, checked against each other."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from coronaryuq.core import units
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.conditions import Condition, kept_out, period_of, under
from coronaryuq.discrepancy.data.measurements import AORTIC, Measured, measured_conditions, read_measurements
from coronaryuq.discrepancy.forward.network_values import inner
from coronaryuq.discrepancy.forward.nuisance import Nuisance, nuisances
from coronaryuq.discrepancy.forward.predict import Forward, pressure_factor
from coronaryuq.discrepancy.forward.simulation import LOOSE, TOLERANCE, Simulation
from coronaryuq.discrepancy.inference.cross_validation import folds
from coronaryuq.discrepancy.inference.noise import Noise, parts
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.time_step_error import time_steps
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.solver.engine import Engine

MISTYPED = {"perfusion": 1e4}
"""Times the largest that the model has, beyond which a number cannot be a measurement; 50 of other quantities."""
UNITS_APART = {"pressure": 6.0, "ratio": 20.0, "flow": 20.0, "volume": 20.0}
"""Times what the model has that the middle one of all series cannot be; kPa and mmHg are 7.5 apart."""

MARKS = (":", "~", "<")
"""What stands between the blocks of a place."""
KNOWN = 1.0
"""Standard deviations by which a perfusion is above nought that may set a tissue mass."""
LEAST_WHITE = 0.1
"""Share of a standard deviation that is left to white noise, whatever the model's floor and time steps add."""
STEPS_WHERE_LASTING = 4
"""How many times as short an open loop's time steps are where noise lasts. It leaves little noise to what is sharp, and
there steps err: far from the data, where no correction at a fit can know the right one, their error would decide which
effect comes nearest. In a closed loop some ringing goes on with shorter steps, and runs are dear."""


def locations(network: dict) -> dict[str, list[str]]:
    """Names that measurements may use, per quantity."""
    unknowns = Engine(network).unknowns
    places = [name.split(":", 1)[1] for name in unknowns if name.startswith("flow:")]
    internal = inner(unknowns)
    return {
        "flow": places + [n for n in internal if n.startswith("Q_")],
        "pressure": places + [n for n in internal if n.startswith("P_")],
        "volume": [n for n in internal if n.startswith("V_")],
        "perfusion": list(Anatomy(network).beds),
        "ratio": places,
    }


def check_searchable(network: dict, file: str | Path) -> None:
    """Raise `InputError` for what a network may be and a search has no use of; `file` for messages.

    Places are written BLOCK:BLOCK, BED~BED and BED<BED, so that no name may hold these marks.
    """
    if not network.get("vessels"):
        raise InputError(file, "vessels", None, "missing; there is no vessel or bed that an effect could act on")
    for block in network.get("external_solver_coupling_blocks", []):
        remedy = "driven by another solver, of which a search knows nothing; put a boundary condition in its place"
        raise InputError(file, f"external_solver_coupling_blocks.{block['name']}", None, remedy)
    for vessel in network["vessels"]:
        if vessel["zero_d_element_type"] == "BloodVesselRC":
            remedy = "no effect is written for it; want BloodVessel, or BloodVesselCRL with R_poiseuille and C"
            raise InputError(file, vessel["vessel_name"], "BloodVesselRC", remedy)
    for part, key in (("vessels", "vessel_name"), ("boundary_conditions", "bc_name"), ("junctions", "junction_name")):
        for block in network.get(part, []):
            if any(mark in block[key] for mark in MARKS):
                raise InputError(file, f"{part}.{key}", block[key], f"want a name without {' '.join(MARKS)}")


def read_problem(
    network: dict, measurements: str | Path, conditions: dict[str, Condition], file: str | Path, settings: Settings
) -> Problem:
    """Check measurements and conditions against the network and join them. `file`: the conditions file, for messages.

    Raises `InputError`: see `read_measurements`; also when fewer than two conditions were measured.
    """
    networks = {name: under(network, condition, file) for name, condition in conditions.items()}
    periods = {name: period_of(changed) for name, changed in networks.items()}
    measured = read_measurements(measurements, conditions, locations(network), periods)
    used = measured_conditions(measured)
    if len(used) < 2:
        remedy = "measurements of one condition only; a second is needed, to be kept out of the fit"
        raise InputError(measurements, "condition", used[0], remedy)
    held = [name for name in used if conditions[name].held_out]
    if len(held) == len(used):
        raise InputError(file, "held_out", held, "every measured condition is held out; leave one to fit")
    problem = make_problem(network, {name: conditions[name] for name in conditions if name in used}, measured, settings)
    _check_root(problem)
    _check_sizes(problem, measurements)
    if not folds(problem, held):
        remedy = "means of conditions with a free parameter set that parameter: nothing is left to verify on; add more"
        raise InputError(measurements, "condition", ", ".join(held or used), remedy)
    return with_time_steps(problem)


def _check_root(problem: Problem) -> None:
    """A root pressure that none has says that the unit of the network was taken for another."""
    pressure = problem.forward.anatomy.pressure * problem.forward.pressure_factor / units.MMHG
    if problem.settings.pressure_unit == "auto" and not AORTIC[0] <= pressure <= AORTIC[1]:
        unit = "mmHg" if problem.forward.pressure_factor == units.MMHG else "dyn/cm2"
        remedy = f"mmHg at the root if the network is in {unit}, want {AORTIC[0]:g} to {AORTIC[1]:g}; give its unit"
        raise InputError("model", "pressure_unit", float(f"{pressure:.3g}"), remedy)


def _check_sizes(problem: Problem, file: str | Path) -> None:
    """Measurements that are far from anything that the model has are in another unit, or mistyped.

    One flow may be much less than the model's, in a vessel all but closed; the scale of perfusion is the data's own.
    """
    forward = problem.forward
    predicted = forward.split(forward.predict(np.zeros(problem.count)))
    for quantity in dict.fromkeys(series.quantity for series in forward.measured):
        mine = [(s, p[0]) for s, p in zip(forward.measured, predicted, strict=True) if s.quantity == quantity]
        largest = max(np.abs(p).max() for _, p in mine)
        if not np.isfinite(largest) or largest == 0.0:
            continue
        places = {s.location for s, _ in mine}
        if quantity == "flow" and len(places) > 1 and all(_opposite(s, p) for s, p in mine):
            remedy = "mL/s on average where the model's flow runs the other way, and so all flows; see their signs"
            raise InputError(file, "flow: value", float(f"{mine[0][0].value.mean():.3g}"), remedy)
        for series, _ in mine:
            worst = int(np.argmax(np.abs(series.value)))
            times = abs(float(series.value[worst])) / largest
            if times > MISTYPED.get(quantity, 50.0):
                where = "/".join((series.condition, quantity, series.location, series.statistic))
                where += "" if series.time is None else f", t = {series.time[worst]:.4g} s"
                remedy = "times the largest that the model has; see the number and its unit"
                raise InputError(file, where, float(f"{times:.3g}"), remedy)
        middle = float(np.median([np.abs(s.value).mean() / max(np.abs(p).mean(), 1e-9 * largest) for s, p in mine]))
        most = max(float(np.abs(s.value).max()) for s, _ in mine) / largest
        limit = UNITS_APART.get(quantity, np.inf)
        times = middle if middle > limit else most
        several = quantity != "flow" or len(places) > 1
        if middle > limit or (several and most < 1.0 / limit):
            remedy = "times what the model has; see the units of both"
            raise InputError(file, f"{quantity}: value", float(f"{times:.3g}"), remedy)


def _opposite(series: Measured, predicted: np.ndarray) -> bool:
    """Whether a mean flow runs against the model's, by more than its noise."""
    mean, sd = float(series.value.mean()), float(np.abs(series.sd).mean())
    return mean * float(predicted.mean()) < 0.0 and abs(mean) > 3.0 * sd


def with_time_steps(problem: Problem) -> Problem:
    """The same with what its time steps do to predictions put right as far as it is known, the rest allowed for."""
    found, forward = time_steps(problem.forward, problem.sd), problem.forward
    weights = [Nuisance(f"time steps, shape {k + 1}", 1.0, shape=k) for k in range(len(found.shapes))]
    shaped = replace(forward, nuisances=[*forward.nuisances, *weights], shapes=found.shapes)
    return replace(problem, forward=shaped, time_steps=found)


def with_noise(problem: Problem, noise: dict[str, Noise]) -> Problem:
    """The same with the waveforms of some quantities as noisy as is said of them here.

    Standard deviations with the model's floor and what time steps add are the measure of it. Shapes of noise that lasts
    get weights, as those of the time steps have. Open loops are then run with `STEPS_WHERE_LASTING` times the steps.
    """
    forward = problem.forward
    starts = np.cumsum([0, *(series.value.size for series in forward.measured)])
    measured, shapes, weights = [], [], []
    for series, start in zip(forward.measured, starts, strict=False):
        mine = slice(start, start + series.value.size)
        if series.statistic == "waveform" and series.quantity in noise:
            sd = problem.sd[mine]
            white, lasting = parts(series, noise[series.quantity])
            added = sd**2 - series.sd**2
            measured.append(
                replace(series, sd=np.sqrt(np.maximum((white * sd) ** 2 - added, (LEAST_WHITE * series.sd) ** 2)))
            )
            for shape in lasting:
                shapes.append(np.zeros(problem.sd.size))
                shapes[-1][mine] = sd * shape
            weights += [f"noise of the {series.quantity} at {series.location} under {series.condition}"] * len(lasting)
        else:
            measured.append(series)
    settings = problem.settings
    if shapes and not forward.anatomy.closed_loop:
        settings = settings.model_copy(update={"steps_per_cycle": STEPS_WHERE_LASTING * settings.steps_per_cycle})
    found = with_time_steps(make_problem(forward.network, forward.conditions, measured, settings))
    if not shapes:
        return found
    before = len(found.forward.shapes)
    weights = [Nuisance(name, 1.0, shape=before + k, noise=True) for k, name in enumerate(weights)]
    nuisances = [*found.forward.nuisances, *weights]
    return replace(
        found, forward=replace(found.forward, nuisances=nuisances, shapes=np.vstack([found.forward.shapes, *shapes]))
    )


def make_problem(
    network: dict, conditions: dict[str, Condition], measured: list[Measured], settings: Settings
) -> Problem:
    """Join checked parts; runs the model once for the scales of the effects' priors."""
    engine = Engine(network)
    anatomy = Anatomy(network)
    names = {vessel: f"mean_flow:{anatomy.inlet(vessel)}" for vessel in anatomy.vessels}
    root = f"mean_pressure:{anatomy.inlet(anatomy.roots[0])}"
    at_beds = {bed: f"mean_pressure:{vessel}:{bed}" for bed, vessel in anatomy.beds.items()}
    values = _as_it_is(engine, [*names.values(), root, *at_beds.values()], settings.steps_per_cycle)
    anatomy.pressure = abs(values[root])
    anatomy.flow = {vessel: values[name] for vessel, name in names.items()}
    anatomy.period = period_of(network)
    parameters = nuisances(network, conditions, measured, settings)
    forward = Forward(
        Simulation(network, conditions, anatomy, settings.steps_per_cycle, settings.threads),
        measured,
        parameters,
        pressure_factor(settings.pressure_unit, values[root]),
        {series.condition: series.period for series in measured},
        {bed: values[name] for bed, name in at_beds.items()},
    )
    forward.masses = {n.mass: _mass(n.mass, conditions, measured, anatomy) for n in parameters if n.mass is not None}
    held = kept_out(conditions)
    problem = Problem(forward, settings, np.ones(forward.size, dtype=bool))
    problem.train = ~np.isin(problem.condition, held)
    for name in held:
        if conditions[name].anchored:
            means = np.array([s.statistic == "mean" for s in measured])[problem.owner]
            problem.train |= (problem.condition == name) & means
    return problem


def _as_it_is(engine: Engine, quantities: list[str], steps_per_cycle: int) -> dict[str, float]:
    """Quantities of the model as it is; settled as loosely as other runs may be where valves keep it from more."""
    for tolerance in (TOLERANCE, LOOSE):
        run = engine.run(quantities=quantities, periodic=True, steps_per_cycle=steps_per_cycle, tolerance=tolerance)
        if run.ok[0]:
            return {name: float(found[0]) for name, found in run.values.items()}
    raise InputError("model", None, None, f"the model does not run as it is: {run.status[0]}")


def _mass(territory: str, conditions, measured, anatomy) -> float:
    """Tissue mass (g) that makes the first measured perfusion right in the model as it is.

    Of a condition that is fitted, if there is one: the prior's mean shall know nothing of what is held out. A reading
    that is lost in its own noise says nothing of the mass; where all are, the best.
    """
    mine = [s for s in measured if s.quantity == "perfusion" and s.location == territory]
    mine = [s for s in mine if not conditions[s.condition].held_out] or mine
    clear = {s.condition: float(s.value[0] / s.sd[0]) for s in mine}
    first = next((s for s in mine if clear[s.condition] > KNOWN), max(mine, key=lambda s: clear[s.condition]))
    flow = anatomy.flow_scale(anatomy.beds[territory]) / conditions[first.condition].coronary_resistance_scale
    return flow / max(float(first.value[0]), float(first.sd[0]), 1e-3 * units.MBF_PER_MIN_PER_G)
