"""From files to a problem: network, conditions and measurements, checked against each other."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from coronaryuq.case.network.network import Network
from coronaryuq.case.network.topology import Topology
from coronaryuq.core import units
from coronaryuq.core.errors import InputError
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition, held_out_names
from coronaryuq.discrepancy.data.measurements import AORTIC, Measured, measured_conditions, read_measurements
from coronaryuq.discrepancy.forward.nuisance import Nuisance, nuisances, tissue_mass
from coronaryuq.discrepancy.forward.predict import Forward
from coronaryuq.discrepancy.forward.reading_scales import with_scales
from coronaryuq.discrepancy.forward.simulation import LOOSE, TOLERANCE, Simulation
from coronaryuq.discrepancy.inference.cross_validation import folds_of
from coronaryuq.discrepancy.inference.evidence import PossibleNoise
from coronaryuq.discrepancy.inference.known_errors import known_errors
from coronaryuq.discrepancy.inference.noise import Estimate, Noise, white_and_correlated
from coronaryuq.discrepancy.inference.outliers import Outlier, samples_of
from coronaryuq.discrepancy.inference.problem import Problem
from coronaryuq.discrepancy.inference.pullback_errors import pullback_errors
from coronaryuq.discrepancy.inference.time_step_error import OSCILLATES
from coronaryuq.discrepancy.settings import Settings
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.pullback import OF_WIRE
from coronaryuq.zerod.effects.searchable import as_searched
from coronaryuq.zerod.network.output_names import inner_unknowns
from coronaryuq.zerod.network.period import period_of
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.solver.periodic import Periodicity

MISTYPED = {"perfusion": 1e4}
"""Largest plausible ratio of a measured value to the largest simulated value; 50 for other quantities."""
UNITS_APART = {"pressure": 6.0, "ratio": 20.0, "flow": 8.0, "volume": 20.0}
"""Largest plausible ratio of all mean measured values to the simulated ones; kPa and mmHg differ by a factor of 7.5,
L/min and mL/s by 16.7, of which half is left to a model that is off. A single flow may be that of a larger vessel."""
FACTORS = {"pressure": " (1 kPa = 7.5 mmHg)", "flow": " (1 L/min = 16.7 mL/s)"}
"""What is most often confused where they are farther apart, for the message."""
LEAST_MEAN = 0.05
"""Smallest simulated mean, over the largest value of the quantity, that a ratio is taken to."""
LEAST_WHITE = 0.1
"""Smallest fraction of a standard deviation that remains white noise, whatever floor and time-step allowance add."""
OUT_OF_USE = 1e3
"""Factor on the standard deviation of a sample that is not to count."""
REFINEMENT, SHORT = 4, 1000
"""Refinement of an open loop's time steps, unless there are as many as `SHORT` in a cycle, where noise is correlated in
time, because sharp features are weighted strongly then, or where the steps' error exceeds `OSCILLATES`.

Far from the data, where no correction at a fit applies, it would decide which effect is best. In a closed loop some
oscillation persists with shorter steps, and runs are expensive."""


def locations(network: Network) -> dict[str, list[str]]:
    """Location names that measurements may use, by quantity."""
    unknowns = Engine(network).unknowns
    places = [name.split(":", 1)[1] for name in unknowns if name.startswith("flow:")]
    internal = inner_unknowns(unknowns)
    return {
        "flow": places + [n for n in internal if n.startswith("Q_")],
        "pressure": places + [n for n in internal if n.startswith("P_")],
        "volume": [n for n in internal if n.startswith("V_")],
        "perfusion": list(Anatomy(network).beds),
        "ratio": places,
    }


def read_series(
    network: Network, measurements: str | Path, conditions: dict[str, Condition], file: str | Path
) -> list[Measured]:
    """Check measurements and conditions against the network, without running it. `file`: the conditions file."""
    networks = {name: apply_condition(network, condition, file) for name, condition in conditions.items()}
    periods = {name: period_of(changed) for name, changed in networks.items()}
    return read_measurements(measurements, conditions, locations(network), periods, Topology(network))


def read_problem(
    network: Network, measurements: str | Path, conditions: dict[str, Condition], file: str | Path, settings: Settings,
    note: Callable[[str], None] = lambda line: None,
) -> Problem:  # fmt: skip
    """Check measurements and conditions against the network and join them. `file`: the conditions file, for messages.

    note: called with a line on every flow that may be in another unit or of reversed sign.

    Raises `InputError`: see `read_measurements`; also when every measured condition is held out.
    """
    measured = read_series(network, measurements, conditions, file)
    used = measured_conditions(measured)
    held = [name for name in used if conditions[name].held_out]
    if len(held) == len(used):
        raise InputError(file, "held_out", held, "every measured condition is held out; fit at least one")
    problem = make_problem(as_searched(network), {n: c for n, c in conditions.items() if n in used}, measured, settings)
    _check_root(problem)
    for line in _check_sizes(problem, measurements):
        note(f"note: {measurements}: {line}")
    if not folds_of(problem, held):
        remedy = (
            "held-out means only determine the free parameters, so nothing remains for validation; add measurements"
        )
        raise InputError(measurements, "condition", ", ".join(held or used), remedy)
    return with_time_steps(problem)


def _check_root(problem: Problem) -> None:
    """Raise `InputError` for an impossible root pressure: the network is in another unit than assumed."""
    pressure = problem.forward.anatomy.pressure * problem.forward.pressure_factor / units.MMHG
    if problem.settings.pressure_unit == "auto" and not AORTIC[0] <= pressure <= AORTIC[1]:
        unit = "mmHg" if problem.forward.pressure_factor == units.MMHG else "dyn/cm2"
        remedy = f"assuming {unit} in all R; expected {AORTIC[0]:g} to {AORTIC[1]:g}; set --pressure-unit, or check R"
        raise InputError("model", "mean root pressure (mmHg)", float(f"{pressure:.3g}"), remedy)


def _check_sizes(problem: Problem, file: str | Path) -> list[str]:
    """Reject measurements far from all simulated values: they are in another unit, or mistyped.

    Each pressure may be in a unit of its own, and so may the flows of each condition. A single flow may be that of
    another vessel, nearly zero or reversed by what is missing, so that only notes are returned of it; the scale of
    perfusion is determined by the data.
    """
    forward, notes = problem.forward, list[str]()
    predicted = forward.split(forward.predict(np.zeros(problem.count)))
    for quantity in dict.fromkeys(series.quantity for series in forward.measured):
        mine = [(s, p[0]) for s, p in zip(forward.measured, predicted, strict=True) if s.quantity == quantity]
        kind = quantity.removeprefix(OF_WIRE)
        largest = max(np.abs(p).max() for _, p in mine)
        if not np.isfinite(largest) or largest == 0.0:
            continue
        if quantity == "flow" and len({s.location for s, _ in mine}) > 1 and all(_opposite(s, p) for s, p in mine):
            remedy = "all measured flows have the opposite sign to the model; check the sign convention"
            raise InputError(file, "mean flow (mL/s)", float(f"{mine[0][0].value.mean():.3g}"), remedy)
        groups: dict[str, list[tuple[Measured, np.ndarray]]] = {}
        for s, own in mine:
            worst = int(np.argmax(np.abs(s.value)))
            times = abs(float(s.value[worst])) / largest
            if times > MISTYPED.get(kind, 50.0):
                at = "" if s.time is None else f", t = {s.time[worst]:.4g} s"
                where = f"{s.condition}/{quantity}/{s.location}/{s.statistic}{at}: ratio to the largest simulated value"
                raise InputError(file, where, float(f"{times:.3g}"), "check the value and its unit")
            at = f"at {s.location} " if kind == "pressure" else ""
            groups.setdefault(f"{quantity} {at}under {s.condition}", []).append((s, own))
        for where, group in groups.items():
            # A mean near zero, as of a flow through a closed valve, has no ratio.
            ratios = [np.abs(s.value).mean() / max(np.abs(p).mean(), LEAST_MEAN * largest) for s, p in group]
            times, limit = float(min(ratios)), UNITS_APART.get(kind, np.inf)
            several = quantity != "flow" or len({s.location for s, _ in group}) > 1
            most = max(np.abs(s.value).max() for s, _ in group) / max(np.abs(p).max() for _, p in group)
            if times > limit or (several and most < 1.0 / limit):
                field, told = f"{where}: ratio of measured to simulated values", times if times > limit else most
                remedy = f"check the column unit, and the unit of the model{FACTORS.get(kind, '')}"
                raise InputError(file, field, float(f"{told:.3g}"), remedy)
            for (s, own), ratio in zip(group, ratios, strict=True) if kind == "flow" else ():
                apart = not 1.0 / limit < ratio < limit and bool(np.abs(own).mean() > LEAST_MEAN * largest)
                if off := "opposite to" if _opposite(s, own) else f"{ratio:.2g} times" * apart:
                    notes.append(f"{s.condition}/flow/{s.location}: mean {off} the model's; check its sign and unit")
    return notes


def _opposite(series: Measured, predicted: np.ndarray) -> bool:
    """Whether a mean flow has the opposite direction to the model's, beyond its noise."""
    mean, sd = float(series.value.mean()), float(np.abs(series.sd).mean())
    return mean * float(predicted.mean()) < 0.0 and abs(mean) > 3.0 * sd


def _finer(problem: Problem) -> Settings | None:
    """Return the settings with shorter time steps; None where the model runs with its own."""
    steps = problem.settings.steps_per_cycle
    if problem.forward.anatomy.closed_loop or steps >= SHORT:
        return None
    return problem.settings.model_copy(update={"steps_per_cycle": REFINEMENT * steps})


def with_time_steps(problem: Problem) -> Problem:
    """Return the problem with the errors of time steps and vessels that the model is known to have.

    The known part of the time-step error is corrected; what varies of it, the errors of the vessels' resistance,
    inertance and compliance, and those that the readings of a pullback share, are shapes with weights to be fitted, and
    what the shapes leave is added to the standard deviations. Errors of vessels that act on predictions nonlinearly are
    nuisance parameters.
    """
    forward, known = problem.forward, known_errors(problem.error_runs(), problem.sd)
    if np.linalg.norm(known.steps.change / problem.sd) > OSCILLATES and (settings := _finer(problem)):
        return with_time_steps(make_problem(forward.network, forward.conditions, forward.measured, settings))
    steps, errors = known.steps, known.parameters.errors
    forward = forward.with_nuisances([*forward.nuisances, *errors]) if errors else forward
    of_wires, shared = pullback_errors(forward.measured)
    weights = [Nuisance(f"time steps, shape {k + 1}", 1.0, shape=k) for k in range(len(steps.shapes))]
    weights += [replace(weight, shape=len(steps.shapes) + k) for k, weight in enumerate([*known.weights, *of_wires])]
    shapes = np.vstack([steps.shapes, known.shapes, shared])
    shaped = replace(forward, nuisances=[*forward.nuisances, *weights], shapes=shapes)
    return replace(problem, forward=shaped, time_steps=replace(steps, sd=np.hypot(steps.sd, known.sd)))


def with_noise(problem: Problem, noise: dict[str, Noise], outliers: Sequence[Outlier] = ()) -> Problem:
    """Return the problem with estimated noise of the waveforms of some quantities, and without some samples.

    Relative to standard deviations with the model's floor and the time-step allowance. Shapes of correlated noise get
    weights, like those of the time steps; open loops then run with `REFINEMENT` times the steps.

    Parameters
    ----------
    problem
        The problem with the stated noise.
    noise
        Quantity → noise of its waveforms.
    outliers
        Samples that are given a standard deviation with which they do not count.

    Returns
    -------
    Problem
        A new problem on the same data.
    """
    forward = problem.forward
    measured, shapes, names = _noisy(problem, noise, outliers)
    finer = _finer(problem) if shapes else None
    noisy = make_problem(forward.network, forward.conditions, measured, finer or problem.settings)
    if finer is None:
        noisy.runs = problem.runs
    noisy = with_time_steps(noisy)
    of_steps = noisy.forward.shapes
    if not shapes or of_steps is None:
        return noisy
    weights = [Nuisance(name, 1.0, shape=len(of_steps) + k, noise=True) for k, name in enumerate(names)]
    nuisances = [*noisy.forward.nuisances, *weights]
    return replace(noisy, forward=replace(noisy.forward, nuisances=nuisances, shapes=np.vstack([of_steps, *shapes])))


def _noisy(
    problem: Problem, noise: dict[str, Noise], outliers: Sequence[Outlier]
) -> tuple[list[Measured], list[np.ndarray], list[str]]:
    """Return the series with the standard deviations of their independent noise, and shapes (N,) of the rest, named."""
    measured: list[Measured] = []
    shapes: list[np.ndarray] = []
    names: list[str] = []
    shown = _quantities(problem.forward.measured)
    for series, rows, quantity in zip(problem.forward.measured, problem.forward.rows, shown, strict=True):
        if quantity in noise:
            sd = problem.sd[rows]
            white, correlated = white_and_correlated(series, noise[quantity])
            added = sd**2 - series.sd**2
            own = np.sqrt(np.maximum((white * sd) ** 2 - added, (LEAST_WHITE * series.sd) ** 2))
            measured.append(replace(series, sd=own))
            for shape in correlated:
                shapes.append(np.zeros(problem.sd.size))
                shapes[-1][rows] = sd * shape
            name = f"noise of the {series.quantity} at {series.location} under {series.condition}"
            names += [name] * len(correlated)
        else:
            measured.append(series)
    return [_without(series, outliers) for series in measured], shapes, names


def _quantities(measured: Sequence[Measured]) -> list[str]:
    """Return the quantity of each series; empty for readings of a pullback, which have errors of their own."""
    return ["" if series.pullback else series.quantity for series in measured]


def possible_noises(
    problem: Problem, estimates: dict[str, Estimate], outliers: Sequence[Outlier]
) -> dict[str, tuple[PossibleNoise, ...]]:
    """Return the noises that the measurements of each quantity may have.

    Parameters
    ----------
    problem
        The problem with the stated noise.
    estimates
        Quantity → noise of its waveforms; `with_noise` takes the most probable one.
    outliers
        Those of `with_noise`.

    Returns
    -------
    dict
        `Problem.noises`.
    """
    best = {quantity: one.noise for quantity, one in estimates.items() if one.noise is not None}
    measured, _, _ = _noisy(problem, best, outliers)
    own = np.concatenate([series.sd for series in measured])
    quantities = np.array(_quantities(measured))
    found = {}
    for quantity, estimate in estimates.items():
        noises = []
        for one in estimate.alternatives:
            series, shapes, _ = _noisy(problem, {quantity: one.noise}, outliers)
            change = np.concatenate([new.sd for new in series]) ** 2 - own**2
            change[quantities[problem.owner] != quantity] = 0.0
            noises.append(PossibleNoise(one.log_prior, change, np.array(shapes).reshape(-1, problem.sd.size)))
        if noises:
            found[quantity] = tuple(noises)
    return found


def _without(series: Measured, outliers: Sequence[Outlier]) -> Measured:
    return replace(series, sd=np.where(samples_of(outliers, [series]), OUT_OF_USE * series.sd, series.sd))


def make_problem(
    network: Network, conditions: dict[str, Condition], measured: list[Measured], settings: Settings
) -> Problem:
    """Join checked parts, and run the model once for the scales of the effects' priors.

    Parameters
    ----------
    network
        svZeroDSolver JSON.
    conditions
        Name → condition, measured ones only.
    measured
        The measurements, CGS.
    settings
        Settings of the search.

    Returns
    -------
    Problem
        Without a time-step correction; `with_time_steps` adds it.

    Raises
    ------
    InputError
        If the model does not run.
    """
    engine, anatomy = Engine(network), Anatomy(network)
    names = {vessel: f"mean_flow:{anatomy.inlet(vessel)}" for vessel in anatomy.vessels}
    root = f"mean_pressure:{anatomy.inlet(anatomy.roots[0])}"
    at_beds = {bed: f"mean_pressure:{vessel}:{bed}" for bed, vessel in anatomy.beds.items()}
    values = _as_it_is(engine, [*names.values(), root, *at_beds.values()], settings.steps_per_cycle)
    anatomy.pressure = abs(values[root])
    anatomy.flow = {vessel: values[name] for vessel, name in names.items()}
    anatomy.period = period_of(network)
    anatomy.driven = {block for condition in conditions.values() for block in condition.drive}
    anatomy.dilated = any(c.coronary_resistance_scale < 1.0 for c in conditions.values() if not c.held_out)
    parameters = nuisances(network, conditions, measured, settings)
    forward = Forward(
        Simulation(network, conditions, anatomy, settings.steps_per_cycle, settings.threads),
        measured,
        parameters,
        units.pressure_factor(settings.pressure_unit, values[root]),
        {series.condition: series.period for series in measured},
        {bed: values[name] for bed, name in at_beds.items()},
    )
    forward.masses = {
        n.mass: tissue_mass(n.mass, conditions, measured, anatomy) for n in parameters if n.mass is not None
    }
    forward = replace(forward, measured=with_scales(forward))
    held = held_out_names(conditions)
    problem = Problem(forward, settings, np.ones(forward.size, dtype=bool))
    problem.train = ~np.isin(problem.condition, held) | problem.anchors(held)
    return problem


def _as_it_is(engine: Engine, quantities: list[str], steps_per_cycle: int) -> dict[str, float]:
    """Return quantities of the plain model, with the looser tolerance of other runs if valves prevent convergence."""
    for tolerance in (TOLERANCE, LOOSE):
        run = engine.run_to_periodic(
            quantities=quantities, periodicity=Periodicity(tolerance=tolerance), steps_per_cycle=steps_per_cycle
        )
        if run.ok[0]:
            return {name: float(values[0]) for name, values in run.values.items()}
    raise InputError("model", None, None, f"the unmodified model does not run: {run.status[0]}")
