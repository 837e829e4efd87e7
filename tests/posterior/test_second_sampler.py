"""On the bundled patient's closed loop, the stage's posterior is that of a library's sampler on the model itself."""

from itertools import combinations_with_replacement

import numpy as np
import pytest

from coronaryuq.bench.dream import SEED, bundled_files, target_of
from coronaryuq.posterior import stage
from coronaryuq.posterior.model.flow_model import Posterior
from coronaryuq.posterior.model.linearised import Linearised
from coronaryuq.posterior.model.total_resistance import Conditioned
from coronaryuq.posterior.sampler.diagnostics import effective_size
from coronaryuq.posterior.settings import Settings


def differences(ours, theirs):
    """Of two samples (chains, n, k): difference of means in standard deviations, and in standard errors."""
    spread = theirs.std(axis=(0, 1))
    error = np.sqrt(sum(x.var(axis=(0, 1)) / effective_size(x, "bulk") for x in (ours, theirs)))
    apart = ours.mean(axis=(0, 1)) - theirs.mean(axis=(0, 1))
    return apart / spread, apart / error


def products(standard):
    pairs = combinations_with_replacement(range(standard.shape[2]), 2)
    return np.stack([standard[:, :, i] * standard[:, :, j] for i, j in pairs], axis=2)


@pytest.mark.long
def test_agrees_with_emcee_on_the_bundled_patient(tmp_path):
    """Mean and covariance of log resistances: independence steps, and emcee with every proposal on the loop."""
    import emcee

    settings = Settings()
    files = bundled_files(tmp_path, realisations=500)
    stage.sample(*files, settings, SEED, tmp_path / "chains.npz")
    with np.load(tmp_path / "chains.npz") as chains:
        assert chains["independent"]
        ours = np.log(chains["multipliers"][:, int(chains["burn_in"]) :])
        fit = chains["fit_multipliers"], chains["fit_flows"]

    model, likelihood = target_of(files, settings)
    space = Conditioned(model.weights, settings.prior)
    posterior = Posterior(model, space, likelihood)
    start = Linearised.about(space, likelihood, *fit).design(space, 32, np.random.default_rng(SEED + 1))
    # Not emcee's DESnookerMove: of a standard normal in 13 dimensions it gives a standard deviation of 0.92.
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.StretchMove(), 0.2)]
    sampler = emcee.EnsembleSampler(32, space.dimension, lambda y: posterior(y)[0], moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(5).get_state()
    sampler.run_mcmc(start, 2500)
    kept = sampler.get_chain(discard=300)
    multipliers = space.multipliers(kept.reshape(-1, space.dimension)).reshape(*kept.shape[:2], -1)
    theirs = np.log(multipliers).swapaxes(0, 1)

    sizes = [effective_size(x, "bulk").min() for x in (ours, theirs)]
    mean, mean_z = differences(ours, theirs)
    centre, spread = theirs.mean(axis=(0, 1)), theirs.std(axis=(0, 1))
    second_moments = [products((x - centre) / spread) for x in (ours, theirs)]
    _, covariance_z = differences(*second_moments)
    covariance = second_moments[0].mean(axis=(0, 1)) - second_moments[1].mean(axis=(0, 1))
    ratio = ours.std(axis=(0, 1)) / spread
    print(
        f"effective samples {sizes[0]:.0f} and {sizes[1]:.0f}; means differ by at most {np.abs(mean).max():.3f} "
        f"sd ({np.abs(mean_z).max():.1f} standard errors), sds by {100 * np.abs(ratio - 1).max():.1f} %, second "
        f"moments by {np.abs(covariance).max():.3f} sd2 ({np.abs(covariance_z).max():.1f} standard errors); "
        f"root mean squares of the standard errors {np.sqrt(np.mean(mean_z**2)):.2f}, "
        f"{np.sqrt(np.mean(covariance_z**2)):.2f}"
    )
    assert min(sizes) > 500
    assert np.all(np.abs(mean_z) < 4.5)
    assert np.all(np.abs(covariance_z) < 4.5)
