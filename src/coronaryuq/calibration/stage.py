"""The calibration stage: case, network and perfusion targets → the tuned loop and its fit."""

from collections.abc import Callable
from pathlib import Path

from coronaryuq.calibration.conductance_shares import shares
from coronaryuq.calibration.hyperaemic_flow import HyperaemicTarget
from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.targets import read_targets
from coronaryuq.calibration.tuning import Goal, Tuned, tune_loop
from coronaryuq.calibration.unmeasured_beds import median_radii, unmeasured_parameters
from coronaryuq.case.case_json import CaseSummary, TargetValue, read_case
from coronaryuq.case.network.network import UNCERTAIN, Network
from coronaryuq.case.network.units import to_cgs
from coronaryuq.case.tables.needed_targets import complete_targets, heart_period
from coronaryuq.case.tables.targets import BY_NAME, check_targets
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.tables import write_csv
from coronaryuq.perfusion.targets import PerfusionTargets, read_perfusion_targets
from coronaryuq.zerod.network.beds import HYPERAEMIA, beds
from coronaryuq.zerod.network.read import read_network, write_network

NEEDED = ("PaoMean", "AbsQin")


def tune(
    case_json: str | Path,
    network_json: str | Path,
    targets_json: str | Path,
    settings: Settings,
    seed: int,
    out_dir: str | Path,
    threads: int = 1,
    report: Callable[[str], None] = print,
) -> None:
    """Tune the case's loop; write rest.json, hyperaemia.json, parameters.csv and fit.csv.

    Conductance is divided among LV-perfusing beds by the flows of the perfusion stage, among the others by Murray's
    law; the totals are tuned.

    Parameters
    ----------
    case_json, network_json, targets_json
        The case, its 0D network at rest, and the perfusion stage's target flows.
    settings, seed
        Settings of the stage and the campaign's seed.
    out_dir
        Folder to write to.
    threads
        Threads of the 0D engine.
    report
        Called with lines of progress.

    Raises
    ------
    InputError
        If a target is missing or implausible, or if an outlet is missing from network or perfusion.
    """
    case, network = read_case(case_json), read_network(network_json)
    perfusion = read_perfusion_targets(targets_json)
    targets = _check_needed(check_targets(case.targets, case_json), case_json)
    flows = _flows(case, network, perfusion, targets_json)
    met = settings.hyperaemic_total
    hyperaemic = HyperaemicTarget(sum(flows.values()), tuple(flows), case.hyperaemia) if met else None
    wanted = shares(case.outlets, median_radii(case.outlets, network), flows, case.murray_exponent)
    goal = Goal(targets, case.hyperaemia, wanted, hyperaemic, case.errors)
    tuned = tune_loop(network, goal, settings, seed, threads, report)
    if case.errors is not None:
        further = unmeasured_parameters(case.outlets, tuned.hyperaemia, case.errors, case.murray_exponent)
        tuned.hyperaemia[UNCERTAIN] = [*tuned.hyperaemia.get(UNCERTAIN, []), *further]
    _write(tuned, out_dir)


def tune_files(
    network_json: str | Path,
    targets_csv: str | Path,
    settings: Settings,
    seed: int,
    out_dir: str | Path,
    threads: int = 1,
    report: Callable[[str], None] = print,
) -> Tuned:
    """Tune a network given only a table of targets, such as the published examples.

    Its pressures may be in dyn/cm2 or mmHg, and those of the table in the other unit; the results are CGS. The beds
    keep their fractions of conductance, and hyperaemia is the paper's 0.24.

    Parameters
    ----------
    network_json, targets_csv
        0D network (svZeroDSolver JSON) and its targets: name, description, value or `none`.
    settings, seed, out_dir, threads, report
        As in `tune`.

    Raises
    ------
    InputError
        If a target is missing or implausible.
    """
    network, system = to_cgs(read_network(network_json), settings.units, network_json)
    targets = _completed(read_targets(targets_csv), network, targets_csv, report)
    report(f"{network_json}: read as {system}; {targets_csv}: mean aortic pressure {targets['PaoMean']:.4g} mmHg")
    tuned = tune_loop(network, Goal(targets, HYPERAEMIA), settings, seed, threads, report)
    _write(tuned, out_dir)
    return tuned


def _write(tuned: Tuned, out_dir: str | Path) -> None:
    out = Path(out_dir)
    write_network(out / "rest.json", tuned.rest)
    write_network(out / "hyperaemia.json", tuned.hyperaemia)
    write_csv(out / "parameters.csv", tuned.parameters)
    write_csv(out / "fit.csv", tuned.fit)


def _completed(
    targets: dict[str, float], network: Network, file: str | Path, report: Callable[[str], None]
) -> dict[str, float]:
    """Return the targets with those without which nothing can be tuned, by what was measured."""
    given = {name: TargetValue(value=value, unit=BY_NAME[name].unit) for name, value in targets.items()}
    own = float(network.heart.get("cardiac_cycle_period") or 1.0)
    heart_period(given, own, file)
    completed, notes = complete_targets(given, own, file)
    for note in notes:
        report(f"note: {note}")
    return check_targets(completed, file)


def _check_needed(targets: dict[str, float], file: str | Path) -> dict[str, float]:
    for name in NEEDED:
        if name not in targets:
            raise InputError(file, f"targets.{name}", None, f"missing; tuning needs at least {' and '.join(NEEDED)}")
    return targets


def _flows(case: CaseSummary, network: Network, perfusion: PerfusionTargets, file: str | Path) -> dict[str, float]:
    """Mean perfusion flow by boundary condition, of exactly the beds that perfuse the left ventricle."""
    flows = dict(zip(perfusion.bc, perfusion.mean.tolist(), strict=True))
    feeding = [outlet.bc for outlet in case.lv_outlets]
    if set(flows) != set(feeding):
        odd = ", ".join(sorted(set(flows) ^ set(feeding)))
        raise InputError(
            file, "bc", odd, "perfusion targets and LV-perfusing outlets of the case differ; recreate them"
        )
    known = beds(network)
    for outlet in case.outlets:
        if outlet.bc not in known:
            raise InputError(file, "bc", outlet.bc, "the network has no coronary bed of this name")
    return flows
