"""Uncertain parameters of the network, sampled with the multipliers: against quadrature, and what informs them."""

import numpy as np
import pytest
import xarray
from hypothesis import given
from hypothesis import settings as of_hypothesis
from hypothesis import strategies as st

from coronaryuq.case.network.network import UNCERTAIN
from coronaryuq.core.io.atomic import write_json
from coronaryuq.core.io.tables import read_csv
from coronaryuq.posterior import stage
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.model.likelihood import Likelihood
from coronaryuq.posterior.model.total_resistance import Conditioned
from coronaryuq.posterior.results import Chains, read_summary
from coronaryuq.posterior.sampler.diagnostics import effective_size
from coronaryuq.posterior.settings import DreamSettings, EmulatorSettings, IndependenceSettings, Settings
from coronaryuq.zerod.theta import Laws, UncertainParameter
from support.quadrature import cells, moments
from support.resistor_tree import ResistorTree, Shared, network_of, targets_of

SETTINGS = Settings(dream=DreamSettings(generations=4000), independence=IndependenceSettings(draws=405))
PLAIN = SETTINGS.model_copy(update={"emulator": EmulatorSettings(use=False)})


class Narrowed(ResistorTree):
    """A tree whose epicardial resistances change by the columns after the multipliers, dealt to vessels in turn."""

    def flows(self, inputs):
        n = len(self.beds)
        factor = np.ones((len(inputs), n))
        for j in range(inputs.shape[1] - n):
            factor[:, j % n] *= inputs[:, n + j]
        conductance = 1.0 / (self.epicardial * factor + inputs[:, :n] * self.beds)
        node = self.pressure / (1.0 + self.shared * conductance.sum(axis=1, keepdims=True))
        return node * conductance


def of(kind, count):
    tree = ResistorTree.of(count)
    return kind(tree.pressure, tree.shared, tree.epicardial, tree.beds)


def factors(*spreads):
    return [UncertainParameter(f"p{j}", "lognormal", 1.0, spread, "factor", {}) for j, spread in enumerate(spreads)]


def sampled(model, laws, settings, folder, relative_sd=0.2):
    names = [f"BC_{i}" for i in range(len(model.beds))]
    targets = stage.TargetFlows(names, *targets_of(model, relative_sd))
    stage.run_chains(model, stage.Unknowns(model.weights, laws), targets, settings, 3, folder / "c.npz", key="k")
    return Chains.read(folder / "c.npz")


CHOICE = UncertainParameter("member", "choice", 0.0, 1.0, "effect", {}, probabilities=(0.55, 0.3, 0.15))


class Chosen(ResistorTree):
    """A tree whose first epicardial resistance is one of three, by the column after the multipliers."""

    def flows(self, inputs):
        n = len(self.beds)
        epicardial = np.tile(self.epicardial, (len(inputs), 1))
        if inputs.shape[1] > n:
            epicardial[:, 0] *= np.array([1.0, 4.0, 12.0])[inputs[:, n].astype(int)]
        conductance = 1.0 / (epicardial + inputs[:, :n] * self.beds)
        return self.pressure / (1.0 + self.shared * conductance.sum(axis=1, keepdims=True)) * conductance


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings", [SETTINGS, pytest.param(PLAIN, marks=pytest.mark.long)], ids=["independence", "plain"]
)
@pytest.mark.parametrize(
    "known", [pytest.param(False, marks=pytest.mark.long), True], ids=["unit unknown", "unit known"]
)
def test_the_probability_of_each_choice_is_that_of_quadrature(tmp_path, settings, known):
    """Prior probability times the evidence of the flows, by quadrature over the multipliers."""
    model, laws = of(Chosen, 2), Laws([CHOICE])
    settings = settings.model_copy(update={"scale_targets": not known})
    chains = sampled(model, laws, settings, tmp_path, relative_sd=0.08)
    posterior = posterior_of(model, laws, chains, settings)
    space = posterior.space
    y = np.linspace(*np.sort(space.coordinates(np.array([[0.5001, 0.0], [1.9999, 0.0]]) + [0.0, 1.0])[:, 0]), 20_001)
    weights = []
    for number, prior in enumerate(CHOICE.probabilities):
        z = laws.coordinates(np.array([[float(number)]]))[0, 0]
        density = posterior(np.column_stack([y, np.full(len(y), z)]))[0] + 0.5 * z**2
        weights.append(prior * np.exp(density).sum())
    expected = np.array(weights) / sum(weights)
    drawn = chains.kept_parameters[:, :, 0]
    size = min(effective_size((drawn == number)[..., None].astype(float), "bulk")[0] for number in range(3))
    share = np.array([np.mean(drawn == number) for number in range(3)])
    assert size > 300 and abs(expected[0] - 0.55) > 0.01, "the flows inform it"
    assert np.all(np.abs(share - expected) < 4 * np.sqrt(expected * (1 - expected) / size))
    assert not settings.emulator.use or chains.independent


def posterior_of(model, laws, chains, settings):
    """The posterior that these chains are draws of."""
    likelihood = Likelihood(chains.target_mean, chains.target_covariance)
    response = stage.respond(model, laws, model.flows(np.ones((1, len(model.beds))))[0])
    space = Conditioned(model.weights, settings.prior, laws)
    return Posterior(model, space, likelihood, None, response, total_known=not settings.scale_targets)


def moments_by_quadrature(posterior, points):
    """Mean and standard deviation of log m_0 and z of a posterior with one parameter."""
    grid, mass = cells(posterior, points)
    return moments(mass, np.column_stack([np.log(posterior.space.multipliers(grid)[:, 0]), grid[:, -1]]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings", [SETTINGS, pytest.param(PLAIN, marks=pytest.mark.long)], ids=["independence", "plain"]
)
@pytest.mark.parametrize(
    "known", [pytest.param(False, marks=pytest.mark.long), True], ids=["unit unknown", "unit known"]
)
def test_posterior_of_one_parameter_is_that_of_quadrature(tmp_path, settings, known):
    model, laws = of(Narrowed, 2), Laws(factors(1.0))
    settings = settings.model_copy(update={"scale_targets": not known})
    chains = sampled(model, laws, settings, tmp_path, relative_sd=0.1)
    mean, sd = moments_by_quadrature(posterior_of(model, laws, chains, settings), 500)
    draws = np.stack([np.log(chains.kept_multipliers[:, :, 0]), np.log(chains.kept_parameters[:, :, 0])], axis=2)
    size = effective_size(draws, "bulk")
    assert size.min() > 500
    assert np.all(np.abs(draws.mean(axis=(0, 1)) - mean) < 4 * sd / np.sqrt(size))
    assert np.all(np.abs(draws.std(axis=(0, 1)) / sd - 1) < 4 / np.sqrt(2 * size) + 0.02)
    assert 1 - sd[1] > 0.02, "the flows inform it"


@pytest.mark.long
def test_a_parameter_that_scales_all_flows_is_informed_by_the_unit_alone(tmp_path):
    """Where the unit of the targets is unknown, its posterior is its prior, as far as a quadratic is its response."""
    model, laws = of(Shared, 3), Laws(factors(0.7))
    unknown = sampled(model, laws, SETTINGS, tmp_path / "unknown", relative_sd=0.05)
    (_, mean), (_, sd) = moments_by_quadrature(posterior_of(model, laws, unknown, SETTINGS), 80)
    assert abs(mean) < 0.03 and abs(sd - 1) < 0.12, "nearly the prior"
    z = laws.coordinates(unknown.kept_parameters.reshape(-1, 1))
    size = effective_size(unknown.kept_parameters, "bulk")[0]
    assert abs(z.mean() - mean) < 4 * sd / np.sqrt(size) and abs(z.std() / sd - 1) < 4 / np.sqrt(2 * size) + 0.01
    known = sampled(model, laws, SETTINGS.model_copy(update={"scale_targets": False}), tmp_path / "known", 0.005)
    assert laws.coordinates(known.kept_parameters.reshape(-1, 1)).std() < 0.6


@of_hypothesis(max_examples=25)
@given(st.lists(st.floats(-3, 3), min_size=2, max_size=2), st.integers(0, 10_000))
def test_without_spread_the_posterior_is_the_one_without_parameters(z, seed):
    model, plain = of(Narrowed, 5), ResistorTree.of(5)
    likelihood, laws = Likelihood(*targets_of(plain)), Laws(factors(0.0, 0.0))
    before = Posterior(plain, Conditioned(plain.weights, (0.5, 2.0)), likelihood)
    response = stage.respond(model, laws, model.flows(np.ones((1, 5)))[0])
    after = Posterior(model, Conditioned(plain.weights, (0.5, 2.0), laws), likelihood, None, response)
    y = before.space.draw(np.random.default_rng(seed), 1)
    (density,), flows = before(y)
    (extended,), same = after(np.hstack([y, [z]]))
    assert extended == pytest.approx(density - 0.5 * np.sum(np.square(z)), rel=1e-12)
    assert np.array_equal(flows, same)


@pytest.mark.slow
@pytest.mark.parametrize("beds", [6, pytest.param(22, marks=pytest.mark.long)])
def test_independence_steps_work_with_25_parameters(tmp_path, beds):
    model, laws = of(Narrowed, beds), Laws(factors(*[0.05, 0.1, 0.2, 0.3, 0.5] * 5))
    settings = SETTINGS.model_copy(update={"independence": IndependenceSettings(draws=105)})
    chains = sampled(model, laws, settings, tmp_path)
    assert chains.independent and chains.pilot_k_hat < 0.5
    draws = np.concatenate([chains.kept_multipliers, chains.kept_parameters], axis=2)
    assert effective_size(draws, "bulk").min() > 0.25 * draws.shape[0] * draws.shape[1]


@pytest.fixture
def uncertain(campaign):
    """The small patient, with two uncertain parameters of its loop."""
    network = network_of(ResistorTree.of(6))
    network[UNCERTAIN] = [
        {"name": "width", "distribution": "lognormal", "centre": 1.0, "spread": 0.1, "kind": "factor",
         "targets": {"v0.R_poiseuille": -4.0, "v1.R_poiseuille": -4.0}},
        {"name": "offset", "distribution": "normal", "centre": -2.0, "spread": 300.0, "kind": "add",
         "targets": {"v2.R_poiseuille": 1.0}, "loadings": {"width": 50.0}},
    ]  # fmt: skip
    write_json(campaign[1], network)
    return campaign


@pytest.mark.slow
def test_from_files_to_samples(uncertain, tmp_path):
    settings = SETTINGS.model_copy(update={"independence": IndependenceSettings(draws=45)})
    stage.sample(*uncertain, settings, 3, tmp_path / "chains.npz")
    files = [tmp_path / name for name in ("posterior.nc", "draws.csv", "summary.json", "fractions.csv", "fitted.json")]
    stage.gather(*uncertain, tmp_path / "chains.npz", settings, 3, stage.GatheredFiles(*files))
    summary, draws = read_summary(files[2]), read_csv(files[1])
    assert summary.independence.used and set(summary.parameters) == {"width", "offset"} <= set(summary.rhat)
    assert list(draws.columns)[-4:] == ["BC_5", "width", "offset", "log_density"]
    assert (draws["offset"] < 0).any() and (draws["width"] > 0).all()
    data = xarray.open_datatree(files[0], engine="h5netcdf")
    assert data["posterior"]["parameter_value"].shape == (24, 40, 2)
    stage.draw_samples(files[1], settings, 3, "pilot", 10, tmp_path / "pilot.csv")
    columns = list(read_csv(tmp_path / "pilot.csv").columns)
    assert columns[-3:] == ["width", "offset", "R_cor_scaling"]


@pytest.mark.long
def test_chains_with_parameters_made_longer_are_those_made_so_at_once(uncertain, tmp_path):
    settings = SETTINGS.model_copy(update={"independence": IndependenceSettings(draws=25)})
    before = None
    for length in (1, 2):
        extent = stage.Extent(length, before)
        stage.sample(*uncertain, settings, 3, tmp_path / str(length) / "chains.npz", extent=extent)
        before = tmp_path / str(length) / "chains.npz"
    stage.sample(*uncertain, settings, 3, tmp_path / "at once" / "chains.npz", extent=stage.Extent(2))
    one, two = Chains.read(before), Chains.read(tmp_path / "at once" / "chains.npz")
    assert np.array_equal(one.parameters, two.parameters) and np.array_equal(one.flows, two.flows)
    assert one.runs == two.runs
