"""The prediction before and after adoption, and with the truth."""

import numpy as np
import pytest

from coronaryuq.bench.discrepancy import benchmark
from coronaryuq.core.errors import InputError
from coronaryuq.zerod.network.read import write_network
from support.small_loop import loop


@pytest.mark.slow
def test_adoption_brings_the_prediction_to_that_of_the_true_model(tmp_path):
    """One stenosis in a loop of two coronary beds: FFR is off without it, and with it as far as with the truth."""
    write_network(tmp_path / "loop.json", loop())
    options = {"network": str(tmp_path / "loop.json"), "nature": "own", "offset": 1, "effects": ["quadratic_stenosis"]}
    found = benchmark.run(quick=False, loop=True, **options)["loop"]
    assert found["cases"] == found["named_right"] == 1
    assert found["ffr_error_before"] > 3 * found["ffr_error_truth"]
    assert abs(found["ffr_error_after"] - found["ffr_error_truth"]) < 0.2 * found["ffr_error_before"]
    (one,) = found["each"]
    assert found["flow_coverage_90_after"]["trials"] == len(one["after"]["flow"]["error"]) == 2
    assert np.isclose(found["ffr_error_after"], np.sqrt(np.mean(np.square(one["after"]["ffr"]["error"]))))


@pytest.mark.parametrize("options", [{}, {"network": "loop.json", "solver": "3d"}])
def test_it_needs_a_tuned_closed_loop(options):
    with pytest.raises(InputError, match="--network, a tuned closed loop"):
        benchmark.run(quick=False, loop=True, **options)
