"""Repeated trials against quadrature: the errors of chains are those that their effective sample sizes state."""

from dataclasses import replace

import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy import stats
from scipy.special import logsumexp

from coronaryuq.posterior import stage
from coronaryuq.posterior.model.fit_to_fractions import fit_fractions
from coronaryuq.posterior.model.flow_model import Posterior, respond
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.total_resistance import Conditioned
from coronaryuq.posterior.results import Chains
from coronaryuq.posterior.sampler.chains import prepare
from coronaryuq.posterior.settings import DreamSettings, EmulatorSettings, IndependenceSettings, Settings
from coronaryuq.zerod.theta import Laws, UncertainParameter
from support.quadrature import below, cells, moments
from support.resistor_tree import ResistorTree, Shared, targets_of

LAWS = Laws([UncertainParameter("p", "lognormal", 1.0, 0.7, "factor", {})])
TRIALS = 20
INDEPENDENCE = Settings(dream=DreamSettings(generations=1000), independence=IndependenceSettings(draws=105))
DELAYED = Settings(
    dream=DreamSettings(generations=4000), emulator=EmulatorSettings(generations=20),
    independence=IndependenceSettings(use=False),
)  # fmt: skip
PLAIN = Settings(dream=DreamSettings(generations=4000), emulator=EmulatorSettings(use=False))


class Narrowed(ResistorTree):
    """A tree whose first epicardial resistance changes with the column after the multipliers."""

    def flows(self, inputs):
        n = len(self.beds)
        epicardial = np.tile(self.epicardial, (len(inputs), 1))
        epicardial[:, :1] *= inputs[:, n:] if inputs.shape[1] > n else 1.0
        conductance = 1.0 / (epicardial + inputs[:, :n] * self.beds)
        return self.pressure / (1.0 + self.shared * conductance.sum(axis=1, keepdims=True)) * conductance


class Toy:
    """A tree with one uncertain parameter, flows measured with 5 %, and its posterior by quadrature."""

    def __init__(self, kind, beds):
        tree = ResistorTree.of(beds)
        self.model = kind(tree.pressure, tree.shared, tree.epicardial, tree.beds)
        mean, covariance = targets_of(tree, 0.05)
        self.targets = stage.TargetFlows([f"BC_{i}" for i in range(beds)], mean, covariance)
        self.fit = fit_fractions(self.model.flows, self.model.weights, mean)
        factor = self.fit.flows_at_r_hat.sum() / mean.sum()
        space = Conditioned(self.model.weights, INDEPENDENCE.prior, LAWS)
        response = respond(self.model, LAWS, self.fit.flows_at_r_hat)
        likelihood = Likelihood(mean * factor, covariance * factor**2)
        self.posterior = Posterior(self.model, space, likelihood, None, response)
        self.grid, self.mass = cells(self.posterior, {2: 300, 3: 80}[beds])

    def run(self, settings, seed, folder):
        """Logarithms of the multipliers and the coordinate of the parameter, (chains, draws, beds + 1)."""
        unknowns = stage.Unknowns(self.model.weights, LAWS)
        stage.run_chains(self.model, unknowns, self.targets, settings, seed, folder / "c.npz", key=f"{seed}")
        chains = Chains.read(folder / "c.npz")
        z = LAWS.coordinates(chains.kept_parameters.reshape(-1, 1)).reshape(chains.kept_parameters.shape)
        return np.concatenate([np.log(chains.kept_multipliers), z], axis=2)


@pytest.fixture(scope="module", params=[(Shared, 3), (Narrowed, 2)], ids=["shared", "narrowed"])
def toy(request):
    return Toy(*request.param)


@pytest.mark.long
@pytest.mark.parametrize("settings", [INDEPENDENCE, DELAYED, PLAIN], ids=["independence", "delayed", "plain"])
def test_errors_are_those_that_the_chains_state(toy, settings, tmp_path, capsys):
    """Means, and probabilities below the 5 % and the 95 % quantile: their z-scores have mean square 1 over seeds."""
    space = toy.posterior.space
    values = np.column_stack([np.log(space.multipliers(toy.grid)), space.standard(toy.grid)])
    mean, _ = moments(toy.mass, values)
    tails = [below(toy.mass, column, [0.05, 0.95]) for column in values.T]
    scores = []
    for seed in range(TRIALS):
        draws = toy.run(settings, seed, tmp_path)
        z = []
        for i, (limits, probabilities) in enumerate(tails):
            z.append((draws[..., i].mean() - mean[i]) / array_stats.mcse(draws[..., i], method="mean"))
            for limit, p in zip(limits, probabilities, strict=True):
                within = (draws[..., i] <= limit).astype(float)
                z.append((within.mean() - p) / np.sqrt(p * (1 - p) / array_stats.ess(within, method="mean")))
        scores.append(z)
    p = stats.chi2.sf(np.sum(np.square(scores), axis=0), TRIALS)
    assert p.min() > 1e-3 / len(p), np.sqrt(np.mean(np.square(scores), axis=0))


def test_nowhere_does_the_model_exceed_its_emulator_by_far(capsys):
    """A chain stays about p / q draws where the posterior p of the model exceeds q, here of the first emulator."""
    toy, means = Toy(Narrowed, 2), {"defended": [], "as fitted": []}
    for seed in range(8):
        emulator = prepare(toy.posterior, toy.fit, DELAYED, seed).emulator
        for kind, q in (("defended", emulator), ("as fitted", replace(emulator, height=-np.inf))):
            log_q = q.screen(toy.posterior.space, toy.posterior.likelihood)(toy.grid)
            log_ratio = np.log(toy.mass) - log_q + logsumexp(log_q)
            means[kind].append(logsumexp(log_ratio, b=toy.mass))
            assert kind != "defended" or log_ratio.max() < np.log(100)
    assert max(means["defended"]) < np.log(2) and max(means["as fitted"]) > np.log(1e3)
