"""Stage one's stage: case, network and perfusion targets → the tuned loop and what it fits."""

from collections.abc import Callable, Mapping
from pathlib import Path

from coronaryuq.calibration.conductance_shares import shares
from coronaryuq.calibration.coronary_flow_reserve import Reserve
from coronaryuq.calibration.settings import Settings
from coronaryuq.calibration.targets import from_case, read_targets
from coronaryuq.calibration.tuning import Tuned, tune_loop
from coronaryuq.case.case_json import read_case
from coronaryuq.case.network.units import to_cgs
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json
from coronaryuq.core.io.tables import write_csv
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

    Resistances of LV-perfusing beds are shared by the perfusion's flows, the others by Murray's law; the totals are
    tuned. Raises InputError for targets that are missing or implausible and for outlets that network or perfusion
    lack.
    """
    case = read_case(case_json, "hyperaemia", "targets", "outlets.bc", "outlets.perfuses")
    network, perfusion = read_network(network_json), read_json(targets_json, ("bc", "mean"))
    targets = _enough(from_case(case, case_json), case_json)
    flows = _flows(case, network, perfusion, targets_json)
    reserve = Reserve(sum(flows.values()), tuple(flows), case["hyperaemia"]) if settings.hyperaemic_total else None
    tuned = tune_loop(
        network,
        targets,
        settings,
        seed,
        case["hyperaemia"],
        shares=shares(case["outlets"], flows),
        reserve=reserve,
        threads=threads,
        report=report,
    )
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
    """Tune a network that came with a table of targets and nothing else, such as the published examples.

    Its pressures may be in dyn/cm2 or mmHg, network and table each in its own; what is written is CGS. The beds'
    shares stay as they are, and hyperaemia is the paper's 0.24.
    """
    network, system = to_cgs(read_network(network_json), settings.units, network_json)
    targets = _enough(read_targets(targets_csv), targets_csv)
    report(f"{network_json}: read as {system}; {targets_csv}: mean aortic pressure {targets['PaoMean']:.4g} mmHg")
    tuned = tune_loop(network, targets, settings, seed, HYPERAEMIA, threads=threads, report=report)
    _write(tuned, out_dir)
    return tuned


def _write(tuned: Tuned, out_dir: str | Path) -> None:
    out = Path(out_dir)
    write_network(out / "rest.json", tuned.rest)
    write_network(out / "hyperaemia.json", tuned.hyperaemia)
    write_csv(out / "parameters.csv", tuned.parameters)
    write_csv(out / "fit.csv", tuned.fit)


def _enough(targets: dict[str, float], file: str | Path) -> dict[str, float]:
    for name in NEEDED:
        if name not in targets:
            raise InputError(file, f"targets.{name}", None, f"missing; tuning needs at least {' and '.join(NEEDED)}")
    return targets


def _flows(case: Mapping, network: Mapping, perfusion: Mapping, file: str | Path) -> dict[str, float]:
    """Mean perfusion flow by boundary condition, of exactly the beds that perfuse the left ventricle."""
    flows = {bc: float(flow) for bc, flow in zip(perfusion["bc"], perfusion["mean"], strict=True)}
    feeding = [outlet["bc"] for outlet in case["outlets"] if outlet["perfuses"] == "LV"]
    if set(flows) != set(feeding):
        odd = ", ".join(sorted(set(flows) ^ set(feeding)))
        raise InputError(
            file, "bc", odd, "perfusion targets and LV-perfusing outlets of the case differ; make them again"
        )
    known = beds(network)
    for outlet in case["outlets"]:
        if outlet["bc"] not in known:
            raise InputError(file, "bc", outlet["bc"], "the network has no coronary bed of this name")
    for bc, flow in flows.items():
        if not flow > 0.0:
            raise InputError(file, f"mean of {bc}", flow, "expected a positive flow")
    return flows
