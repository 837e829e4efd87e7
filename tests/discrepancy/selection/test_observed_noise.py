"""The noise that the data show about a model that is right."""

import numpy as np
import pandas as pd
import pytest

from coronaryuq.bench.discrepancy.benchmark import NATURE
from coronaryuq.bench.discrepancy.cases import Case
from coronaryuq.bench.discrepancy.hidden_cases import open_loop
from coronaryuq.bench.discrepancy.trial import hide, read_case
from coronaryuq.discrepancy.forward.hypothesis import PLAIN
from coronaryuq.discrepancy.selection.observed_noise import observe


@pytest.mark.slow
def test_outliers_do_not_hide_that_a_model_is_right(tmp_path):
    """Noise is 1.43 times as large as stated, with a correlation of 0.5; ten samples lie 15 standard deviations off."""
    case = Case((), "none", "violated", 69000)
    hide(case, open_loop(), tmp_path, case.nature(NATURE))
    table = pd.read_csv(tmp_path / "measurements.csv")
    flows = np.flatnonzero((table.statistic == "waveform") & (table.quantity == "flow") & (table.condition == "rest"))
    spikes = flows[5::11][:10]
    table.loc[spikes, "value"] += 15.0 * table.sd[spikes]
    table.to_csv(tmp_path / "measurements.csv", index=False)
    problem = read_case(tmp_path)
    found = observe(problem, PLAIN, problem.calibrate(PLAIN))
    assert len(found.outliers) == len(spikes) and found.right
    for quantity in ("flow", "pressure"):
        assert found.estimates[quantity].scale == pytest.approx(1.43, rel=0.2)
        assert found.estimates[quantity].noise.correlation_time > 0.0
