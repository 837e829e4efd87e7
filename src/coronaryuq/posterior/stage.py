"""The posterior stage: run the chains, gather them with a verdict, draw samples of θ."""

import json
import sys
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np

import coronaryuq
from coronaryuq.case.case_json import CaseOutlet, read_case
from coronaryuq.core.errors import InputError
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import read_csv, write_csv
from coronaryuq.core.io.typed import plain
from coronaryuq.core.provenance import checksum, digest, stamp
from coronaryuq.core.ranks import Ranks
from coronaryuq.perfusion.targets import (
    PerfusionTargets,
    of_borders,
    read_perfusion_targets,
    supplied,
    without_borders,
)
from coronaryuq.posterior.model.bed_flows import BedFlows, with_resistances
from coronaryuq.posterior.model.fit_to_fractions import fit_fractions
from coronaryuq.posterior.model.flow_model import FlowModel, Posterior, respond
from coronaryuq.posterior.model.fractions import fractions
from coronaryuq.posterior.model.likelihood import Likelihood, RelativeLikelihood
from coronaryuq.posterior.model.tissue import PerGram, Tissue
from coronaryuq.posterior.model.total_resistance import Conditioned, Rescaled
from coronaryuq.posterior.reading import Reading
from coronaryuq.posterior.results import PRIOR_SHARE, Chains, ReferenceShares
from coronaryuq.posterior.sampler import chains as sampling
from coronaryuq.posterior.sampler import checkpoint
from coronaryuq.posterior.samples import FIRST, Lengths, theta
from coronaryuq.posterior.settings import Settings
from coronaryuq.posterior.summary import by_name, summarise, table_of_draws, write_inference_data
from coronaryuq.zerod.network.beds import SCALING, distal_resistances
from coronaryuq.zerod.network.read import read_network, write_network
from coronaryuq.zerod.theta import Laws


@dataclass(frozen=True)
class TargetFlows:
    """Target flows of N beds: names, mean (N,) in mL/s, covariance (N, N), and the file that they come from."""

    names: list[str]
    mean: np.ndarray
    covariance: np.ndarray
    source: str | Path = "targets"


@dataclass(frozen=True)
class GatheredFiles:
    """Files that `gather` writes.

    posterior: a DataTree for ArviZ. draws: thinned draws of r. summary: verdict, predictive checks, fit. fractions:
    target fractions beside those of the fit and of the posterior. fitted: the hyperaemic loop with the fitted
    resistances, svZeroDSolver JSON.
    """

    posterior: str | Path
    draws: str | Path
    summary: str | Path
    fractions: str | Path
    fitted: str | Path


@dataclass(frozen=True)
class Extent:
    """Length of chains, over that which the settings give, burn-in apart; before: file of shorter ones to continue."""

    length: int = 1
    before: str | Path | None = None


def sample(
    case_json: str | Path, hyperaemia_json: str | Path, targets_json: str | Path, settings: Settings, seed: int,
    out_npz: str | Path, ranks: Ranks | None = None, extent: Extent = Extent(),
) -> None:  # fmt: skip
    """Run all chains and write them to one file; MPI ranks share the 0D runs.

    Beside `out_npz`, in a folder of its name, are one file per chain and a checkpoint. Started again with the same
    inputs, settings and seed after an interruption, it continues and ends with the same bits; the number of ranks and
    threads does not matter either, nor whether chains were made in one go or from shorter ones.

    Parameters
    ----------
    case_json, hyperaemia_json, targets_json
        The case, its tuned loop under hyperaemia, and the perfusion stage's target flows.
    settings, seed
        Settings of the stage and the campaign's seed.
    out_npz
        Chains to write (`results.Chains`).
    ranks
        MPI ranks and the threads of each; by default this process alone, with one thread.
    extent
        Length of the chains, and shorter ones to begin with.

    Raises
    ------
    InputError
        If the files do not agree, or if the covariance is not positive definite.
    """
    ranks = ranks or Ranks()
    targets, outlets, held = _read_targets(targets_json, case_json)
    vessels = {outlet.bc: outlet.vessel for outlet in outlets}
    errors = read_case(case_json).errors
    tissue = None
    if errors is not None:
        arteries = [outlet.branch for outlet in outlets]
        tissue = Tissue(
            supplied(held), arteries, errors.microvascular, errors.microvascular_correlation, of_borders(held)
        )
        targets = replace(targets, covariance=without_borders(held))
    model = BedFlows(
        hyperaemia_json, vessels, tolerance=settings.cycle_tolerance, steps_per_cycle=settings.steps_per_cycle,
        threads=ranks.threads, further=() if tissue is None else PerGram.further,
    )  # fmt: skip
    stated = None if errors is None else errors.model_dump()
    key = digest([checksum(hyperaemia_json), checksum(targets_json), stated, _deciding(settings), seed, _code()])
    unknowns = Unknowns(model.weights, model.theta.laws, tissue)
    run_chains(model, unknowns, targets, settings, seed, out_npz, key=key, ranks=ranks, extent=extent)


@dataclass(frozen=True)
class Unknowns:
    """What is inferred: shares of conductance, from those at r-hat (N,), and the network's uncertain parameters.

    tissue: of the beds, if their prior is one of conductance per gram.
    """

    weights: np.ndarray
    laws: Laws = Laws()
    tissue: Tissue | None = None


def run_chains(
    model: FlowModel, unknowns: Unknowns, targets: TargetFlows, settings: Settings, seed: int, out_npz: str | Path,
    *, key: str, ranks: Ranks | None = None, extent: Extent = Extent(),
) -> None:  # fmt: skip
    """`sample` for any model of flows.

    key: identifies all inputs, but not the length; a checkpoint of another key is not continued.
    """
    ranks = Ranks() if ranks is None else ranks
    weights, laws = unknowns.weights, unknowns.laws
    names, folder = targets.names, Path(out_npz).with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    found = checkpoint.find(folder, extent.before, key)
    ranks.barrier()  # every rank has looked before any of them writes
    fit = found.prepared.fit if found else ranks.run_on_first(lambda: fit_fractions(model.flows, weights, targets.mean))
    scaled = settings.scale_targets and unknowns.tissue is None
    factor = float(fit.flows_at_r_hat.sum() / targets.mean.sum()) if scaled else 1.0
    kind = Likelihood if unknowns.tissue is None else RelativeLikelihood
    space, noise = _space(unknowns, settings), targets.covariance
    if isinstance(space, PerGram):
        noise = noise + space.left * np.outer(targets.mean, targets.mean)
    likelihood = kind(targets.mean * factor, noise * factor**2, targets.source)
    response = found.prepared.response if found else None
    if response is None and len(laws) and unknowns.tissue is None:
        response = ranks.run_on_first(lambda: respond(model, laws, fit.flows_at_r_hat))
        fit = replace(fit, runs=fit.runs + 2 * len(laws) + len(response.chosen))
    # With `uncertainty: paper` the emulator is that of the published numbers.
    posterior = Posterior(
        model, space, likelihood, ranks, response, total_known=not scaled, steady=unknowns.tissue is not None
    )
    if ranks.rank == 0:
        _warn_outside(space.outside(fit.multipliers), settings.prior, names)
    prepared = found.prepared if found else sampling.prepare(posterior, fit, settings, seed)
    posterior.failures = prepared.failures
    if ranks.rank == 0:
        checkpoint.write_prepared(folder, prepared, key)
    dream = sampling.sampler(posterior, prepared, settings, seed, extent.length)
    state = dream.start(prepared.start, (prepared.log_density, prepared.flows))
    recorder = checkpoint.Recorder(folder, dream.decisions, state, posterior, key)
    if found and found.done <= dream.decisions:
        state = recorder.resume(found) or state
    between = max(1, settings.checkpoint // (settings.emulator.generations if prepared.emulator else 1))
    further = [*space.further, *laws.names]
    state = sampling.run(dream, state, recorder, between, [*names, *further], space.inputs)
    if ranks.rank == 0:
        position, log_density, flows, log_weight = (
            recorder.values[name].swapaxes(0, 1) for name in checkpoint.RECORDED
        )
        count, decisions, dimension = position.shape
        inputs = space.inputs(position.reshape(-1, dimension)).reshape(count, decisions, -1)
        emulator = prepared.emulator
        reading = Reading.of_the_flow(len(names))
        if isinstance(space, PerGram):
            reading = space.reading
            flows = flows / reading.over_flow(space.multipliers(position.reshape(-1, dimension))).reshape(flows.shape)
        Chains(
            names=names, multipliers=np.ascontiguousarray(inputs[:, :, : len(names)]), parameter_names=further,
            parameters=np.ascontiguousarray(inputs[:, :, len(names) :]), flows=flows, log_density=log_density,
            log_weight=log_weight,
            burn_in=dream.burn_in, every=dream.every, generations=int(state.generation), length=extent.length,
            accepted=state.accepted, proposed=int(state.proposed),
            screen_accepted=state.screen_accepted, screen_proposed=int(state.screen_proposed),
            emulated=emulator is not None, emulator_error=np.zeros(0) if emulator is None else emulator.error,
            independent=prepared.walk is not None, pilot_k_hat=prepared.k_hat, refused=prepared.refused,
            runs=prepared.runs + int(state.evaluations), failures=posterior.failures, outliers=int(state.outliers),
            crossover=state.crossover, weights=weights, target_scale=factor,
            target_mean=likelihood.mean, target_covariance=likelihood.covariance,
            reading_gain=reading.gain, reading_centre=reading.centre,
            prior_ranges=space.ranges(PRIOR_SHARE),
            fit_multipliers=fit.multipliers, fit_flows=fit.flows, fit_error=fit.error,
            fit_outside=space.outside(fit.multipliers),
        ).write(out_npz, also=recorder.arrays(prepared, state))  # fmt: skip
    ranks.barrier()


def gather(
    case_json: str | Path, hyperaemia_json: str | Path, targets_json: str | Path, chains_npz: str | Path,
    settings: Settings, seed: int, out: GatheredFiles,
) -> None:  # fmt: skip
    """Turn chains into draws, a summary with a verdict, and the fitted network.

    Parameters
    ----------
    case_json, hyperaemia_json, targets_json
        As in `sample`.
    chains_npz
        Chains of `sample`.
    settings, seed
        Settings of the stage and the campaign's seed.
    out
        Files to write.

    Raises
    ------
    InputError
        If the chains are not of these targets.
    """
    targets, outlets, held = _read_targets(targets_json, case_json)
    chains = Chains.read(chains_npz)
    names = chains.names
    if names != targets.names:
        raise InputError(chains_npz, "names", names, "not the outlets of the targets; run the chains again")
    write_inference_data(chains, out.posterior)
    draws = table_of_draws(chains, settings.draws)
    write_csv(out.draws, draws)
    network = read_network(hyperaemia_json)
    totals = distal_resistances(network)
    resistances = np.array([totals[name] for name in names])
    write_csv(out.fractions, fractions([outlet.name for outlet in outlets], held.volume, resistances, chains))
    fitted = with_resistances(network, hyperaemia_json, by_name(names, chains.fit_multipliers))
    write_network(out.fitted, fitted)
    shares = targets.mean / targets.mean.sum()
    difference = float(np.max(np.abs(chains.weights / shares - 1.0)))
    r_hat = ReferenceShares(by_name(names, chains.weights), by_name(names, shares), difference)
    provenance = stamp(
        seed=seed, settings=settings.model_dump(), network=checksum(hyperaemia_json), targets=checksum(targets_json)
    )
    write_json(out.summary, plain(summarise(chains, settings, seed, len(draws), r_hat, provenance)))


def thin(chains_npz: str | Path, settings: Settings, out_csv: str | Path) -> None:
    """Write the table of draws of some chains, from which samples are drawn."""
    write_csv(out_csv, table_of_draws(Chains.read(chains_npz), settings.draws))


def draw_samples(
    draws_csv: str | Path, settings: Settings, seed: int, name: str, number: int, out_csv: str | Path,
    lengths: Lengths = FIRST,
) -> None:  # fmt: skip
    """Write `number` samples θ = (r, s) of one set; a longer table begins with the shorter one.

    Parameters
    ----------
    draws_csv
        Draws of `thin`.
    settings, seed
        Settings of the stage and the campaign's seed.
    name
        Of the set: "pilot" or "propagation".
    number
        Rows of the table.
    out_csv
        Table to write: `sample`, the state's `chain` and `draw`, one multiplier per bed and one value per uncertain
        parameter, `R_cor_scaling`: that of the draw if it was inferred, otherwise drawn by itself.
    lengths
        From which sample on the chains had which length; the last one is that of the draws.

    Raises
    ------
    InputError
        If the table of draws is empty or holds a value that is not a finite number.
    """
    draws = read_csv(draws_csv, columns=("chain", "generation", "log_density"))
    columns = [column for column in draws.columns if column not in ("chain", "generation", "log_density", SCALING)]
    if draws.empty or not columns:
        raise InputError(draws_csv, None, None, "contains no draws; gather the posterior again")
    for column in columns:
        wrong = [value for value in draws[column].tolist() if not (isinstance(value, int | float) and isfinite(value))]
        if wrong:
            raise InputError(draws_csv, column, wrong[0], "expected numbers; gather the posterior again")
    write_csv(out_csv, theta(draws, columns, name, number, settings.scaling, seed, lengths))


def _space(unknowns: Unknowns, settings: Settings) -> Conditioned | Rescaled | PerGram:
    if unknowns.tissue is not None:
        return PerGram(unknowns.weights, unknowns.tissue, unknowns.laws)
    kind = Conditioned if settings.constraint == "conditioned" else Rescaled
    return kind(unknowns.weights, settings.prior, unknowns.laws)


def _warn_outside(lies_outside: np.ndarray, prior: tuple[float, float], names: list[str]) -> None:
    outside = [name for name, lies in zip(names, lies_outside.tolist(), strict=True) if lies]
    if outside:
        print(
            f"warning: targets need resistances outside the prior {prior} x r-hat at {', '.join(outside)}",
            file=sys.stderr, flush=True,
        )  # fmt: skip


def _deciding(settings: Settings) -> str:
    """Serialise the settings that determine the chains' numbers."""
    late = ("checkpoint", "rhat_limit", "ess_limit", "draws", "scaling")
    return json.dumps(settings.model_dump(exclude=set(late)), sort_keys=True)


def _code() -> list[str]:
    """Checksums of the sources that the chains' numbers come from: a checkpoint of other code is not continued."""
    root = Path(coronaryuq.__file__).parent
    return [checksum(path) for part in ("posterior", "zerod") for path in sorted((root / part).rglob("*.py"))]


def _read_targets(
    targets_json: str | Path, case_json: str | Path
) -> tuple[TargetFlows, list[CaseOutlet], PerfusionTargets]:
    """Return the target flows, the case's outlets in their order, and all that the perfusion stage says of them."""
    targets = read_perfusion_targets(targets_json)
    outlets = {outlet.bc: outlet for outlet in read_case(case_json).outlets}
    for bc in targets.bc:
        if bc not in outlets:
            raise InputError(targets_json, "bc", bc, "no such outlet in the case; rerun the rule `perfusion_gather`")
    if len(targets.bc) < 2:
        raise InputError(targets_json, "bc", targets.bc, "expected at least two outlets that perfuse the LV")
    flows = TargetFlows(targets.bc, targets.mean, targets.covariance, targets_json)
    return flows, [outlets[bc] for bc in targets.bc], targets
