"""Does the prediction improve? Hidden effects, searched and adopted: FFR and bed flows before, after, with the truth.

The truth is off from the searched loop as in the rest of the benchmark. Perfusion of every bed in hyperaemia, with its
noise, and the mean aortic pressure are what each model is fitted to: the pressure by one factor on the systemic
resistances, as uncertain as its measurement, the flows by the posterior of the bed resistances and of the vessels' own,
which are uncertain by as much as the truth is off. FFR is distal over aortic mean pressure where
the distal pressure was measured, in hyperaemia.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student_t

from coronaryuq.adoption.choice import Placed, chosen
from coronaryuq.adoption.network import with_effects
from coronaryuq.bench.discrepancy.tables import wilson
from coronaryuq.case.network.network import UNCERTAIN, Network
from coronaryuq.core.seeds import generator
from coronaryuq.discrepancy.data.apply_condition import apply_condition
from coronaryuq.discrepancy.data.conditions import Condition
from coronaryuq.discrepancy.forward.hypothesis import Hypothesis, PlacedEffect
from coronaryuq.discrepancy.hidden import make_case
from coronaryuq.discrepancy.hidden.experiment import HYPERAEMIA, Experiment
from coronaryuq.discrepancy.hidden.nature import Nature
from coronaryuq.discrepancy.search_case import search_case
from coronaryuq.discrepancy.settings import Settings as SearchSettings
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.posterior.model.tissue import PerGram, Tissue
from coronaryuq.posterior.results import Chains
from coronaryuq.posterior.settings import DreamSettings, IndependenceSettings, Settings
from coronaryuq.posterior.stage import TargetFlows, Unknowns, run_chains
from coronaryuq.zerod.effects.anatomy import Anatomy
from coronaryuq.zerod.effects.library import effect
from coronaryuq.zerod.network.beds import resistance_changes
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.solver.engine import Engine
from coronaryuq.zerod.theta import UncertainParameter

EFFECTS = ("quadratic_stenosis", "diffuse_narrowing", "side_branch_leak")
NOISE = 0.08
"""Relative standard deviation of the perfusion of a bed, as in the plan of the measurements."""
PRESSURE_NOISE = 0.02
"""Relative standard deviation of the mean aortic pressure, of a catheter."""
DRAWS = 200
TUNING = 8
"""Runs in which total and pressure are met: flow is nearly inverse to resistance, pressure nearly follows it."""
LEVEL = (0.05, 0.95)
MOST_FAILED = 0.05
"""Share of draws that may fail; a campaign leaves them out, too, and says so."""
TENTH, NEGLIGIBLE = 0.1, 0.005
"""Relative difference of two errors of FFR below which predictions are equally good; absolute one that is a harm."""
CERTAIN = 1e-6
"""Variance with which a known size enters, in standard deviations of its prior squared."""
STRESS = "hyperaemia"
MODELS = ("before", "after", "truth")
SETTINGS = Settings(dream=DreamSettings(generations=2000), independence=IndependenceSettings(draws=45))


def prediction(experiment: Experiment, nature: Nature, name: str, seed: int, threads: int = 1) -> dict[str, Any]:
    """Hide an effect, search, adopt and predict; the entry of a case that fails has the reason as `failed`."""
    try:
        return _case(experiment, nature, name, seed, threads)
    except FloatingPointError as error:
        return {"effect": name, "seed": seed, "failed": str(error)}


def summary(cases: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return how well cases predict.

    Parameters
    ----------
    cases
        Entries of `prediction`.

    Returns
    -------
    dict
        `cases`: number. `failed`: how many of them failed; the rest counts those that did not. `named_right`: how many.
        `ffr_error_WHEN`, `flow_error_WHEN`: root mean squares of the median's error, of FFR absolute, of bed flows
        relative; `coverage_90_WHEN` and `flow_coverage_90_WHEN`: share of true values within the 90 % range; WHEN:
        before, after, truth. `as_truth`: cases named right whose FFR, by root mean square over places, is off by at
        most a tenth more than with the truth; `truth_as_adopted`: those whose true model is off by at most a tenth more
        than the adopted one, which is what chance gives two equally good models. `error_over_truth`: root mean square
        error after adoption over that with the truth, cases named right together, with its 95 % interval (`low`,
        `high`; linearised, seeds independent, as their cases share the truth; none for one seed). `worse`: all cases in
        which FFR is off by more than before and 0.005. `each`: the same of every case.
    """
    each = [one for one in cases if "failed" not in one]
    found: dict[str, Any] = {"cases": len(cases), "failed": len(cases) - len(each)}
    found["named_right"] = sum(one["named_right"] for one in each)
    for when in MODELS if each else ():
        for kind, prefix in (("ffr", ""), ("flow", "flow_")):
            errors = np.concatenate([one[when][kind]["error"] for one in each])
            inside = np.concatenate([one[when][kind]["inside"] for one in each])
            found[f"{kind}_error_{when}"] = _root_mean_square(errors)
            found[f"{prefix}coverage_90_{when}"] = wilson(int(inside.sum()), len(inside))
    errors_of = [{when: _root_mean_square(one[when]["ffr"]["error"]) for when in MODELS} for one in each]
    right = [errors for one, errors in zip(each, errors_of, strict=True) if one["named_right"]]
    found["as_truth"] = sum(one["after"] <= (1.0 + TENTH) * one["truth"] for one in right)
    found["truth_as_adopted"] = sum(one["truth"] <= (1.0 + TENTH) * one["after"] for one in right)
    found["error_over_truth"] = _error_over_truth([one for one in each if one["named_right"]])
    found["worse"] = sum(one["after"] > one["before"] + NEGLIGIBLE for one in errors_of)
    return found | {"each": list(cases)}


def _error_over_truth(cases: Sequence[dict[str, Any]]) -> dict[str, float] | None:
    """Return the ratio of both models' errors of FFR over all cases, with the interval of its logarithm by seeds."""
    squares: dict[int, np.ndarray] = {}
    for one in cases:
        own = np.array([np.square(one[when]["ffr"]["error"]).sum() for when in ("after", "truth")])
        squares[one["seed"]] = squares.get(one["seed"], 0.0) + own
    if not squares:
        return None
    by_seed = np.array([squares[seed] for seed in sorted(squares)])
    number, means = len(by_seed), by_seed.mean(axis=0)
    log_ratio = 0.5 * np.log(means[0] / means[1])
    if number == 1:
        return {"ratio": float(np.exp(log_ratio))}
    influence = 0.5 * (by_seed / means) @ [1.0, -1.0]
    spread = student_t.ppf(0.975, number - 1) * influence.std(ddof=1) / np.sqrt(number)
    return {name: float(np.exp(log_ratio + sign * spread)) for name, sign in (("ratio", 0), ("low", -1), ("high", 1))}


def _root_mean_square(values: Sequence[float] | np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _case(experiment: Experiment, nature: Nature, name: str, seed: int, threads: int) -> dict[str, Any]:
    random, network = generator(seed, "bench", "loop", name), experiment.network
    hidden, measured = effect(name), _measured(experiment)
    places = [one for one in measured if one in hidden.places(Anatomy(network), experiment.series)]
    placed = PlacedEffect(hidden, places[int(random.integers(len(places)))])
    hypothesis, sizes = Hypothesis((placed,)), random.uniform(-0.5, 1.0, len(hidden.parameters))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        subject = make_case.draw_subject(experiment, nature, seed)
        signal = subject.simulate(hypothesis, sizes)
        subject.write(signal, make_case.Noise(), seed, folder, 0.0)
        files = (folder / "model.json", folder / "measurements.csv", folder / "conditions.yaml")
        answer = search_case(*files, folder / "found", SearchSettings(threads=threads), 1)
    forward = subject.problem.forward
    table, stressed = forward.condition_changes(STRESS, np.concatenate([subject.nuisance, sizes]), hypothesis)
    beds = forward.anatomy.beds
    true = _outputs(stressed, table, measured, list(beds))
    if true.failed:
        raise FloatingPointError("the true model does not run in hyperaemia")
    true_ffr, true_flow, true_pressure = true.ffr[0], true.flow[0], true.pressure[0]
    pressure = float(true_pressure * (1.0 + PRESSURE_NOISE * random.standard_normal()))
    noisy = true_flow * (1.0 + NOISE * random.standard_normal(len(true_flow)))
    targets = TargetFlows(list(beds), noisy, np.diag((NOISE * noisy) ** 2))
    covariance = (CERTAIN * np.eye(len(sizes))).tolist()
    known = [[Placed(name, placed.place, 1.0, False, sizes.tolist(), covariance)]]
    classes = {"before": [], "after": chosen(answer).classes, "truth": known}
    found: dict[str, Any] = {
        "effect": name, "place": placed.place, "seed": seed, "size_z": sizes.tolist(),
        "named_right": any(placed.key == (one.effect, one.place) for group in classes["after"] for one in group),
    }  # fmt: skip
    for when in MODELS:
        adopted = with_effects(network, network, classes[when], answer["scales"]).network
        drawn = _drawn(_with_errors(adopted, nature.vessels), targets, pressure, measured, nature.beds, seed)
        ffr, flow = _scored(drawn.ffr, true_ffr, 1.0), _scored(drawn.flow, true_flow, true_flow)
        found[when] = {"ffr": ffr, "flow": flow, "failed_draws": drawn.failed}
    return found


def _with_errors(network: Network, spread: float) -> Network:
    """Return the network with the errors of its vessels' resistances, the law by which the truth is off, and of Pa."""
    vessels = [v for v in Anatomy(network).vessels if network.vessel_values(v).get("R_poiseuille")]
    entries = [_lognormal(f"resistance_{v}", spread, [f"{v}.R_poiseuille"]) for v in vessels if spread]
    entries.append(_lognormal("pressure", PRESSURE_NOISE, list(_systemic(network))))
    return Network(network | {UNCERTAIN: [*network.get(UNCERTAIN, []), *entries]})


def _lognormal(name: str, spread: float, targets: Sequence[str]) -> dict[str, Any]:
    return UncertainParameter(name, "lognormal", 1.0, spread, "factor", dict.fromkeys(targets, 1.0)).content()


def _systemic(network: Network) -> dict[str, float]:
    """Return "BLOCK.parameter" → value of the resistances behind all outlets but the coronary ones."""
    anatomy = Anatomy(network)
    return {
        f"{block}.{name}": network.bed_values(block)[name]
        for block in anatomy.blocks
        if block not in anatomy.beds
        for name in ("Rp", "Rd", "R")
        if name in network.bed_values(block)
    }


def _drawn(
    network: Network, targets: TargetFlows, pressure: float, measured: Sequence[str], spread: float, seed: int
) -> "_Outputs":
    """Return the outputs at draws of the posterior of a network at rest.

    The prior is that of `uncertainty: full` (`posterior.model.tissue`): each bed conducts as in the network within the
    stated spread, and the level of all is free. Behind a stenosis shares that follow the measured flow have no bed that
    conducts enough.
    """
    nominal = apply_condition(network, Condition(STRESS, coronary_resistance_scale=HYPERAEMIA))
    stressed = _tuned(nominal, targets, pressure)
    vessels = {bed: Anatomy(stressed).beds[bed] for bed in targets.names}
    model = BedFlows(
        "network", vessels, tolerance=1e-4, steps_per_cycle=None, network=stressed, further=PerGram.further
    )
    # Without a spread all beds are as the network has them.
    tissue = Tissue(model.weights, targets.names, max(spread, CERTAIN), 0.0)
    with tempfile.TemporaryDirectory() as folder:
        unknowns = Unknowns(model.weights, model.theta.laws, tissue)
        run_chains(model, unknowns, targets, SETTINGS, seed, Path(folder) / "chains.npz", key="bench")
        chains = Chains.read(Path(folder) / "chains.npz")
    values = np.concatenate([chains.kept_multipliers, chains.kept_parameters], axis=2)
    flat = values.reshape(-1, values.shape[2])
    some = flat[np.linspace(0, len(flat) - 1, min(DRAWS, len(flat))).round().astype(int)]
    theta = dict(zip([*chains.names, *chains.parameter_names], some.T, strict=True))
    drawn = _outputs(stressed, model.theta.changes(theta), measured, targets.names)
    if drawn.failed > MOST_FAILED * len(some):
        raise FloatingPointError(f"{drawn.failed} of {len(some)} draws do not run")
    return drawn


def _tuned(network: Network, targets: TargetFlows, pressure: float) -> Network:
    """Return the network with the targets' total flow and a mean aortic pressure (dyn/cm2).

    One factor on all coronary beds, one on all other resistances behind outlets.
    """
    engine, anatomy, beds, others = Engine(network), Anatomy(network), 1.0, 1.0
    flows = [f"mean_flow:{anatomy.vessel_of[bed]}:{bed}" for bed in targets.names]
    systemic = _systemic(network)

    def changes() -> dict[str, Any]:
        return {**resistance_changes(network, scaling=beds), **{key: others * old for key, old in systemic.items()}}

    for _ in range(TUNING):
        result = engine.run_to_periodic(changes(), [_aorta(anatomy), *flows])
        found = float(result.values[_aorta(anatomy)][0])
        # Flow follows the pressure that is asked for, not the one that is there yet.
        beds *= float(sum(result.values[one][0] for one in flows) / targets.mean.sum()) * pressure / found
        others *= pressure / found
    return with_changes(network, {name: float(value) for name, value in changes().items()})


def _aorta(anatomy: Anatomy) -> str:
    return f"mean_pressure:{anatomy.inlet(anatomy.roots[0])}"


@dataclass(frozen=True)
class _Outputs:
    """Distal over aortic mean pressure (n, places), mean bed flows (n, beds), aortic pressure (n,); failed runs."""

    ffr: np.ndarray
    flow: np.ndarray
    pressure: np.ndarray
    failed: int


def _outputs(network: Network, changes: Mapping[str, Any], measured: Sequence[str], beds: Sequence[str]) -> _Outputs:
    """Return the outputs of runs, without those that failed."""
    anatomy = Anatomy(network)
    aorta = _aorta(anatomy)
    distal = [f"mean_pressure:{anatomy.outlet(vessel)}" for vessel in measured]
    flows = [f"mean_flow:{anatomy.vessel_of[bed]}:{bed}" for bed in beds]
    result = Engine(network).run_to_periodic(dict(changes), [aorta, *distal, *flows])
    ok = result.ok
    pressure = result.values[aorta][ok]
    ratio = np.stack([result.values[one][ok] for one in distal], axis=1) / pressure[:, None]
    flow = np.stack([result.values[one][ok] for one in flows], axis=1)
    return _Outputs(ratio, flow, pressure, int((~ok).sum()))


def _measured(experiment: Experiment) -> list[str]:
    """Return the vessels at whose ends pressure is measured."""
    places = [place for quantity, place, _, _ in experiment.plan.entries if quantity == "pressure"]
    return [place.split(":")[0] for place in places[1:]]


def _scored(drawn: np.ndarray, truth: np.ndarray, scale: np.ndarray | float) -> dict[str, list]:
    low, middle, high = np.quantile(drawn, [LEVEL[0], 0.5, LEVEL[1]], axis=0)
    return {
        "truth": truth.tolist(), "median": middle.tolist(), "error": ((middle - truth) / scale).tolist(),
        "inside": ((truth >= low) & (truth <= high)).tolist(),
    }  # fmt: skip
