"""Benchmark `dream`: posterior of the bundled patient at the paper's size, compared with a sampler from a library."""

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from coronaryuq.calibration.conductance_shares import share_out, shares
from coronaryuq.case.case_json import read_case
from coronaryuq.case.settings import Settings as CaseSettings
from coronaryuq.case.stage import prepare_case
from coronaryuq.perfusion import stage as perfusion
from coronaryuq.perfusion.settings import Settings as PerfusionSettings
from coronaryuq.perfusion.targets import read_perfusion_targets
from coronaryuq.posterior import stage as posterior
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.posterior.model.emulator import Emulator
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.linearised import Linearised, design_size
from coronaryuq.posterior.model.total_resistance import Conditioned
from coronaryuq.posterior.results import Chains
from coronaryuq.posterior.sampler.diagnostics import effective_size, split_rhat
from coronaryuq.posterior.settings import DreamSettings, EmulatorSettings, IndependenceSettings, Settings
from coronaryuq.synthetic.patient import write_files
from coronaryuq.synthetic.settings import Settings as SyntheticSettings
from coronaryuq.synthetic.truth import make_patient
from coronaryuq.zerod.network.read import write_network

SEED = 20241117
WALKERS = 32


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--delayed", action="store_true", help="delayed acceptance instead of independence steps")


def run(quick: bool, delayed: bool = False) -> dict:
    """Run 24 chains: 200 draws of independence steps (quick: 40), or 10,000 generations (quick: 1000) if `delayed`.

    The loop is the bundled patient's true one with conductances in proportion to the target flows, so no calibration is
    needed. `library_ess_per_cpu_s`: emcee on the same posterior through the same engine. Its autocorrelation time comes
    from this run; a quick one takes it from a long run on the emulated posterior, and only the cost from the engine.
    """
    settings = Settings(
        dream=DreamSettings(generations=1000 if quick else 10_000),
        emulator=EmulatorSettings(generations=50),
        independence=IndependenceSettings(use=not delayed, draws=40 if quick else 200),
        checkpoint=500 if quick else 1000,
    )
    with tempfile.TemporaryDirectory(prefix="dream-") as folder:
        files = bundled_files(Path(folder), realisations=100 if quick else 500)
        model, likelihood = target_of(files, settings)
        wall, cpu = time.perf_counter(), time.process_time()
        posterior.sample(*files, settings, SEED, Path(folder) / "chains.npz")
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        chains = Chains.read(Path(folder) / "chains.npz")
    draws = chains.kept_multipliers
    ess, tail = (effective_size(draws, kind).min() for kind in ("bulk", "tail"))
    library = _library(model, likelihood, chains, settings, quick)
    return {
        "chains": settings.dream.chains,
        "generations": chains.generations,
        "evaluations": settings.dream.chains * chains.generations,
        "model_evaluations": chains.runs,
        "cpu_s": round(cpu, 2),
        "wall_s": round(wall, 2),
        "rhat_max": round(float(split_rhat(draws).max()), 4),
        "ess_bulk_min": round(float(ess), 1),
        "ess_tail_min": round(float(tail), 1),
        "ess_per_run": round(float(ess) / chains.runs, 3),
        "ess_per_cpu_s": round(float(ess) / cpu, 3),
        **library,
        "acceptance": round(float(np.mean(chains.accepted) / chains.proposed), 4),
        "independent": chains.independent,
        "pilot_k_hat": round(chains.pilot_k_hat, 3) if chains.independent else None,
        "emulator_error": float(np.max(chains.emulator_error)),
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
    }


def bundled_files(folder: Path, realisations: int) -> tuple[Path, Path, Path]:
    """Write case.json, hyperaemia.json (the true loop) and targets.json of the bundled patient; return their paths."""
    patient = make_patient(SyntheticSettings(), SEED)
    write_files(patient, folder / "patient")
    prepare_case(folder / "patient" / "case.yaml", CaseSettings(), folder)
    case, targets = folder / "case.json", folder / "targets.json"
    noise = PerfusionSettings(realisations=realisations)
    noise.models = {noise.use: noise.models[noise.use]}
    perfusion.run_chunk(case, folder / "lv.vtu", noise, SEED, 0, realisations, folder / "chunk.npz")
    perfusion.gather([folder / "chunk.npz"], case, folder / "lv.vtu", noise, targets)
    network, wanted = patient.hyperaemia.network, read_perfusion_targets(targets)
    outlets = read_case(case).outlets
    radii = [outlet.radius for outlet in outlets]
    share_out(network, shares(outlets, radii, dict(zip(wanted.bc, wanted.mean, strict=True))))
    write_network(folder / "hyperaemia.json", network)
    print("the bundled patient is ready", file=sys.stderr, flush=True)
    return case, folder / "hyperaemia.json", targets


def target_of(files: tuple[Path, Path, Path], settings: Settings) -> tuple[BedFlows, Likelihood]:
    """Return model and likelihood of the stage's posterior, for another sampler."""
    vessels = {outlet.bc: outlet.vessel for outlet in read_case(files[0]).outlets}
    targets = read_perfusion_targets(files[2])
    model = BedFlows(
        files[1], {bc: vessels[bc] for bc in targets.bc},
        tolerance=settings.cycle_tolerance, steps_per_cycle=settings.steps_per_cycle,
    )  # fmt: skip
    mean = targets.mean
    factor = model.flows(np.ones((1, len(mean)))).sum() / mean.sum()
    return model, Likelihood(mean * factor, targets.covariance * factor**2)


def _library(model: BedFlows, likelihood: Likelihood, chains: Chains, settings: Settings, quick: bool) -> dict:
    import emcee

    space = Conditioned(model.weights, settings.prior)
    exact = Posterior(model, space, likelihood)
    start = space.coordinates(chains.multipliers[:, -2:].reshape(-1, len(model.beds))[:WALKERS])

    def ensemble(log_density, steps):
        sampler = emcee.EnsembleSampler(WALKERS, space.dimension, log_density, vectorize=True)
        sampler.random_state = np.random.RandomState(SEED).get_state()
        started = time.process_time()
        sampler.run_mcmc(start, steps)
        cpu = time.process_time() - started
        draws = space.multipliers(sampler.get_chain(flat=True)).reshape(steps, WALKERS, -1).swapaxes(0, 1)
        return effective_size(draws, "bulk").min() / steps, cpu / steps

    per_step, cost = ensemble(lambda y: exact(y)[0], 10 if quick else 400)
    if quick:
        random = np.random.default_rng(SEED)
        count = design_size(space.dimension)
        linearised = Linearised.about(space, likelihood, chains.fit_multipliers, chains.fit_flows)
        y = linearised.design(space, count, random)
        emulator = Emulator.fit(y, space.multipliers(y), model.flows(space.multipliers(y)))
        per_step, _ = ensemble(emulator.screen(space, likelihood), 10_000)
    return {
        "library": f"emcee {emcee.__version__}, {WALKERS} walkers, stretch move",
        "library_ess_per_cpu_s": round(float(per_step / cost), 4),
        "library_ess_from": "emulated posterior, cost from the engine" if quick else "the engine",
    }
