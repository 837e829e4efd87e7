"""What is estimated of a row beyond its mean."""

import pytest

from coronaryuq.estimation.estimators.beyond_the_mean import beyond_the_mean
from coronaryuq.estimation.settings import Settings
from support.linear_trials import ROW, linear_trials

pytestmark = pytest.mark.slow


def test_a_quantile_with_few_runs_beyond_it_carries_a_warning():
    design, _, predictions = linear_trials()[0]
    found = beyond_the_mean(design, ROW, predictions, Settings())
    warned = {share for share, value in found.quantiles.items() if value.warning}
    assert warned == {"0.025", "0.05", "0.95", "0.975"}
    assert set(found.quantiles) - warned == {"0.25", "0.50", "0.75"}
