"""DREAM samples what it is asked to: moments, detailed balance, independence of chains, restarts."""

import numpy as np
import pytest
from scipy import stats

from coronaryuq.posterior.sampler.dream import Dream
from coronaryuq.posterior.settings import DreamSettings
from support.known_targets import assert_moments, ess, exchange_asymmetry, gaussian, no_output, overdispersed


def run(log_density, start, generations, seed=1, *, screen=None, every=1, box=None, **settings):
    """Draws (decisions after burn-in, chains, d) and the sampler's last state."""
    settings = DreamSettings(chains=len(start), generations=generations, **settings)
    dream = Dream(no_output(log_density), settings, seed, screen=screen, every=every, box=box)
    state, draws = dream.start(start), []
    for _ in range(dream.decisions):
        dream.advance(state)
        draws.append(state.position.copy())
    return np.array(draws[dream.burn_in :]), state


@pytest.mark.parametrize(
    ("d", "chains", "generations", "options"),
    [
        (1, 12, 3000, {}),
        pytest.param(10, 24, 5000, {}, marks=pytest.mark.long),
        (10, 24, 5000, {"snooker": 0.2}),
        (10, 24, 4000, {"adapt_crossovers": False, "crossovers": 1, "unit_jump": 0.0}),
        pytest.param(40, 40, 4000, {}, marks=pytest.mark.long),
        pytest.param(100, 100, 60_000, {}, marks=pytest.mark.long),
    ],
)
def test_gaussian_moments(d, chains, generations, options):
    mean, covariance, log_density = gaussian(d)
    draws, _ = run(log_density, overdispersed(mean, covariance, chains), generations, **options)
    assert ess(draws).min() > 100
    assert_moments(draws, mean, covariance)


@pytest.mark.slow
def test_hundred_dimensions_stay_the_target():
    """Many chains started in the target are still distributed as it is after each has moved many times."""
    d, chains = 100, 600
    mean, covariance, log_density = gaussian(d)
    start = np.random.default_rng(0).multivariate_normal(mean, covariance, size=chains)
    draws, state = run(log_density, start, 100, adapt_crossovers=False, remove_outliers=False)
    assert np.mean(np.linalg.norm((draws[-1] - start) / np.sqrt(np.diag(covariance)), axis=1)) > 3
    assert state.accepted.mean() > 5
    z = (draws[-1] - mean) / np.sqrt(np.diag(covariance))
    assert np.all(np.abs(z.mean(axis=0)) < 4.5 / np.sqrt(chains))
    assert np.all(np.abs(np.mean(z**2, axis=0) - 1) < 4.5 * np.sqrt(2 / chains))


@pytest.mark.parametrize(("twist", "generations"), [(0.03, 10_000), pytest.param(0.1, 200_000, marks=pytest.mark.long)])
def test_twisted_target(twist, generations):
    """Haario's twist: x_2 + b x_1^2 - 100 b and the others are normal, x_1 with standard deviation 10."""

    def untwisted(x):
        y = x.copy()
        y[:, 1] += twist * x[:, 0] ** 2 - 100.0 * twist
        y[:, 0] /= 10.0
        return y

    start = np.random.default_rng(1).normal(size=(24, 5)) * 5
    draws, _ = run(lambda x: -0.5 * np.sum(untwisted(x) ** 2, axis=1), start, generations)
    normal = untwisted(draws.reshape(-1, 5)).reshape(draws.shape)
    assert_moments(normal, np.zeros(5), np.eye(5))


@pytest.mark.long
def test_bimodal_target_keeps_the_weights():
    """Modes at -4 and 4 in every coordinate with weights 1/3 and 2/3; jump rate 1 leaps between them."""
    d, chains = 5, 24

    def log_density(x):
        left, right = -0.5 * np.sum((x + 4) ** 2, axis=1), -0.5 * np.sum((x - 4) ** 2, axis=1)
        return np.logaddexp(left, np.log(2) + right)

    start = np.random.default_rng(1).normal(size=(chains, d)) + np.where(np.arange(chains) % 2, 4, -4)[:, None]
    draws, _ = run(log_density, start, 12_000, remove_outliers=False)
    right = (draws.mean(axis=2, keepdims=True) > 0).astype(float)
    n = ess(right)[0]
    assert n > 100
    assert abs(right.mean() - 2 / 3) < 4.5 * np.sqrt(2 / 9 / n)
    assert np.mean(right[1:] != right[:-1]) > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "boundary", ["reflect", *(pytest.param(other, marks=pytest.mark.long) for other in ("fold", "reject"))]
)
def test_box(boundary):
    """An exponential on [0, 2] x [0, 1]: walls keep the stationary distribution."""
    box = np.array([[0.0, 0.0], [2.0, 1.0]])

    def log_density(x):
        assert np.all((x >= box[0]) & (x <= box[1]))
        return -x[:, 0]

    start = np.random.default_rng(1).uniform(box[0], box[1], size=(24, 2))
    draws, _ = run(log_density, start, 6000, box=box, boundary=boundary, snooker=0.1)
    thinned = draws[::25].reshape(-1, 2)
    assert stats.kstest(thinned[:, 0], stats.truncexpon(b=2).cdf).pvalue > 1e-3
    assert stats.kstest(thinned[:, 1], "uniform").pvalue > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, pytest.param(15, marks=pytest.mark.long)])
def test_a_wrong_emulator_costs_time_and_no_correctness(every):
    mean, covariance, log_density = gaussian(4)

    def wrong(x):
        return 0.6 * log_density(x) + 0.3 * x[:, 0] + 0.2 * np.sin(3 * x[:, 1])

    draws, state = run(log_density, overdispersed(mean, covariance, 24), 6000 * every if every == 1 else 30_000,
                       screen=wrong, every=every)  # fmt: skip
    assert_moments(draws, mean, covariance)
    emulated, _ = run(wrong, overdispersed(mean, covariance, 24), 6000)
    with pytest.raises(AssertionError):
        assert_moments(emulated, mean, covariance)
    assert state.evaluations < state.generation * 24 or every == 1


def asymmetry_of_a_move(settings, screen=None, every=1, d=3):
    target = gaussian(d)

    def advance(seed, x):
        dream = Dream(no_output(target[2]), settings, seed, screen=screen, every=every)
        dream.burn_in = 0
        state = dream.start(x)
        order = np.random.default_rng(seed).permutation(len(x))
        half = len(x) // 2
        dream.move(state, order[:half], state.position[order[half:]], np.random.default_rng([seed, 1]))
        return x[order[:half]], state.position[order[:half]]

    return exchange_asymmetry(advance, target)


@pytest.mark.parametrize("options", [
    {"crossovers": 1, "unit_jump": 0.0}, {"crossovers": 3}, {"snooker": 0.9}, {"unit_jump": 0.9, "pairs": 1},
])  # fmt: skip
def test_detailed_balance_at_fixed_crossover(options):
    settings = DreamSettings(chains=24, generations=10, adapt_crossovers=False, remove_outliers=False, **options)
    assert np.all(np.abs(asymmetry_of_a_move(settings)) < 4.5)


def test_detailed_balance_with_an_emulator():
    _, _, log_density = gaussian(3)
    settings = DreamSettings(chains=24, generations=10, adapt_crossovers=False, remove_outliers=False)
    z = asymmetry_of_a_move(settings, screen=lambda x: 0.7 * log_density(x) + 0.2 * x[:, 0], every=5)
    assert np.all(np.abs(z) < 4.5)


def test_asymmetry_is_noticed():
    """The statistic can fail: a snooker step without its Jacobian breaks detailed balance."""
    from coronaryuq.posterior.sampler import dream as module

    settings = DreamSettings(chains=24, generations=10, snooker=0.9)
    correct = module.snooker
    module.snooker = lambda *given: (lambda p: type(p)(p.position, 0 * p.log_ratio, p.crossover))(correct(*given))
    try:
        assert np.max(np.abs(asymmetry_of_a_move(settings, d=6))) > 6
    finally:
        module.snooker = correct


@pytest.mark.slow
def test_chains_stay_independent():
    """From exact independent draws, six chains after some generations are still independent of each other.

    Chains that moved all at once, with each other for partners, would not be.
    """
    settings = DreamSettings(chains=6, pairs=1, generations=10, adapt_crossovers=False, remove_outliers=False)
    random, sums, squares = np.random.default_rng(5), [], []
    for seed in range(1000):
        dream = Dream(no_output(lambda x: -0.5 * np.sum(x**2, axis=1)), settings, seed)
        dream.burn_in = 0
        state = dream.start(random.normal(size=(6, 2)))
        for _ in range(3):
            dream.advance(state)
        mean = state.position.mean(axis=0)
        sums.append(6 * mean**2)
        squares.append(np.sum((state.position - mean) ** 2, axis=0) / 5)
    for values in (np.array(sums), np.array(squares)):
        z = (values.mean(axis=0) - 1) / (values.std(axis=0, ddof=1) / np.sqrt(len(values)))
        assert np.all(np.abs(z) < 4.5)


@pytest.mark.slow
def test_outlier_chain_is_restarted_only_during_burn_in():
    def log_density(x):
        return np.logaddexp(-0.5 * np.sum(x**2, axis=1), -60 - 0.5 * np.sum((x - 40) ** 2, axis=1))

    start = np.random.default_rng(1).normal(size=(12, 3))
    start[4] += 40.0
    draws, state = run(log_density, start, 2000, unit_jump=0.0)
    assert state.outliers >= 1
    assert np.all(np.abs(draws[:, 4]).max(axis=0) < 10)


@pytest.mark.slow
def test_crossover_adapts_to_correlation():
    """Where all coordinates move together, updating a few of them goes nowhere: CR = 1 gets more than its third."""
    mean, covariance, log_density = gaussian(10, correlation=0.98)
    _, state = run(log_density, overdispersed(mean, covariance, 24), 2000)
    assert np.isclose(state.crossover.sum(), 1)
    assert np.argmax(state.crossover) == 2
    assert state.crossover[2] > 0.4


def test_same_bits_from_a_saved_state():
    mean, covariance, log_density = gaussian(4)
    settings = DreamSettings(chains=12, generations=60)
    dream = Dream(no_output(log_density), settings, 9)
    whole = dream.start(overdispersed(mean, covariance, 12))
    for _ in range(25):
        dream.advance(whole)
    saved = type(whole)(**{name: np.array(value) for name, value in whole.arrays().items()})
    for _ in range(35):
        dream.advance(whole)
    other = Dream(no_output(log_density), settings, 9)
    for _ in range(35):
        other.advance(saved)
    for name, value in whole.arrays().items():
        assert np.array_equal(value, saved.arrays()[name], equal_nan=True), name


def test_settings_refuse_too_few_partners():
    with pytest.raises(ValueError, match="even"):
        DreamSettings(chains=13)
    with pytest.raises(ValueError, match="at least 12 chains"):
        DreamSettings(chains=10)
