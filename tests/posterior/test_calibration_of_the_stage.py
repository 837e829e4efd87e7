"""The whole stage is calibrated, and agrees with a sampler from a library."""

import numpy as np
import pytest

from coronaryuq.case.case_json import read_case
from coronaryuq.posterior import stage
from coronaryuq.posterior.model.bed_flows import BedFlows
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.total_resistance import Conditioned
from coronaryuq.posterior.sampler.diagnostics import effective_size
from coronaryuq.posterior.settings import DreamSettings, EmulatorSettings, IndependenceSettings, Settings
from support.ranks import uniformity
from support.resistor_tree import ResistorTree, targets_of


def ranks_of_truth(replications, settings, folder, relative_sd=0.2, beds=4):
    """Ranks (replications, beds + 1) of the true multipliers and log likelihood among one draw of each chain."""
    tree = ResistorTree.of(beds)
    space = Conditioned(tree.weights, settings.prior)
    _, covariance = targets_of(tree, relative_sd)
    noise = np.linalg.cholesky(covariance)
    random = np.random.default_rng(2024)
    names = [f"BC_{i}" for i in range(beds)]
    ranks = np.empty((replications, beds + 1), dtype=int)
    for replication in range(replications):
        truth = space.multipliers(space.draw(random, 1))
        data = np.abs(tree.flows(truth)[0] + noise @ random.standard_normal(beds))
        stage.run_chains(
            tree, stage.Unknowns(tree.weights), stage.TargetFlows(names, data, covariance), settings, replication,
            folder / "chains.npz", key=str(replication),
        )  # fmt: skip
        with np.load(folder / "chains.npz") as chains:
            last, flows = chains["multipliers"][:, -1], chains["flows"][:, -1]
        likelihood = Likelihood(data, covariance)
        ranks[replication, :beds] = np.sum(last < truth, axis=0)
        true_density = likelihood.log_density(tree.flows(truth))
        ranks[replication, beds] = np.sum(likelihood.log_density(flows) < true_density)
    return ranks


SHORT = Settings(
    dream=DreamSettings(chains=12, generations=300), emulator=EmulatorSettings(generations=20),
    scale_targets=False, checkpoint=10_000, independence=IndependenceSettings(draws=20),
)  # fmt: skip


@pytest.mark.long
def test_simulation_based_calibration(tmp_path, capsys):
    """Truth from the prior, data from the model and its noise: ranks are uniform (Talts et al. 2018; Modrak 2023)."""
    p = uniformity(ranks_of_truth(80, SHORT, tmp_path), 12)
    assert np.all(p > 1e-3 / len(p)), p


@pytest.mark.long
def test_calibration_notices_a_wrong_covariance(tmp_path, capsys):
    """The same ranks are far from uniform when the stage believes the noise to be twice as large."""
    ranks = []
    original = stage.Likelihood
    stage.Likelihood = lambda mean, covariance, source: original(mean, 4 * covariance, source)
    try:
        ranks = ranks_of_truth(60, SHORT, tmp_path)
    finally:
        stage.Likelihood = original
    assert uniformity(ranks, 12).min() < 1e-5


@pytest.mark.long
@pytest.mark.parametrize(("emulated", "independent"), [(True, True), (True, False), (False, False)])
def test_simulation_based_calibration_long(tmp_path, capsys, emulated, independent):
    settings = SHORT.model_copy(deep=True)
    settings.emulator.use, settings.independence.use = emulated, independent
    settings.dream.generations = 1500
    p = uniformity(ranks_of_truth(1000, settings, tmp_path, beds=6), 12)
    assert np.all(p > 1e-3 / len(p)), p


@pytest.mark.long
def test_agrees_with_emcee_through_the_0d_engine(campaign, tmp_path, capsys):
    """Posterior mean and covariance of log resistances, independence steps against an ensemble sampler."""
    import emcee

    settings = Settings(dream=DreamSettings(generations=2000))
    stage.sample(*campaign, settings, 1, tmp_path / "chains.npz")
    with np.load(tmp_path / "chains.npz") as chains:
        assert chains["independent"]
        ours = np.log(chains["multipliers"][:, int(chains["burn_in"]) :])
        likelihood = Likelihood(chains["target_mean"], chains["target_covariance"])
    model = BedFlows(
        campaign[1], {o.bc: o.vessel for o in read_case(campaign[0]).outlets}, tolerance=1e-4, steps_per_cycle=None
    )
    posterior = Posterior(model, Conditioned(model.weights, settings.prior), likelihood)
    start = posterior.space.draw(np.random.default_rng(0), 32)
    sampler = emcee.EnsembleSampler(
        32, posterior.space.dimension, lambda y: posterior(y)[0], vectorize=True,
        moves=[(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)],
    )  # fmt: skip
    sampler.random_state = np.random.RandomState(5).get_state()
    sampler.run_mcmc(start, 1600)
    theirs = sampler.get_chain(discard=300)
    theirs = np.log(posterior.space.multipliers(theirs.reshape(-1, theirs.shape[2]))).reshape(*theirs.shape[:2], -1)
    theirs = theirs.swapaxes(0, 1)
    n = 1 / (1 / effective_size(ours, "bulk") + 1 / effective_size(theirs, "bulk"))
    assert n.min() > 200
    a, b = (x.reshape(-1, x.shape[2]) for x in (ours, theirs))
    assert np.all(np.abs(a.mean(axis=0) - b.mean(axis=0)) < 4.5 * b.std(axis=0) / np.sqrt(n))
    covariance, deviation = np.cov(b.T), b.std(axis=0)
    error = (np.cov(a.T) - covariance) / np.outer(deviation, deviation)
    assert np.all(np.abs(error) < 4.5 * np.sqrt(2 / n.min()))
