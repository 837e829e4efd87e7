"""The posterior stage: chains, their gathering with a verdict, samples of θ."""

import json
import sys
import warnings
from pathlib import Path

import numpy as np

import coronaryuq
from coronaryuq.case.case_json import read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import read_json, replacing, write_json
from coronaryuq.core.io.tables import read_csv, read_npz, write_csv
from coronaryuq.core.provenance import checksum, digest, stamp
from coronaryuq.core.ranks import Ranks
from coronaryuq.core.seeds import generator
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.posterior.model.fit_to_fractions import Fit, fit_fractions
from coronaryuq.posterior.model.flow_model import FlowModel, Posterior
from coronaryuq.posterior.model.fractions import fractions
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.predictive import check
from coronaryuq.posterior.model.total_resistance import Conditioned, Rescaled
from coronaryuq.posterior.sampler import chains as carried
from coronaryuq.posterior.sampler.diagnostics import diagnose
from coronaryuq.posterior.samples import theta
from coronaryuq.posterior.settings import Settings
from coronaryuq.zerod.network.beds import SCALING, distal_resistances, resistance_changes
from coronaryuq.zerod.network.changes import with_changes
from coronaryuq.zerod.network.read import read_network, write_network

_SPACES = {"conditioned": Conditioned, "rescaled": Rescaled}


def sample(
    case_json: str | Path, hyperaemia_json: str | Path, targets_json: str | Path, settings: Settings, seed: int,
    out_npz: str | Path, threads: int = 1,
) -> None:  # fmt: skip
    """Run all chains and write them to one file; under `mpiexec` or `srun` the ranks share the 0D runs.

    Beside `out_npz`, in a folder of its name, are one file per chain and a checkpoint. Started again with the same
    inputs, settings and seed after an interruption, it continues and ends with the same bits; the number of ranks and
    threads does not matter either.
    """
    ranks = Ranks.from_launcher()
    targets = _targets(targets_json, case_json)
    model = BedFlows(
        hyperaemia_json, targets["outlets"],
        tolerance=settings.cycle_tolerance, steps_per_cycle=settings.steps_per_cycle, threads=threads,
    )  # fmt: skip
    key = digest([checksum(hyperaemia_json), checksum(targets_json), _deciding(settings), seed, _code()])
    run_chains(model, model.weights, targets["mean"], targets["covariance"], settings, seed, out_npz,
               names=model.beds, key=key, ranks=ranks, source=targets_json)  # fmt: skip


def run_chains(
    model: FlowModel, weights: np.ndarray, mean: np.ndarray, covariance: np.ndarray, settings: Settings, seed: int,
    out_npz: str | Path, *, names: list[str], key: str, ranks: Ranks | None = None, source: str | Path = "targets",
) -> None:  # fmt: skip
    """`sample` for any model of flows.

    weights (N,): shares of conductance at r-hat. mean (N,) and covariance (N, N): target flows. names: of the beds.
    key: stands for all inputs; a checkpoint of another key is not continued.
    """
    ranks = Ranks() if ranks is None else ranks
    folder = Path(out_npz).with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    fit = ranks.run_on_first(lambda: fit_fractions(model.flows, weights, mean))
    factor = float(fit.flows_at_r_hat.sum() / mean.sum()) if settings.scale_targets else 1.0
    likelihood = Likelihood(mean * factor, covariance * factor**2, source)
    space = _SPACES[settings.constraint](weights, settings.prior)
    posterior = Posterior(model, space, likelihood, ranks)
    plain = settings.model_copy(deep=True)
    plain.emulator.use = settings.emulator.use and isinstance(space, Conditioned)
    prepared = carried.prepare(posterior, _within(fit, settings.prior, names, ranks), plain, seed)
    dream = carried.sampler(posterior, prepared, plain, seed)
    state = dream.start(prepared.start, (prepared.log_density, prepared.flows))
    recorder = carried.Recorder(folder, dream.decisions, state, ranks, key)
    state = carried.run(dream, state, recorder, settings.checkpoint, names, space.multipliers)
    if ranks.rank == 0:
        _write(out_npz, dream, state, recorder, prepared, posterior, weights, factor, names)
    ranks.barrier()


def gather(
    case_json: str | Path, hyperaemia_json: str | Path, targets_json: str | Path, chains_npz: str | Path,
    settings: Settings, seed: int, posterior_nc: str | Path, draws_csv: str | Path, summary_json: str | Path,
    fractions_csv: str | Path, fitted_json: str | Path,
) -> None:  # fmt: skip
    """Chains to what comes of them.

    posterior_nc: ArviZ InferenceData. draws_csv: thinned draws of r. summary_json: verdict, predictive checks, fit.
    fractions_csv: target fractions beside those of the fit and of the posterior. fitted_json: the hyperaemic loop with
    the fitted resistances, svZeroDSolver JSON.
    """
    targets = _targets(targets_json, case_json)
    chains = read_npz(chains_npz, ("names", "multipliers", "flows", "log_density", "burn_in", "weights"))
    names = [str(name) for name in chains["names"]]
    if names != [outlet["bc"] for outlet in targets["outlets"]]:
        raise InputError(chains_npz, "names", names, "not the outlets of the targets; run the chains again")
    verdict = summarise(chains, settings, seed, posterior_nc, draws_csv)
    network = read_network(hyperaemia_json)
    totals, kept = distal_resistances(network), slice(int(chains["burn_in"]), None)
    resistances = np.array([totals[name] for name in names])
    outlets = [outlet["name"] for outlet in targets["outlets"]]
    write_csv(fractions_csv, fractions(outlets, names, targets["volume"], resistances, chains, kept))
    fitted = resistance_changes(network, dict(zip(names, chains["fit_multipliers"], strict=True)))
    write_network(fitted_json, with_changes(network, fitted, hyperaemia_json))
    shares = targets["mean"] / targets["mean"].sum()
    write_json(
        summary_json,
        {
            **verdict,
            "r_hat": {
                "conductance_share": dict(zip(names, chains["weights"], strict=True)),
                "target_share": dict(zip(names, shares, strict=True)),
                "largest_relative_difference": np.max(np.abs(chains["weights"] / shares - 1.0)),
            },
            "provenance": stamp(
                seed=seed,
                settings=settings.model_dump(),
                network=checksum(hyperaemia_json),
                targets=checksum(targets_json),
            ),
        },
    )


def summarise(chains: dict, settings: Settings, seed: int, posterior_nc: str | Path, draws_csv: str | Path) -> dict:
    """`gather` for the arrays of any `run_chains`: writes the first two files, returns the summary's core."""
    import arviz
    import pandas as pd

    names = [str(name) for name in chains["names"]]
    kept = slice(int(chains["burn_in"]), None)
    multipliers, flows = chains["multipliers"][:, kept], chains["flows"][:, kept]
    likelihood = Likelihood(chains["target_mean"], chains["target_covariance"])
    n, length = multipliers.shape[:2]
    flat = multipliers.reshape(-1, len(names))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="More chains")
        data = arviz.from_dict(
            posterior={"r": multipliers, "flow": flows},
            sample_stats={"lp": chains["log_density"][:, kept]},
            observed_data={"target_flow": likelihood.mean},
            coords={"bed": names},
            dims={"r": ["bed"], "flow": ["bed"], "target_flow": ["bed"]},
        )
    for group in data.groups():
        data[group].attrs.pop("created_at", None)  # equal posteriors are equal files
    size = sum(data[group].nbytes for group in data.groups())
    with replacing(posterior_nc, room=size + 2**17) as beside:  # HDF5 loses the error on a full disk
        data.to_netcdf(str(beside))
    stride = max(1, -(-n * length // settings.draws))
    chosen = np.arange(0, n * length, stride)
    by_generation = multipliers.transpose(1, 0, 2).reshape(-1, len(names))[chosen]
    density = chains["log_density"][:, kept].T.reshape(-1)[chosen]
    table = pd.DataFrame(by_generation, columns=names)
    table.insert(0, "chain", chosen % n)
    table.insert(1, "generation", (chosen // n + kept.start + 1) * int(chains["every"]))
    table["log_density"] = density
    write_csv(draws_csv, table)
    likeliest = np.argmax(chains["log_density"][:, kept])
    return {
        **diagnose(multipliers, names, settings.rhat_limit, settings.ess_limit),
        "chains": n,
        "generations": int(chains["generations"]),
        "recorded_per_chain": length,
        "draws": len(table),
        "acceptance": float(np.mean(chains["accepted"]) / chains["proposed"]),
        "emulator": {
            "used": bool(chains["emulated"]),
            "generations_per_decision": int(chains["every"]),
            "acceptance": float(np.mean(chains["screen_accepted"]) / chains["screen_proposed"])
            if chains["emulated"]
            else None,
            "error_of_log_flow": chains["emulator_error"],
        },  # fmt: skip
        "model_runs": int(chains["runs"]),
        "failed_runs": int(chains["failures"]),
        "outlier_chains_restarted": int(chains["outliers"]),
        "crossover_probabilities": chains["crossover"],
        "constraint": settings.constraint,
        "target_scale": float(chains["target_scale"]),
        "fit": {
            "multipliers": dict(zip(names, chains["fit_multipliers"], strict=True)),
            "flows": dict(zip(names, chains["fit_flows"], strict=True)),
            "largest_fraction_error": float(chains["fit_error"]),
            "outside_prior": [
                name
                for name, m in zip(names, chains["fit_multipliers"], strict=True)
                if not settings.prior[0] <= m <= settings.prior[1]
            ],
        },  # fmt: skip
        "multipliers": {
            name: {"mean": m.mean(), "sd": m.std(ddof=1), "q025": q[0], "median": q[1], "q975": q[2]}
            for name, m, q in zip(names, flat.T, np.quantile(flat, [0.025, 0.5, 0.975], axis=0).T, strict=True)
        },
        "most_probable_draw": dict(zip(names, flat[likeliest], strict=True)),
        "predictive": check(
            flows.reshape(-1, len(names)), likelihood, names, generator(seed, "posterior", "predictive")
        ),
    }


def draw_samples(
    draws_csv: str | Path, settings: Settings, seed: int, name: str, count: int, out_csv: str | Path
) -> None:
    """`count` samples θ = (r, s) of the set `name` ("pilot", "propagation"); a longer table begins with the shorter."""
    draws = read_csv(draws_csv, columns=("chain", "generation", "log_density"))
    beds = [column for column in draws.columns if column not in ("chain", "generation", "log_density", SCALING)]
    if draws.empty or not beds:
        raise InputError(draws_csv, None, None, "holds no draws; gather the posterior again")
    for bed in beds:
        wrong = [value for value in draws[bed].tolist() if not (isinstance(value, int | float) and 0 < value < np.inf)]
        if wrong:
            raise InputError(draws_csv, bed, wrong[0], "wanted positive multipliers; gather the posterior again")
    write_csv(out_csv, theta(draws, beds, name, count, settings.scaling, seed))


def _within(fit: Fit, prior: tuple[float, float], names: list[str], ranks: Ranks) -> Fit:
    outside = [n for n, m in zip(names, fit.multipliers, strict=True) if not prior[0] < m < prior[1]]
    if outside and ranks.rank == 0:
        print(
            f"warning: targets ask for resistances outside the prior {prior} x r-hat at {', '.join(outside)}",
            file=sys.stderr, flush=True,
        )  # fmt: skip
    return fit


def _write(out_npz, dream, state, recorder, prepared, posterior, weights, factor, names) -> None:
    space, values = posterior.space, {name: value.swapaxes(0, 1) for name, value in recorder.values.items()}
    chains, decisions, d = values["position"].shape
    multipliers = space.multipliers(values["position"].reshape(-1, d)).reshape(chains, decisions, -1)
    emulator = prepared.emulator
    with replacing(out_npz) as beside:
        np.savez(
            beside,
            names=np.array(names), multipliers=multipliers, flows=values["output"], log_density=values["log_density"],
            burn_in=dream.burn_in, every=dream.every, generations=state.generation,
            accepted=state.accepted, proposed=state.proposed,
            screen_accepted=state.screen_accepted, screen_proposed=state.screen_proposed,
            emulated=emulator is not None, emulator_error=np.zeros(0) if emulator is None else emulator.error,
            runs=prepared.runs + int(state.evaluations), failures=posterior.failures, outliers=state.outliers,
            crossover=state.crossover, weights=weights, target_scale=factor,
            target_mean=posterior.likelihood.mean, target_covariance=posterior.likelihood.covariance,
            fit_multipliers=prepared.fit.multipliers, fit_flows=prepared.fit.flows, fit_error=prepared.fit.error,
        )  # fmt: skip


def _deciding(settings: Settings) -> str:
    """Settings that decide the chains' numbers, as text."""
    late = ("checkpoint", "rhat_limit", "ess_limit", "draws", "scaling")
    return json.dumps(settings.model_dump(exclude=set(late)), sort_keys=True)


def _code() -> list[str]:
    """Checksums of the sources that the chains' numbers come from: a checkpoint of other code is not continued."""
    root = Path(coronaryuq.__file__).parent
    return [checksum(path) for part in ("posterior", "zerod") for path in sorted((root / part).rglob("*.py"))]


def _targets(targets_json: str | Path, case_json: str | Path) -> dict:
    """Mean, covariance, territory volumes, and the case's outlets in the order of the targets."""
    case, targets = read_case(case_json, "outlets.bc"), read_json(targets_json, ("bc", "mean", "covariance"))
    outlets = {outlet["bc"]: outlet for outlet in case["outlets"]}
    for bc in targets["bc"]:
        if bc not in outlets:
            raise InputError(targets_json, "bc", bc, "no such outlet in the case; gather the perfusion stage again")
    mean, covariance = np.array(targets["mean"], dtype=float), np.array(targets["covariance"], dtype=float)
    if len(mean) < 2:
        raise InputError(targets_json, "bc", targets["bc"], "want at least two outlets that perfuse the LV")
    if mean.shape != (len(targets["bc"]),) or covariance.shape != (len(mean), len(mean)):
        raise InputError(targets_json, "covariance", covariance.shape, f"want {len(mean)} by {len(mean)}")
    if not np.all(mean > 0):
        raise InputError(targets_json, "mean", float(mean.min()), "target flows must be positive")
    volume = np.array(targets.get("volume", np.full(len(mean), np.nan)), dtype=float)
    return {
        "mean": mean,
        "covariance": covariance,
        "volume": volume,
        "outlets": [outlets[bc] for bc in targets["bc"]],
    }
