"""Three levels with a known mean: unbiased, claims against repeated trials and closed forms."""

from functools import partial

import numpy as np
import pytest

from coronaryuq.estimation.estimators.design import make_design
from coronaryuq.estimation.estimators.multilevel_crossfit import multilevel
from coronaryuq.estimation.surrogates import selector
from coronaryuq.estimation.surrogates.control_variates import METHODS
from support import three_levels


def trials(number, n, beyond, choose, failed=0.0):
    """Errors, claims and whether the interval held, of repeated trials; variances of the parts."""
    found = []
    for trial in range(number):
        runs = three_levels.campaign(n, beyond, 1000, trial, failed=failed)
        made, parts = multilevel(make_design(runs, [three_levels.ROW], 5, trial), three_levels.ROW, 0.95, choose)
        found.append((made.mean - three_levels.MEAN, made.std, made.interval.holds(three_levels.MEAN), parts))
    errors, stds, holds, parts = zip(*found, strict=True)
    return np.array(errors), np.array(stds), np.array(holds), parts


def judged(errors, stds, holds):
    """Bias within four standard errors; claim within its own error and a tenth; coverage within four of its own."""
    number = len(errors)
    spread = errors.std(ddof=1)
    assert abs(errors.mean()) < 4 * spread / np.sqrt(number)
    assert np.sqrt(np.mean(stds**2)) / spread == pytest.approx(1, abs=0.1 + 3 / np.sqrt(2 * number))
    assert holds.mean() > 0.95 - 4 * np.sqrt(0.95 * 0.05 / number)


def linear(seen, y):
    """The coarse run where it is seen, the row's 0D output where it is not."""
    return METHODS["linear 0D" if seen.coarse is None else "linear coarse"](seen, y)


@pytest.mark.slow
def test_linear_levels_are_unbiased_and_claim_their_own_spread():
    """And near the closed form: with f linear in the coarse run and g in the 0D output, the three parts are what plain
    regressions leave, fine / n + coarse / (n + m) + cheap / (n + M)."""
    errors, stds, holds, _ = trials(60, 30, 90, linear)
    judged(errors, stds, holds)
    random = np.random.default_rng(1)
    theta = random.uniform(0.5, 2, (200_000, 3))
    y, c, q = three_levels.fine(theta), three_levels.coarse(theta), three_levels.flow(theta)
    slope, below = np.cov(y, c)[0, 1] / np.var(c), np.cov(c, q)[0, 1] / np.var(q)
    closed = (
        np.var(y - slope * c) / 30 + slope**2 * np.var(c - below * q) / 120 + (slope * below) ** 2 * np.var(q) / 1030
    )
    # The fits know their coefficients from 24 runs: about one part in 24 of the fine part for the slope.
    assert np.mean(stds**2) == pytest.approx(closed, rel=0.25)


@pytest.mark.slow
def test_coarse_runs_that_fail_where_the_quantity_is_large_cause_no_bias():
    """The claim is a little short then, which is why many failures carry a warning."""
    errors, stds, _, _ = trials(40, 30, 90, linear, failed=0.2)
    spread = errors.std(ddof=1)
    assert abs(errors.mean()) < 4 * spread / np.sqrt(40) and np.sqrt(np.mean(stds**2)) > 0.6 * spread


@pytest.mark.long
@pytest.mark.parametrize("n", [25, 50])
def test_the_selector_on_three_levels_is_unbiased_and_its_claims_hold(n):
    errors, stds, holds, _ = trials(150, n, 3 * n, selector.choose)
    judged(errors, stds, holds)


def test_roughness_that_only_the_coarse_run_explains_goes_into_the_coarse_part():
    """The fine run's own part is a tenth of the roughness, which is in the coarse part."""
    runs = three_levels.campaign(40, 120, 1000, "worth")
    design = make_design(runs, [three_levels.ROW], 5, 1)
    simple = partial(selector.choose, simple=True)
    made, parts = multilevel(design, three_levels.ROW, 0.95, simple)
    assert parts.fine < 0.2 * 0.6**2 < parts.coarse < parts.cheap
    assert made.rho_held_out > 0.98 and "coarse" in made.method


def test_without_a_coarse_level_there_is_no_estimate():
    runs = three_levels.campaign(20, 40, 200)
    bare = make_design(three_levels.without_coarse(runs), [three_levels.ROW], 5, 1)
    assert multilevel(bare, three_levels.ROW, 0.95) is None
    pilot_only = three_levels.campaign(20, 0, 200)
    assert multilevel(make_design(pilot_only, [three_levels.ROW], 5, 1), three_levels.ROW, 0.95) is None
